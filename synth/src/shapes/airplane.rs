//! Airplanes: airliners, business jets, propeller planes, fighters.

mod engine;
mod wing;

use std::f64::consts::{PI, TAU};

use mesh_core::TriMesh;

use super::assembly::Assembly;
use super::draw::Draw;
use super::solid::{self, Point, add};
use super::{Family, Shape};

const GLASS: [f32; 3] = [0.12, 0.16, 0.21];
const METAL: [f32; 3] = [0.68, 0.69, 0.71];
const DARK: [f32; 3] = [0.13, 0.13, 0.14];
const WHITE: [f32; 3] = [0.95, 0.95, 0.94];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Style {
    Airliner,
    Jumbo,
    Business,
    Propeller,
    Turboprop,
    Fighter,
}

impl Style {
    const ALL: [Self; 6] = [
        Self::Airliner,
        Self::Jumbo,
        Self::Business,
        Self::Propeller,
        Self::Turboprop,
        Self::Fighter,
    ];

    fn name(self) -> &'static str {
        match self {
            Self::Airliner => "airliner",
            Self::Jumbo => "jumbo",
            Self::Business => "business jet",
            Self::Propeller => "propeller",
            Self::Turboprop => "turboprop",
            Self::Fighter => "fighter",
        }
    }
}

/// The fuselage's cross-section at a share of its length from the nose.
#[derive(Clone, Copy)]
struct Cut {
    share: f64,
    half: f64,
    top: f64,
    bottom: f64,
}

/// The lines of an airplane, metres; the fuselage's middle is at the origin.
struct Plane {
    length: f64,
    radius: f64,
    cuts: Vec<Cut>,
}

impl Plane {
    fn draw(draw: &mut Draw, style: Style) -> Self {
        let [slender, hump] = match style {
            Style::Airliner => [draw.within(9.5, 12.0), 0.0],
            Style::Jumbo => [draw.within(9.0, 10.0), draw.pick(&[0.55, 0.75])],
            Style::Business => [draw.within(7.5, 9.0), 0.0],
            Style::Propeller => [draw.within(5.6, 6.8), 0.0],
            Style::Turboprop => [draw.within(8.8, 10.5), 0.0],
            Style::Fighter => [draw.within(9.0, 11.0), 0.0],
        };
        let length = 10.0;
        let r = length / slender;
        // Share of the length, half width, top and bottom, in radii.
        let profile: &[[f64; 4]] = match style {
            Style::Propeller => &[
                [0.0, 0.45, 0.35, -0.45],
                [0.02, 0.7, 0.5, -0.65],
                [0.12, 0.85, 0.6, -0.85],
                [0.24, 0.95, 0.68, -0.95],
                [0.29, 1.0, 0.95, -0.98],
                [0.36, 1.0, 1.25, -1.0],
                [0.46, 0.98, 1.28, -1.0],
                [0.58, 0.8, 0.9, -0.8],
                [0.72, 0.5, 0.55, -0.45],
                [0.9, 0.2, 0.35, -0.05],
                [1.0, 0.06, 0.25, 0.08],
            ],
            Style::Fighter => &[
                [0.0, 0.03, 0.0, -0.06],
                [0.06, 0.24, 0.18, -0.26],
                [0.16, 0.48, 0.42, -0.5],
                [0.3, 0.7, 0.62, -0.7],
                [0.42, 1.05, 0.68, -0.78],
                [0.6, 1.15, 0.66, -0.78],
                [0.85, 0.95, 0.55, -0.62],
                [0.97, 0.62, 0.45, -0.48],
                [1.0, 0.55, 0.4, -0.42],
            ],
            _ => &[
                [0.0, 0.04, -0.22, -0.3],
                [0.008, 0.25, 0.02, -0.5],
                [0.025, 0.48, 0.28, -0.68],
                [0.05, 0.7, 0.58, -0.84],
                [0.085, 0.88, 0.86, -0.95],
                [0.13, 0.98, 0.98, -1.0],
                [0.2, 1.0, 1.0, -1.0],
                [0.4, 1.0, 1.0, -1.0],
                [0.62, 1.0, 1.0, -1.0],
                [0.75, 0.9, 1.0, -0.72],
                [0.87, 0.58, 0.92, -0.12],
                [0.96, 0.27, 0.78, 0.34],
                [1.0, 0.07, 0.66, 0.5],
            ],
        };
        // A second deck over the front, or over all of the cabin.
        let raised = |share: f64| match hump {
            h if h > 0.7 => {
                0.42 * ((share - 0.03) / 0.1).clamp(0.0, 1.0) * (1.0 - share).min(0.4) / 0.4
            }
            h if h > 0.0 => {
                let up = ((share - 0.02) / 0.07).clamp(0.0, 1.0);
                let down = ((0.42 - share) / 0.16).clamp(0.0, 1.0);
                0.5 * up.min(1.0) * down * down * (3.0 - 2.0 * down)
            }
            _ => 0.0,
        };
        let mut shares: Vec<f64> = profile.iter().map(|p| p[0]).collect();
        shares.extend([0.28, 0.34, 0.5]);
        shares.sort_by(f64::total_cmp);
        shares.dedup_by(|a, b| (*a - *b).abs() < 0.015);
        let cuts = shares
            .into_iter()
            .map(|share| {
                let [half, top, bottom] = read(profile, share);
                Cut { share, half: half * r, top: (top + raised(share)) * r, bottom: bottom * r }
            })
            .collect();
        Self { length, radius: r, cuts }
    }

