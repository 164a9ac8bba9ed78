//! What is on the roof of a bus.

use super::super::assembly::Assembly;
use super::super::draw::Draw;
use super::super::solid;
use super::plan::{AMBER, Bus, RED, Stretch, Style, TRIM};

/// Adds what is on the roof; returns its name.
pub(super) fn roof(
    all: &mut Assembly,
    bus: &Bus,
    draw: &mut Draw,
    stretches: &[Stretch],
) -> &'static str {
    let kind = match bus.style {
        Style::School => "beacons",
        Style::DoubleDecker => draw.pick(&["bare", "hatches"]),
        Style::Minibus => draw.pick(&["bare", "cooler", "rack"]),
        _ => draw.pick(&["hatches", "cooler", "tanks"]),
    };
    let h = bus.height;
    for stretch in stretches {
        let (r, f) = (stretch.rear, stretch.front - bus.bonnet[0]);
        let at = |share: f64, up: f64| [0.0, h + up, r + (f - r) * share];
        match kind {
            "hatches" => {
                for share in [0.3, 0.7] {
                    let hatch = solid::rounded_block(at(share, 0.02), [0.8, 0.14, 0.8], 0.05);
                    all.add("hatch", hatch, [0.8, 0.81, 0.82]);
                }
            }
            "cooler" => {
                let size = [1.35 * bus.half, 0.36, (0.3 * (f - r)).min(2.6)];
                let box_ = solid::rounded_block(at(0.38, 0.1), size, 0.12);
                all.add("cooler", box_, [0.86, 0.87, 0.87]);
            }
            "tanks" => {
                let size = [1.5 * bus.half, 0.42, 0.5 * (f - r)];
                let fairing = solid::rounded_block(at(0.62, 0.12), size, 0.16);
                all.add("tanks", fairing, [0.9, 0.9, 0.9]);
            }
            "rack" => {
                let z = [r + 0.25 * (f - r), r + 0.75 * (f - r)];
                let x = 0.7 * bus.half;
                all.pair(
                    "rail",
                    solid::bar(&[[x, h + 0.1, z[0]], [x, h + 0.1, z[1]]], 0.04, 1, 8),
                    TRIM,
                );
                for k in 0..4 {
                    let z = z[0] + (z[1] - z[0]) * f64::from(k) / 3.0;
                    let path =
                        [[-x, h - 0.1, z], [-x, h + 0.1, z], [x, h + 0.1, z], [x, h - 0.1, z]];
                    for pair in path.windows(2) {
                        all.add("bar", solid::bar(&[pair[0], pair[1]], 0.035, 1, 8), TRIM);
                    }
                }
            }
            "beacons" => {
                for share in [0.02, 0.97] {
                    let z = if share < 0.5 { r + 0.06 } else { bus.face(h - 0.15) - 0.02 };
                    for (x, color) in [(0.62, AMBER), (0.82, RED)] {
                        let lamp = solid::ellipsoid(
                            [x * bus.half - 0.12, h - 0.16, z],
                            [0.1, 0.1, 0.07],
                            8,
                        );
                        all.pair("beacon", lamp, color);
                    }
                }
            }
            _ => {}
        }
    }
    kind
}
