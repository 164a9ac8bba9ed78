//! Engines and their pipes.

use super::super::assembly::Assembly;
use super::super::draw::Draw;
use super::super::solid::{self, mix};
use super::plan::{Bike, CHROME, DARK, ENGINE, STEEL, Style, X};

/// Adds the engine; returns its kind.
pub(super) fn engine(all: &mut Assembly, b: &Bike, draw: &mut Draw) -> &'static str {
    let kind = match b.style {
        Style::Cruiser => "V-twin",
        Style::Dirt => "single",
        Style::Sport => "four",
        _ => draw.pick(&["V-twin", "single", "four", "boxer"]),
    };
    let z = 0.5 * (b.front[2] - b.radii[1] + b.rear[2] + b.radii[0]) - 0.02;
    let case = solid::rounded_block([0.0, 0.32, z], [0.28, 0.24, 0.42], 0.07);
    all.add("crankcase", case, ENGINE);
    for side in [-1.0, 1.0] {
        let cover = [[0.0, 0.0], [0.1, 0.0], [0.095, 0.03], [0.06, 0.045], [0.0, 0.047]];
        for (dz, size) in [(-0.1, 0.9), (0.08, 0.8)] {
            let at = [side * 0.13, 0.32, z + dz];
            let mesh = solid::turned(&cover, 18, at, [side, 0.0, 0.0]).map_positions(|p| {
                let about = [at[0] as f32, at[1] as f32, at[2] as f32];
                std::array::from_fn(|k| about[k] + (p[k] - about[k]) * size as f32)
            });
            all.add("cover", mesh, if b.style == Style::Cruiser { CHROME } else { STEEL });
        }
    }
    let cylinders: &[[f64; 3]] = match kind {
        "V-twin" => &[[0.42, 0.0, 0.13], [-0.42, 0.0, 0.13]],
        "single" => &[[0.15, 0.0, 0.14]],
        "four" => &[[0.3, 0.0, 0.34]],
        _ => &[],
    };
    for &[lean, x, wide] in cylinders {
        let mut fins = Assembly::default();
        for k in 0..5 {
            let y = 0.1 + 0.042 * f64::from(k);
            let size = if k % 2 == 0 { 1.0 } else { 0.8 };
            let fin = [wide * size, 0.05, 0.17 * size];
            fins.add("cylinder", solid::rounded_block([x, y, 0.0], fin, 0.012), ENGINE);
        }
        let head = [wide * 1.02, 0.075, 0.18];
        fins.add("head", solid::rounded_block([x, 0.32, 0.0], head, 0.025), STEEL);
        let place =
            [0.0, 0.32, z + 0.06 * f64::signum(lean) * f64::from(u8::from(kind == "V-twin"))];
        let at = place.map(|v| v as f32);
        fins.move_since(0, |mesh| solid::rotated(mesh, [0.0; 3], X, lean).translated(at));
        all.absorb(fins);
    }
    if kind == "boxer" {
        for k in 0..4 {
            let size = if k % 2 == 0 { 1.0 } else { 0.82 };
            let at = [0.15 + 0.045 * f64::from(k), 0.34, z + 0.1];
            let fin = [0.05, 0.17 * size, 0.19 * size];
            all.pair("cylinder", solid::rounded_block(at, fin, 0.012), ENGINE);
        }
        let head = solid::rounded_block([0.34, 0.34, z + 0.1], [0.08, 0.17, 0.2], 0.035);
        all.pair("head", head, STEEL);
    }
    kind
}

/// Adds the exhaust pipes; returns how many.
pub(super) fn exhaust(all: &mut Assembly, b: &Bike, draw: &mut Draw) -> usize {
    let count = match b.style {
        Style::Cruiser => draw.pick(&[2, 2, 4]),
        Style::Dirt => 1,
        _ => draw.count(1, 2),
    };
    let metal = if b.style == Style::Cruiser { CHROME } else { draw.pick(&[STEEL, DARK]) };
    let back = b.rear[2];
    let start = 0.22;
    let one = |x: f64, y: f64, rise: f64| {
        let root = [0.6 * x, 0.5, start];
        let knee = [0.85 * x, y + 0.05, start + 0.08];
        let low = [x, y, start - 0.25];
        let joint = [x, y + 0.2 * rise, back + 0.42];
        let tip = [x + 0.01, y + rise, back - 0.1];
        let pipe = solid::bar(&[root, knee, low, joint, mix(joint, tip, 0.2)], 0.026, 5, 10);
        (pipe, joint, tip)
    };
    let x = 0.5 * b.widths[0] + 0.1;
    let (y, rise) = match b.style {
        Style::Cruiser => (0.24, 0.02),
        Style::Dirt => (0.52, 0.26),
        Style::Sport => (0.22, draw.within(0.2, 0.4)),
        _ => (0.22, draw.within(0.05, 0.25)),
    };
    for k in 0..count {
        let side =
            if k % 2 == 0 && !(b.style == Style::Cruiser && count == 2) { -1.0 } else { 1.0 };
        let (side, level) = if b.style == Style::Cruiser && count == 2 {
            (-1.0, 0.1 * k as f64)
        } else {
            (side, 0.1 * (k / 2) as f64)
        };
        let (pipe, joint, tip) = one(x, y + level, rise);
        let fat = if b.style == Style::Cruiser { [0.04, 0.048] } else { [0.045, 0.062] };
        let muffler = solid::rod(joint, tip, fat, 16);
        let end = solid::rod(mix(joint, tip, 0.9), mix(joint, tip, 1.015), [0.036; 2], 12);
        for (name, mesh, color) in
            [("pipe", pipe, metal), ("muffler", muffler, metal), ("outlet", end, DARK)]
        {
            all.add(name, if side > 0.0 { mesh } else { solid::mirrored(&mesh) }, color);
        }
    }
    count
}
