//! What keeps off the wind, and the bodywork of scooters.

use std::f64::consts::PI;

use super::super::assembly::Assembly;
use super::super::draw::Draw;
use super::super::solid::{self, Point, add};
use super::plan::{Bike, DARK, ENGINE, GLASS, LIGHT, RED, STEEL, Style, X, hull};

/// Adds what keeps off the wind; returns its kind.
pub(super) fn fairing(all: &mut Assembly, b: &Bike, draw: &mut Draw) -> &'static str {
    let [_, y, z] = b.head;
    let screen = |all: &mut Assembly, base: Point, half: f64, rise: [f64; 2]| {
        let surface = |u: f64, v: f64| {
            let across = 2.0 * u - 1.0;
            let narrow = half * (1.0 - 0.35 * v * v);
            let back = rise[1] * v + 0.13 * across * across;
            add(base, [narrow * across, rise[0] * v, -back])
        };
        all.add("screen", solid::plate(surface, [8, 5], [0.006, 0.006]), GLASS);
    };
    match b.style {
        Style::Sport => {
            let nose = [
                [z + 0.37, y - 0.13, 0.03, 0.03],
                [z + 0.34, y - 0.12, 0.1, 0.075],
                [z + 0.24, y - 0.09, 0.17, 0.115],
                [z + 0.1, y - 0.08, 0.2, 0.12],
                [z - 0.02, y - 0.1, 0.2, 0.1],
            ];
            all.add("nose", hull(&nose, 2.6), b.paint);
            screen(all, [0.0, y - 0.01, z + 0.27], 0.15, [0.2, 0.24]);
            let eye = solid::rounded_block([0.075, y - 0.115, z + 0.315], [0.11, 0.05, 0.1], 0.02);
            let eye = solid::rotated(eye, [0.075, y - 0.115, z + 0.3], [0.0, 1.0, 0.0], 0.45);
            all.pair("headlight", eye, LIGHT);
            // Side panels down to a belly pan, open between for the wheel.
            let outline = [
                [z + 0.2, y - 0.1],
                [z - 0.1, y - 0.06],
                [z - 0.32, 0.56],
                [z - 0.42, 0.32],
                [-0.32, 0.2],
                [-0.22, 0.14],
                [0.1, 0.14],
                [z - 0.18, 0.3],
                [z - 0.08, 0.5],
            ];
            all.pair("side fairing", solid::side_prism(&outline, [0.165, 0.2]), b.paint);
            let vent = [[z - 0.06, 0.62], [z - 0.18, 0.66], [z - 0.3, 0.46], [z - 0.2, 0.4]];
            all.pair("vent", solid::side_prism(&vent, [0.16, 0.21]), DARK);
            if b.accent != b.paint {
                let slash = [[-0.2, 0.17], [0.08, 0.17], [z - 0.22, 0.34], [-0.1, 0.27]];
                all.pair("slash", solid::side_prism(&slash, [0.16, 0.21]), b.accent);
            }
            let belly = solid::rounded_block([0.0, 0.17, -0.08], [0.38, 0.08, 0.4], 0.03);
            all.add("belly", belly, b.paint);
            let tip = [0.3, y + 0.05, z + 0.15];
            all.pair(
                "mirror arm",
                solid::bar(&[[0.15, y - 0.06, z + 0.18], tip], 0.012, 1, 8),
                DARK,
            );
            all.pair("mirror", solid::ellipsoid(tip, [0.07, 0.04, 0.03], 8), b.paint);
            "full fairing"
        }
        Style::Touring => {
            let nose = [
                [z + 0.36, y - 0.05, 0.05, 0.05],
                [z + 0.33, y - 0.04, 0.15, 0.11],
                [z + 0.22, y, 0.23, 0.16],
                [z + 0.06, y - 0.01, 0.25, 0.16],
                [z + 0.0, y - 0.02, 0.24, 0.14],
            ];
            all.add("nose", hull(&nose, 2.8), b.paint);
            screen(all, [0.0, y + 0.1, z + 0.28], 0.22, [0.34, 0.2]);
            let lamp = solid::rounded_block([0.0, y - 0.05, z + 0.33], [0.2, 0.1, 0.1], 0.04);
            all.add("headlight", lamp, LIGHT);
            "half fairing"
        }
        Style::Dirt => {
            let board = [
                [-0.1, -0.13],
                [0.1, -0.13],
                [0.12, 0.08],
                [0.05, 0.12],
                [-0.05, 0.12],
                [-0.12, 0.08],
            ];
            let plate = solid::front_prism(&board, [0.0, 0.03]);
            let plate = solid::rotated(plate, [0.0; 3], X, -0.35);
            let at = add(b.head, [0.0, -0.02, 0.1]).map(|v| v as f32);
            all.add("number plate", plate.translated(at), b.accent);
            let lamp = solid::ellipsoid(add(b.head, [0.0, -0.06, 0.13]), [0.06, 0.05, 0.04], 8);
            all.add("headlight", lamp, LIGHT);
            let wing = [
                [z - 0.02, y - 0.02],
                [z - 0.32, y - 0.08],
                [z - 0.3, y - 0.2],
                [z - 0.06, y - 0.33],
            ];
            all.pair("shroud", solid::side_prism(&wing, [0.1, 0.14]), b.paint);
            "none"
        }
        Style::Scooter => {
            let high = draw.chance(0.5);
            if high {
                screen(all, [0.0, y + 0.1, z + 0.1], 0.2, [0.34, 0.12]);
            }
            if high { "windscreen" } else { "none" }
        }
        Style::Cruiser if draw.chance(0.4) => {
            screen(all, [0.0, y + 0.05, z + 0.17], 0.24, [0.42, 0.16]);
            "windscreen"
        }
        Style::Naked if draw.chance(0.4) => {
            screen(all, [0.0, y + 0.03, z + 0.18], 0.13, [0.15, 0.1]);
            "flyscreen"
        }
        _ => "none",
    }
}

