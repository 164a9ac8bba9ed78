//! Airplanes: airliners, business jets, propeller planes, fighters.

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

/// A wing or fin as a tapered plate with a rounded leading edge.
struct Wing {
    /// The middle of the root's leading edge.
    root: Point,
    /// Where the tip's leading edge is, from there.
    span: Point,
    chords: [f64; 2],
    /// Thickness as a share of the chord.
    thick: f64,
}

impl Wing {
    fn build(&self) -> TriMesh {
        // Across the wing, at right angles to span and chord.
        let flat = [0.0, 0.0, self.span[2]];
        let out = solid::unit(solid::sub(self.span, flat));
        let normal = [-out[1], out[0], 0.0];
        let profile: [[f64; 2]; 10] = [
            [0.0, 0.0],
            [0.03, 0.35],
            [0.15, 0.85],
            [0.38, 1.0],
            [0.7, 0.6],
            [1.0, 0.1],
            [1.0, -0.1],
            [0.7, -0.35],
            [0.3, -0.6],
            [0.04, -0.35],
        ];
        let section = |share: f64, shrink: f64| -> Vec<Point> {
            let chord = self.chords[0] + (self.chords[1] - self.chords[0]) * share;
            let lead = add(self.root, solid::scale(self.span, share));
            let thick = (0.5 * self.thick * chord).max(0.045) * shrink;
            profile
                .iter()
                .map(|&[back, up]| {
                    let back = 0.5 + (back - 0.5) * (0.6 + 0.4 * shrink);
                    add(add(lead, [0.0, 0.0, -back * chord]), solid::scale(normal, up * thick))
                })
                .collect()
        };
        let cuts = [(0.0, 1.0), (0.35, 1.0), (0.7, 1.0), (0.97, 1.0), (0.992, 0.75), (1.0, 0.3)];
        solid::loft(&cuts.map(|(share, shrink)| section(share, shrink)))
    }

