//! Cranks, pedals and chain.

use std::f64::consts::{PI, TAU};

use super::super::assembly::Assembly;
use super::super::solid::{self, Point, add};
use super::{DARK, Frame, STEEL, X};

pub(super) fn drive(all: &mut Assembly, f: &Frame) {
    let (big, small) = (0.095, 0.04);
    let side = -0.06;
    let at = add(f.bottom, [side, 0.0, 0.0]);
    let ring = [[big - 0.022, -0.004], [big, -0.004], [big, 0.004], [big - 0.022, 0.004]];
    all.add("chainring", solid::turned_ring(&ring, 36, at, X), STEEL);
    for k in 0..5 {
        let (sin, cos) = (TAU * f64::from(k) / 5.0).sin_cos();
        let tip = add(at, [0.0, (big - 0.012) * cos, (big - 0.012) * sin]);
        all.add("spider", solid::rod(at, tip, [0.008, 0.007], 6), STEEL);
    }
    let cog = [[0.0, -0.012], [small, -0.006], [small, 0.006], [0.0, 0.012]];
    let back = add(f.rear, [side, 0.0, 0.0]);
    all.add("cog", solid::turned(&cog, 18, back, X), STEEL);
    chain(all, at, back, [big, small]);
    // Cranks at a slant, a pedal at each end.
    let (sin, cos) = 0.6_f64.sin_cos();
    for (x, sign) in [(-0.085, 1.0), (0.075, -1.0)] {
        let root = add(f.bottom, [x, 0.0, 0.0]);
        let tip = add(root, [0.0, -sign * 0.165 * sin, sign * 0.165 * cos]);
        all.add("crank", solid::bar(&[root, tip], 0.0125, 1, 8), STEEL);
        let out = add(tip, [x.signum() * 0.055, 0.0, 0.0]);
        all.add("pedal", solid::rounded_block(out, [0.09, 0.022, 0.085], 0.009), DARK);
    }
    let ends = [-0.09, 0.08].map(|x| add(f.bottom, [x, 0.0, 0.0]));
    all.add("crank axle", solid::rod(ends[0], ends[1], [0.011; 2], 8), STEEL);
}

/// The chain: straight above and below, round chainring and cog.
fn chain(all: &mut Assembly, front: Point, back: Point, [big, small]: [f64; 2]) {
    let [dz, dy] = [front[2] - back[2], front[1] - back[1]];
    let tilt = dy.atan2(dz);
    // How far the straight runs lean against the line of centres.
    let lean = ((big - small) / dz.hypot(dy)).asin();
    let arc = |center: Point, radius: f64, from: f64, to: f64, n: usize| {
        (0..=n).map(move |k| {
            let (sin, cos) = (from + (to - from) * k as f64 / n as f64).sin_cos();
            add(center, [0.0, radius * sin, radius * cos])
        })
    };
    let quarter = 0.5 * PI;
    let (a, b) = (tilt - quarter - lean, tilt + quarter + lean);
    let mut path: Vec<Point> = arc(front, big, a, b, 14).collect();
    path.extend(arc(back, small, b, a + TAU, 8));
    let path: Vec<[f32; 3]> = path.iter().map(|p| p.map(|v| v as f32)).collect();
    let ends = mesh_core::primitives::TubeEnds::Loop;
    all.add("chain", mesh_core::primitives::tube(&path, &[0.008], 6, ends), [0.3, 0.3, 0.31]);
}
