//! Airplanes: airliners, business jets, propeller planes, fighters.

mod engine;
mod plan;
mod wing;

use std::f64::consts::PI;

use super::assembly::Assembly;
use super::draw::Draw;
use super::family::Family;
use super::shape::Shape;
use super::solid::{self, Point, add};
use plan::{Colors, DARK, GLASS, METAL, Plane, STYLES, Style, WHITE};

pub(super) fn draw(seed: u64) -> Shape {
    let mut draw = Draw::new(seed, 1);
    let (style, name, slender) = draw.pick(&STYLES);
    let plane = Plane::draw(&mut draw, style, slender);
    let colors = paint(&mut draw, style);
    let mut all = Assembly::default();
    if colors.livery == "belly" {
        all.painted("fuselage", plane.fuselage(), |p| {
            if p[1] < -0.35 * plane.radius { colors.accent } else { colors.body }
        });
    } else {
        all.add("fuselage", plane.fuselage(), colors.body);
    }
    let (wing, planform, mount) = wing::wings(&mut all, &plane, &mut draw, style, &colors);
    let engines = engine::engines(&mut all, &plane, &mut draw, style, (&wing, &colors));
    let tail = wing::tail(&mut all, &plane, &mut draw, (style, engines), &colors);
    livery(&mut all, &plane, &colors);
    windows(&mut all, &plane, style);
    let gear = match style {
        Style::Propeller => draw.pick(&["tricycle", "tricycle", "floats"]),
        _ => draw.pick(&["up", "up", "tricycle"]),
    };
    landing_gear(&mut all, &plane, gear, style);
    let traits = vec![
        ("style", name.to_owned()),
        ("wing", planform.to_owned()),
        ("mount", mount.to_owned()),
        ("engines", engines.to_owned()),
        ("tail", tail.to_owned()),
        ("gear", gear.to_owned()),
        ("livery", colors.livery.to_owned()),
    ];
    all.finish(Family::Airplane, seed, traits)
}

fn paint(draw: &mut Draw, style: Style) -> Colors {
    let accent = draw.color([0.7, 0.95], [0.45, 0.9]);
    if style == Style::Fighter {
        let gray = draw.pick(&[
            [0.5, 0.53, 0.56],
            [0.36, 0.4, 0.36],
            [0.64, 0.58, 0.46],
            [0.3, 0.34, 0.4],
        ]);
        let livery = draw.pick(&["plain", "belly", "tail"]);
        let accent = if livery == "belly" { gray.map(|v: f32| (v * 1.4).min(0.9)) } else { accent };
        return Colors { body: gray, accent, wing: gray.map(|v| 0.93 * v), livery };
    }
    let livery = draw.pick(&["plain", "stripe", "stripes", "belly", "tail"]);
    let body = match livery {
        "plain" if draw.chance(0.5) => draw.color([0.5, 0.9], [0.6, 0.9]),
        _ => draw.pick(&[WHITE, WHITE, [0.86, 0.87, 0.88], [0.96, 0.93, 0.84]]),
    };
    let wing =
        if style == Style::Propeller { body } else { draw.pick(&[METAL, [0.8, 0.81, 0.82], body]) };
    Colors { body, accent, wing, livery }
}

fn livery(all: &mut Assembly, plane: &Plane, colors: &Colors) {
    let bands: &[[f64; 2]] = match colors.livery {
        "stripe" => &[[-0.22, 0.02]],
        "stripes" => &[[-0.2, -0.08], [-0.4, -0.28]],
        _ => &[],
    };
    for &angles in bands {
        all.pair("stripe", plane.sheet([0.06, 0.95], angles, [24, 2]), colors.accent);
    }
    if colors.livery == "tail" {
        all.pair(
            "tail paint",
            plane.sheet([0.76, 0.97], [-0.5 * PI, 0.5 * PI], [6, 14]),
            colors.accent,
        );
    }
}