/// The bodywork of a scooter; returns its engine and its one exhaust.
pub(super) fn scooter(all: &mut Assembly, b: &Bike, draw: &mut Draw) -> (&'static str, usize) {
    let [_, y, z] = b.head;
    let tail = b.rear[2];
    let floor = [0.0, 0.24, 0.06];
    all.add("floor", solid::rounded_block(floor, [0.36, 0.09, 0.56], 0.04), b.paint);
    let mat = [0.0, 0.29, 0.06];
    all.add("mat", solid::rounded_block(mat, [0.3, 0.02, 0.4], 0.008), DARK);
    // The shield before the knees: bent across, leaning with the fork.
    let foot = z + 0.03;
    let shield = |u: f64, v: f64| {
        let across = 2.0 * u - 1.0;
        let half = 0.19 + 0.05 * (PI * v).sin();
        let lean = foot - 0.02 + 0.09 * (1.0 - v) - 0.07 * across * across;
        [half * across, 0.2 + (y - 0.12) * v, lean]
    };
    all.add("shield", solid::plate(shield, [8, 10], [0.02, 0.02]), b.paint);
    let nose = [
        [foot + 0.16, 0.55, 0.03, 0.1],
        [foot + 0.12, 0.56, 0.07, 0.17],
        [foot + 0.05, 0.57, 0.1, 0.22],
        [foot - 0.02, 0.58, 0.1, 0.22],
    ];
    all.add("nose", hull(&nose, 2.4), b.accent);
    let body = [
        [-0.14, 0.42, 0.13, 0.2],
        [-0.2, 0.45, 0.16, 0.22],
        [-0.4, 0.48, 0.19, 0.2],
        [tail + 0.05, 0.53, 0.18, 0.16],
        [tail - 0.15, 0.58, 0.13, 0.11],
        [tail - 0.27, 0.61, 0.06, 0.05],
    ];
    all.add("body", hull(&body, 2.8), b.paint);
    let s = b.seat;
    let leather = draw.pick(&[DARK, [0.42, 0.25, 0.14], [0.85, 0.8, 0.7]]);
    let seat = [
        [-0.1, s - 0.06, 0.06, 0.05],
        [-0.2, s - 0.05, 0.12, 0.06],
        [-0.4, s - 0.04, 0.15, 0.065],
        [tail - 0.02, s - 0.01, 0.14, 0.065],
        [tail - 0.18, s, 0.08, 0.045],
    ];
    all.add("seat", hull(&seat, 3.0), leather);
    let engine = [0.0, 0.27, tail + 0.12];
    all.add("engine", solid::rounded_block(engine, [0.3, 0.2, 0.42], 0.07), ENGINE);
    let pipe = [[-0.17, 0.2, tail + 0.3], [-0.2, 0.24, tail - 0.22]];
    all.add("muffler", solid::rod(pipe[0], pipe[1], [0.04, 0.06], 14), STEEL);
    let cover = [
        [z + 0.13, y + 0.03, 0.05, 0.05],
        [z + 0.09, y + 0.03, 0.11, 0.085],
        [z - 0.02, y + 0.05, 0.13, 0.08],
        [z - 0.1, y + 0.05, 0.08, 0.05],
    ];
    all.add("handlebar cover", hull(&cover, 2.5), b.paint);
    let lamp = [[0.0, -0.05], [0.075, -0.05], [0.075, 0.02], [0.03, 0.035], [0.0, 0.037]];
    let at = [0.0, y + 0.03, z + 0.12];
    all.add("headlight", solid::turned(&lamp, 18, at, [0.0, 0.0, 1.0]), LIGHT);
    let lamp = solid::rounded_block([0.0, 0.61, tail - 0.27], [0.14, 0.07, 0.05], 0.02);
    all.add("tail light", lamp, RED);
    let plate = [0.0, 0.46, tail - 0.27];
    all.add("plate", solid::block(plate, [0.17, 0.12, 0.02]), [0.92, 0.92, 0.9]);
    let holder = [[0.0, 0.6, tail - 0.22], [0.0, 0.44, tail - 0.265]];
    all.add("plate holder", solid::rod(holder[0], holder[1], [0.02; 2], 8), DARK);
    ("hidden", 1)
}
