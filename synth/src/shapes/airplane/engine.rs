//! Jets and propellers.

use std::f64::consts::{PI, TAU};

use mesh_core::TriMesh;

use super::super::assembly::Assembly;
use super::super::draw::Draw;
use super::super::solid::{self, Point, add};
use super::plan::{Colors, DARK, METAL, Plane, Style};
use super::wing::Wing;

/// Adds the engines; returns their arrangement.
pub(super) fn engines(
    all: &mut Assembly,
    plane: &Plane,
    draw: &mut Draw,
    style: Style,
    (wing, colors): (&Wing, &Colors),
) -> &'static str {
    let r = plane.radius;
    let arrangement = match style {
        Style::Airliner => {
            draw.pick(&["2 under wings", "2 under wings", "4 under wings", "2 at rear"])
        }
        Style::Jumbo => "4 under wings",
        Style::Business => draw.pick(&["2 at rear", "3 at rear"]),
        Style::Propeller => draw.pick(&["1 at nose", "1 at nose", "2 on wings"]),
        Style::Turboprop => draw.pick(&["2 on wings", "4 on wings"]),
        Style::Fighter => draw.pick(&["1 inside", "2 inside"]),
    };
    let cowl = draw.pick(&[colors.body, colors.accent, METAL]);
    match arrangement {
        "1 at nose" => {
            let hub = [0.0, -0.05 * r, plane.z(0.0)];
            propeller(all, draw, hub, 0.95 * r, colors);
        }
        "2 under wings" | "4 under wings" => {
            let four = arrangement.starts_with('4');
            let size = if four { 0.42 } else { 0.52 } * r;
            let places: &[f64] = if four { &[0.33, 0.62] } else { &[0.34] };
            for &share in places {
                let at = add(wing.at(share, 0.0), [0.0, -1.05 * size, 0.35 * size]);
                all.pair("pylon", pylon(wing.at(share, 0.25), at, size), colors.wing);
                jet(all, at, size, cowl);
            }
        }
        "2 at rear" | "3 at rear" => {
            let size = 0.43 * r;
            let at = [plane.at(0.76)[0] + 0.95 * size, 0.42 * r, plane.z(0.72)];
            let bridge =
                solid::block([0.6 * at[0], at[1], at[2] - size], [at[0], 0.16 * r, 1.3 * size]);
            all.pair("pylon", bridge, colors.wing);
            jet(all, at, size, cowl);
            if arrangement == "3 at rear" {
                let top = plane.at(0.8)[1];
                let at = [0.0, top + 0.62 * size, plane.z(0.78)];
                nacelle(all, at, 0.9 * size, 3.6 * size, cowl, false);
            }
        }
        "2 on wings" | "4 on wings" => {
            let places: &[f64] = if arrangement.starts_with('4') { &[0.27, 0.56] } else { &[0.3] };
            let size = if style == Style::Propeller { 0.45 } else { 0.36 } * r;
            for &share in places {
                let front = add(wing.at(share, 0.0), [0.0, 0.0, 1.6 * size]);
                let long = 1.6 * size + 0.8 * wing.chords[0];
                let profile = [
                    [0.0, 0.0],
                    [0.3 * size, 0.03 * long],
                    [0.8 * size, 0.4 * long],
                    [size, 0.75 * long],
                    [0.9 * size, 0.93 * long],
                    [0.55 * size, long],
                    [0.0, long],
                ];
                let back = add(front, [0.0, 0.0, -long]);
                let mesh = solid::turned(&profile, 16, back, [0.0, 0.0, 1.0]);
                all.pair("nacelle", mesh, cowl);
                let spin = draw.within(0.0, PI);
                let reach = if style == Style::Propeller { 2.2 } else { 2.5 } * size;
                for side in [-1.0, 1.0] {
                    let hub = [side * front[0], front[1], front[2]];
                    blades(all, hub, reach, (4, spin), colors);
                }
            }
        }
        _ => {
            let two = arrangement.starts_with('2');
            let size = if two { 0.36 } else { 0.48 } * r;
            let places: &[f64] = if two { &[-0.4, 0.4] } else { &[0.0] };
            for &x in places {
                let at = [x * r, 0.0, plane.z(1.0)];
                let profile = [
                    [0.7 * size, -0.5],
                    [0.7 * size, 0.4],
                    [0.85 * size, 0.4],
                    [1.05 * size, 0.05],
                    [1.05 * size, -0.5],
                ];
                let nozzle = solid::turned_ring(&profile, 20, at, [0.0, 0.0, -1.0]);
                all.add("nozzle", nozzle, DARK);
                let glow = [[0.0, -0.4], [0.72 * size, -0.4], [0.72 * size, 0.1], [0.0, 0.1]];
                let fire = solid::turned(&glow, 16, at, [0.0, 0.0, -1.0]);
                all.add("exhaust", fire, [0.45, 0.24, 0.14]);
            }
            // Air intakes beside the fuselage.
            let half = plane.at(0.42)[0];
            let at = [0.88 * half, -0.05 * r, plane.z(0.44)];
            all.pair(
                "intake",
                solid::rounded_block(at, [0.5 * r, 0.75 * r, 2.0], 0.12),
                colors.wing,
            );
            let mouth = add(at, [0.0, 0.0, 1.0]);
            all.pair("intake", solid::block(mouth, [0.38 * r, 0.6 * r, 0.05]), DARK);
        }
    }
    arrangement
}