fn windows(all: &mut Assembly, plane: &Plane, style: Style) {
    let mut row = |from: f64, to: f64, count: usize, [low, high]: [f64; 2], fill: f64| {
        let step = (to - from) / count as f64;
        for k in 0..count {
            let a = from + step * (k as f64 + 0.5 * (1.0 - fill));
            let grid = if high - low > 0.4 { [3, 8] } else { [1, 1] };
            let pane = plane.sheet([a, a + step * fill], [low, high], grid);
            all.pair("window", pane, GLASS);
        }
    };
    match style {
        Style::Airliner | Style::Turboprop => row(0.13, 0.8, 26, [0.2, 0.42], 0.5),
        Style::Jumbo => {
            row(0.13, 0.8, 28, [0.08, 0.24], 0.5);
            row(0.11, 0.34, 10, [0.6, 0.76], 0.5);
        }
        Style::Business => row(0.19, 0.5, 6, [0.15, 0.45], 0.55),
        Style::Propeller => row(0.37, 0.52, 2, [0.3, 0.85], 0.85),
        Style::Fighter => {}
    }
    match style {
        Style::Fighter => {
            // A bubble over the cockpit.
            let z = plane.z(0.25);
            let top = plane.at(0.25)[1];
            let radii = [0.4 * plane.radius, 0.48 * plane.radius, 0.85];
            all.add("canopy", solid::ellipsoid([0.0, top - 0.05, z], radii, 14), GLASS);
        }
        Style::Propeller => {
            all.pair(
                "windscreen",
                plane.sheet([0.285, 0.355], [0.55, 0.5 * PI - 0.06], [2, 6]),
                GLASS,
            );
        }
        _ => {
            all.pair(
                "windscreen",
                plane.sheet([0.042, 0.082], [0.95, 0.5 * PI - 0.04], [3, 5]),
                GLASS,
            );
            all.pair("windscreen", plane.sheet([0.05, 0.09], [0.5, 0.88], [3, 3]), GLASS);
        }
    }
}

fn landing_gear(all: &mut Assembly, plane: &Plane, gear: &str, style: Style) {
    let r = plane.radius;
    let low = match style {
        Style::Propeller => -1.75 * r,
        Style::Fighter => -1.6 * r,
        _ => -1.85 * r,
    };
    let size = 0.24 * r + if style == Style::Propeller { 0.1 * r } else { 0.0 };
    match gear {
        "tricycle" => {
            let nose = 0.12;
            for (x, share) in [(0.0, nose), (0.62 * r, 0.5), (-0.62 * r, 0.5)] {
                let z = plane.z(share);
                let top = [0.7 * x, plane.at(share)[2] + 0.25 * r, z];
                let foot = [x, low + size, z];
                all.add("leg", solid::rod(top, foot, [0.085, 0.075], 8), METAL);
                let sides: &[f64] = if style == Style::Propeller { &[0.0] } else { &[-0.14, 0.14] };
                for side in sides {
                    let at = add(foot, [side * r * 1.3, 0.0, 0.0]);
                    let h = 0.32 * size;
                    let profile = [
                        [0.0, -h],
                        [0.75 * size, -h],
                        [size, -0.5 * h],
                        [size, 0.5 * h],
                        [0.75 * size, h],
                        [0.0, h],
                    ];
                    all.add("tyre", solid::turned(&profile, 16, at, [1.0, 0.0, 0.0]), DARK);
                }
            }
        }
        "floats" => {
            let x = 0.95 * r;
            let rings: Vec<Vec<Point>> = [
                (0.07, 0.12, 0.35),
                (0.1, 0.22, 0.22),
                (0.2, 0.32, 0.04),
                (0.4, 0.34, 0.0),
                (0.6, 0.26, 0.05),
                (0.74, 0.08, 0.25),
            ]
            .iter()
            .map(|&(share, half, lift)| {
                let ring = solid::superellipse([half * r, 0.3 * r * (1.0 - lift)], 3.0, 14);
                let y = low + 0.15 * r + 0.3 * lift * r;
                ring.into_iter().map(|[a, b]| [x + a, y + b, plane.z(share)]).collect()
            })
            .collect();
            all.pair("float", solid::loft(&rings), METAL);
            for share in [0.24, 0.5] {
                let z = plane.z(share);
                let top = [0.5 * r, plane.at(share)[2] + 0.3 * r, z];
                all.pair("strut", solid::rod(top, [x, low + 0.3 * r, z], [0.075; 2], 8), METAL);
            }
            let z = plane.z(0.24);
            all.add(
                "spreader",
                solid::rod([-x, low + 0.2 * r, z], [x, low + 0.2 * r, z], [0.06; 2], 8),
                METAL,
            );
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::check;
    use super::*;

    #[test]
    fn airplanes_are_sound_and_differ() {
        check(
            Family::Airplane,
            &[
                (
                    "style",
                    &["airliner", "jumbo", "business jet", "propeller", "turboprop", "fighter"],
                ),
                ("wing", &["swept", "straight", "tapered", "delta"]),
                ("mount", &["low", "high", "middle"]),
                (
                    "engines",
                    &[
                        "1 at nose",
                        "2 under wings",
                        "4 under wings",
                        "2 at rear",
                        "3 at rear",
                        "2 on wings",
                        "4 on wings",
                        "1 inside",
                        "2 inside",
                    ],
                ),
                ("tail", &["conventional", "T", "V", "twin", "cruciform"]),
                ("gear", &["up", "tricycle", "floats"]),
                ("livery", &["plain", "stripe", "stripes", "belly", "tail"]),
            ],
        );
    }
}