    /// A point on the wing at a share of its span and its chord.
    fn at(&self, share: f64, back: f64) -> Point {
        let chord = self.chords[0] + (self.chords[1] - self.chords[0]) * share;
        add(add(self.root, solid::scale(self.span, share)), [0.0, 0.0, -back * chord])
    }
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
    let (wing, planform, mount) = wings(&mut all, &plane, &mut draw, style, &colors);
    let engines = engines(&mut all, &plane, &mut draw, style, (&wing, &colors));
    let tail = tail(&mut all, &plane, &mut draw, (style, engines), &colors);
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

/// Adds both wings; returns one of them, its plan and where it is mounted.
fn wings(
    all: &mut Assembly,
    plane: &Plane,
    draw: &mut Draw,
    style: Style,
    colors: &Colors,
) -> (Wing, &'static str, &'static str) {
    let (l, r) = (plane.length, plane.radius);
    let plan = match style {
        Style::Airliner | Style::Jumbo | Style::Business => "swept",
        Style::Fighter => draw.pick(&["delta", "swept"]),
        _ => draw.pick(&["straight", "tapered"]),
    };
    let mount = match style {
        Style::Propeller | Style::Turboprop => draw.pick(&["high", "low"]),
        Style::Airliner => draw.pick(&["low", "low", "low", "high"]),
        Style::Fighter => "middle",
        _ => "low",
    };
    // Half span, sweep and chords in lengths; dihedral in half spans; place of the root's front.
    let [span, sweep, root, tip, lift, place] = match (style, plan) {
        (Style::Fighter, "delta") => [draw.within(0.28, 0.34), 0.4, 0.5, 0.05, 0.0, 0.42],
        (Style::Fighter, _) => [draw.within(0.28, 0.35), 0.24, 0.3, 0.1, 0.0, 0.44],
        (_, "swept") => [draw.within(0.43, 0.53), draw.within(0.2, 0.28), 0.2, 0.06, 0.1, 0.33],
        (Style::Propeller, "straight") => [draw.within(0.6, 0.72), 0.0, 0.19, 0.18, 0.05, 0.27],
        (Style::Propeller, _) => [draw.within(0.6, 0.7), 0.04, 0.22, 0.12, 0.07, 0.26],
        (_, "straight") => [draw.within(0.5, 0.58), 0.01, 0.14, 0.11, 0.04, 0.37],
        _ => [draw.within(0.5, 0.6), 0.04, 0.16, 0.07, 0.05, 0.36],
    };
    let y = match mount {
        "high" => plane.at(place + 0.08)[1] - 0.06 * r,
        "low" => -0.62 * r,
        _ => -0.05 * r,
    };
    let lift = if mount == "high" { 0.2 * lift } else { lift };
    let half = span * l;
    let wing = Wing {
        root: [0.0, y, plane.z(place)],
        span: [half, lift * half, -sweep * l],
        chords: [root * l, tip * l],
        thick: if style == Style::Fighter { 0.05 } else { 0.11 },
    };
    all.pair("wing", wing.build(), colors.wing);
    let jet = matches!(style, Style::Airliner | Style::Business | Style::Jumbo);
    if jet && draw.chance(0.6) {
        let top = wing.at(0.985, 0.15);
        let winglet = Wing {
            root: top,
            span: [0.08 * half, 0.11 * half, -0.05 * l],
            chords: [0.85 * tip * l, 0.4 * tip * l],
            thick: 0.1,
        };
        all.pair("winglet", winglet.build(), colors.accent);
    }
    if style == Style::Propeller && mount == "high" {
        let foot = [0.9 * r * 0.95, -0.55 * r, wing.at(0.0, 0.35)[2]];
        let strut = solid::rod(foot, wing.at(0.45, 0.35), [0.07, 0.06], 8);
        all.pair("strut", strut, colors.wing);
    }
    if style == Style::Fighter {
        // Something under the wings, and at their tips.
        let tip = wing.at(0.99, 0.5);
        let (a, b) = (add(tip, [0.0, 0.0, 0.7]), add(tip, [0.0, 0.0, -0.7]));
        all.pair("missile", missile(a, b, 0.09), WHITE);
        for share in [0.45, 0.7] {
            let under = add(wing.at(share, 0.5), [0.0, -0.28, 0.0]);
            let (a, b) = (add(under, [0.0, 0.0, 0.75]), add(under, [0.0, 0.0, -0.65]));
            all.pair("missile", missile(a, b, 0.12), WHITE);
            let pylon = solid::block(add(under, [0.0, 0.16, 0.0]), [0.07, 0.3, 0.6]);
            all.pair("pylon", pylon, colors.wing);
        }
    }
    (wing, plan, mount)
}

fn missile(a: Point, b: Point, r: f64) -> TriMesh {
    let long = a[2] - b[2];
    let profile = [[0.0, 0.0], [r, 0.0], [r, 0.8 * long], [0.6 * r, 0.93 * long], [0.0, long]];
    solid::turned(&profile, 10, b, [0.0, 0.0, 1.0])
}

/// Adds the engines; returns their arrangement.
fn engines(
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

/// Adds fins and stabilisers; returns their arrangement.
fn tail(
    all: &mut Assembly,
    plane: &Plane,
    draw: &mut Draw,
    (style, engines): (Style, &str),
    colors: &Colors,
) -> &'static str {
    let l = plane.length;
    let kind = match style {
        Style::Fighter => draw.pick(&["twin", "conventional"]),
        Style::Propeller => draw.pick(&["conventional", "conventional", "V", "T"]),
        Style::Turboprop => draw.pick(&["conventional", "T"]),
        _ if engines == "3 at rear" => "cruciform",
        _ if engines.ends_with("rear") => "T",
        _ => "conventional",
    };
    let fin_color = if colors.livery == "plain" { colors.body } else { colors.accent };
    let chord = if style == Style::Fighter { 0.19 } else { 0.15 } * l;
    let tall = match style {
        Style::Fighter => 0.15,
        Style::Propeller => 0.155,
        _ => 0.17,
    } * l;
    let place = 0.985 - chord / l - 0.03;
    let top = plane.at(0.93)[1] - 0.1;
    let lean = if style == Style::Propeller { 0.06 } else { 0.115 } * l;
    let fin = |x: f64, out: f64| Wing {
        root: [x, top - 0.12, plane.z(place)],
        span: [out * tall, tall, -lean],
        chords: [chord, 0.5 * chord],
        thick: 0.09,
    };
    let level = |y: f64, place: f64, span: f64, rise: f64| Wing {
        root: [0.0, y, plane.z(place)],
        span: [span, rise * span, -0.5 * lean - 0.02 * l],
        chords: [0.8 * chord, 0.45 * chord],
        thick: 0.08,
    };
    let span = if style == Style::Propeller { 0.22 } else { 0.18 } * l;
    let [_, high, low] = plane.at(0.94);
    let center = 0.5 * (high + low);
    match kind {
        "V" => all.pair("ruddervator", fin(0.0, 0.95).build(), fin_color),
        "twin" => {
            let x = 0.75 * plane.at(0.9)[0];
            all.pair("fin", fin(x, 0.25).build(), fin_color);
            all.pair("stabiliser", level(center, 0.84, 0.2 * l, 0.0).build(), colors.wing);
        }
        "T" => {
            all.add("fin", fin(0.0, 0.0).build(), fin_color);
            let y = top + 0.93 * tall;
            let place = place + 0.85 * lean / l;
            let wing = level(y, place, 0.85 * span, 0.02);
            all.pair("stabiliser", wing.build(), colors.wing);
        }
        "cruciform" => {
            all.add("fin", fin(0.0, 0.0).build(), fin_color);
            let wing = level(top + 0.45 * tall, place + 0.45 * lean / l, 0.85 * span, 0.02);
            all.pair("stabiliser", wing.build(), colors.wing);
        }
        _ => {
            all.add("fin", fin(0.0, 0.0).build(), fin_color);
            let rise = if style == Style::Fighter { 0.0 } else { 0.08 };
            all.pair("stabiliser", level(center, place + 0.01, span, rise).build(), colors.wing);
        }
    }
    kind
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
            let pane = plane.sheet([a, a + step * fill], [low, high], [1, 1]);
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
