//! Wheels of cars, buses and motorbikes, lying along the X axis.

use std::f64::consts::TAU;

use super::assembly::Assembly;
use super::solid::{self, Point, add, scale};

/// What a wheel looks like.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wheel {
    /// To the tread.
    pub(super) radius: f64,
    /// Of the tyre.
    pub(super) width: f64,
    /// Of the rim, as a share of the radius.
    pub(super) rim: f64,
    /// Spokes of the rim; 0 is a disc.
    pub(super) spokes: usize,
    /// Whether one can look through between the spokes.
    pub(super) open: bool,
    /// Of rim and spokes.
    pub(super) color: [f32; 3],
}

/// What tyres are made of.
pub(super) const RUBBER: [f32; 3] = [0.07, 0.07, 0.08];
/// Behind spokes.
const SHADE: [f32; 3] = [0.16, 0.16, 0.17];

impl Wheel {
    /// Adds the wheel around a centre; `out` is the sign of x on which one sees its face.
    pub(super) fn build(&self, assembly: &mut Assembly, center: Point, out: f64) {
        let (r, half) = (self.radius, 0.5 * self.width);
        let rim = self.rim * r;
        let axis = [out, 0.0, 0.0];
        let round = 0.35 * half.min(r - rim);
        let section = [
            [rim, -0.9 * half],
            [r - 2.0 * round, -half],
            [r - 0.5 * round, -half + 0.4 * round],
            [r, -half + 1.6 * round],
            [r, half - 1.6 * round],
            [r - 0.5 * round, half - 0.4 * round],
            [r - 2.0 * round, half],
            [rim, 0.9 * half],
        ];
        assembly.add("tyre", solid::turned_ring(&section, 28, center, axis), RUBBER);
        let lip = [
            [0.88 * rim, -0.85 * half],
            [1.03 * rim, -0.95 * half],
            [1.03 * rim, 0.95 * half],
            [0.88 * rim, 0.85 * half],
        ];
        assembly.add("rim", solid::turned_ring(&lip, 24, center, axis), self.color);
        if !self.open {
            let depth = if self.spokes == 0 { 0.75 } else { 0.45 } * half;
            let back = if self.spokes == 0 { self.color } else { SHADE };
            let disc =
                [[0.0, -0.5 * half], [0.93 * rim, -0.5 * half], [0.93 * rim, depth], [0.0, depth]];
            assembly.add("disc", solid::turned(&disc, 20, center, axis), back);
        }
        let face = if self.open { 0.0 } else { 0.55 * half };
        for k in 0..self.spokes {
            let (sin, cos) = (TAU * (k as f64 + 0.25) / self.spokes as f64).sin_cos();
            let along = [0.0, cos, sin];
            let at =
                |share: f64| add(center, add(scale(along, share * rim), [out * face, 0.0, 0.0]));
            let thick = 0.55 * rim / (self.spokes as f64).max(4.0);
            let thick = thick.min(0.3 * half.max(0.03 * r));
            assembly.add(
                "spoke",
                solid::rod(at(0.1), at(0.95), [1.1 * thick, 0.9 * thick], 6),
                self.color,
            );
        }
        let hub = [
            [0.0, -0.8 * half],
            [0.24 * rim, -0.8 * half],
            [0.24 * rim, 0.75 * half],
            [0.16 * rim, 0.9 * half],
            [0.0, 0.9 * half],
        ];
        assembly.add("hub", solid::turned(&hub, 14, center, axis), self.color);
    }
}

/// A mudguard: a bent sheet of a radius and half width over a wheel, between two angles from the
/// front (0) over the top (a quarter turn) to the rear.
pub(super) fn mudguard(
    center: Point,
    [radius, half]: [f64; 2],
    [from, to]: [f64; 2],
    sag: f64,
) -> mesh_core::TriMesh {
    let surface = |u: f64, v: f64| {
        let (sin, cos) = (from + (to - from) * v).sin_cos();
        let across = 2.0 * u - 1.0;
        let radius = radius - sag * across * across;
        add(center, [half * across, radius * sin, radius * cos])
    };
    solid::plate(surface, [4, 20], [0.004, 0.004])
}