    fn z(&self, share: f64) -> f64 {
        (0.5 - share) * self.length
    }

    /// Half width, top, bottom at a share of the length.
    fn at(&self, share: f64) -> [f64; 3] {
        let table: Vec<[f64; 4]> =
            self.cuts.iter().map(|c| [c.share, c.half, c.top, c.bottom]).collect();
        read(&table, share)
    }

    /// The skin at a share of the length and an angle up from the left side.
    fn skin(&self, share: f64, angle: f64) -> Point {
        let [half, top, bottom] = self.at(share);
        let middle = middle(top, bottom);
        let (sin, cos) = angle.sin_cos();
        let rise = if sin > 0.0 { top - middle } else { middle - bottom };
        [half * cos, middle + rise * sin, self.z(share)]
    }

    fn fuselage(&self) -> TriMesh {
        let ring = |cut: &Cut| -> Vec<Point> {
            (0..32).map(|k| self.skin(cut.share, TAU * f64::from(k) / 32.0)).collect()
        };
        solid::loft(&self.cuts.iter().map(ring).collect::<Vec<_>>())
    }

    /// A sheet on the left side: between two shares of the length and two angles.
    fn sheet(&self, shares: [f64; 2], angles: [f64; 2], grid: [usize; 2]) -> TriMesh {
        let surface = |u: f64, v: f64| {
            let share = shares[0] + (shares[1] - shares[0]) * u;
            self.skin(share, angles[0] + (angles[1] - angles[0]) * v)
        };
        solid::plate(surface, grid, [0.03, 0.018])
    }
}

/// Where the two halves of a cross-section meet.
fn middle(top: f64, bottom: f64) -> f64 {
    bottom + (top - bottom) * 0.48
}

/// Reads a table of `[share, a, b, c]` between its rows.
fn read(table: &[[f64; 4]], share: f64) -> [f64; 3] {
    let k = table.windows(2).position(|w| share <= w[1][0]).unwrap_or(table.len() - 2);
    let (a, b) = (table[k], table[k + 1]);
    let t = ((share - a[0]) / (b[0] - a[0])).clamp(0.0, 1.0);
    [1, 2, 3].map(|i| a[i] + (b[i] - a[i]) * t)
}

struct Colors {
    body: [f32; 3],
    accent: [f32; 3],
    wing: [f32; 3],
    livery: &'static str,
}

pub(super) fn draw(seed: u64) -> Shape {
    let mut draw = Draw::new(seed, 1);
    let style = draw.pick(&Style::ALL);
    let plane = Plane::draw(&mut draw, style);
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
        ("style", style.name().to_owned()),
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
        let grey = draw.pick(&[
            [0.5, 0.53, 0.56],
            [0.36, 0.4, 0.36],
            [0.64, 0.58, 0.46],
            [0.3, 0.34, 0.4],
        ]);
        let livery = draw.pick(&["plain", "belly", "tail"]);
        let accent = if livery == "belly" { grey.map(|v: f32| (v * 1.4).min(0.9)) } else { accent };
        return Colors { body: grey, accent, wing: grey.map(|v| 0.93 * v), livery };
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
            all.add("canopy", solid::ball([0.0, top - 0.05, z], radii, 14), GLASS);
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