/// The plate between a wing and the engine under it.
fn pylon(wing: Point, engine: Point, size: f64) -> TriMesh {
    let (front, back) = (engine[2] - 0.4 * size, wing[2] - 0.2);
    let outline = [
        [front, engine[1] + 0.5 * size],
        [back, engine[1] + 0.5 * size],
        [back - 0.6, wing[1]],
        [wing[2] + 0.35, wing[1] + 0.03],
    ];
    solid::side_prism(&outline, [engine[0] - 0.09 * size - 0.02, engine[0] + 0.09 * size + 0.02])
}

/// A pair of jet engines; `at` is the middle of the left one's mouth.
fn jet(all: &mut Assembly, at: Point, size: f64, color: [f32; 3]) {
    nacelle(all, at, size, 3.2 * size, color, true);
}

fn nacelle(all: &mut Assembly, at: Point, r: f64, long: f64, color: [f32; 3], both: bool) {
    let axis = [0.0, 0.0, 1.0];
    // A shell with a hole, so that the mouth is open.
    let section = [
        [0.78 * r, 0.0],
        [0.9 * r, 0.05 * r],
        [1.0 * r, -0.15 * r],
        [1.04 * r, -0.35 * long],
        [0.92 * r, -0.7 * long],
        [0.72 * r, -long],
        [0.6 * r, -long],
        [0.78 * r, -0.5 * long],
    ];
    let mut add_both = |name, mesh: TriMesh, color| {
        if both { all.pair(name, mesh, color) } else { all.add(name, mesh, color) }
    };
    add_both("nacelle", solid::turned_ring(&section, 24, at, axis), color);
    let lip =
        [[0.76 * r, -0.02 * r], [0.83 * r, 0.07 * r], [0.93 * r, 0.05 * r], [0.9 * r, -0.1 * r]];
    add_both("lip", solid::turned_ring(&lip, 24, at, axis), METAL);
    let core = [
        [0.0, -1.12 * long],
        [0.18 * r, -1.08 * long],
        [0.45 * r, -0.95 * long],
        [0.8 * r, -0.55 * long],
        [0.84 * r, -0.16 * long],
        [0.28 * r, -0.14 * long],
        [0.0, 0.0],
    ];
    add_both("fan", solid::turned(&core, 18, at, axis), DARK);
}

/// A propeller with its spinner at the nose.
fn propeller(all: &mut Assembly, draw: &mut Draw, hub: Point, reach: f64, colors: &Colors) {
    let count = draw.count(2, 4);
    let spin = draw.within(0.0, PI);
    blades(all, hub, 1.25 * reach, (count, spin), colors);
}

fn blades(
    all: &mut Assembly,
    hub: Point,
    reach: f64,
    (count, spin): (usize, f64),
    colors: &Colors,
) {
    let r = 0.17 * reach;
    let spinner =
        [[0.0, -0.1], [1.15 * r, -0.1], [1.1 * r, 0.5 * r], [0.7 * r, 1.5 * r], [0.0, 2.1 * r]];
    all.add("spinner", solid::turned(&spinner, 14, hub, [0.0, 0.0, 1.0]), colors.accent);
    for k in 0..count {
        let outline = [
            [-0.05, 0.05],
            [0.05, 0.05],
            [0.1, 0.4],
            [0.09, 0.85],
            [0.05, 0.98],
            [-0.04, 1.0],
            [-0.08, 0.9],
            [-0.08, 0.4],
        ]
        .map(|[x, y]| [x * reach, y * reach]);
        let thick = 0.035;
        let blade = solid::front_prism(&outline, [-thick, thick]);
        let blade = solid::rotated(blade, [0.0; 3], [0.0, 1.0, 0.0], 0.45);
        let angle = spin + TAU * k as f64 / count as f64;
        let blade = solid::rotated(blade, [0.0; 3], [0.0, 0.0, 1.0], angle);
        let place = add(hub, [0.0, 0.0, 0.4 * r]).map(|v| v as f32);
        all.add("blade", blade.translated(place), DARK);
    }
}
