//! What an airplane flies and steers with.

use mesh_core::TriMesh;

use super::super::assembly::Assembly;
use super::super::draw::Draw;
use super::super::solid::{self, Point, add};
use super::plan::{Colors, Plane, Style, WHITE};

/// A wing or fin as a tapered plate with a rounded leading edge.
pub(super) struct Wing {
    /// The middle of the root's leading edge.
    pub(super) root: Point,
    /// Where the tip's leading edge is, from there.
    pub(super) span: Point,
    pub(super) chords: [f64; 2],
    /// Thickness as a share of the chord.
    pub(super) thick: f64,
}

impl Wing {
    pub(super) fn build(&self) -> TriMesh {
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
    pub(super) fn at(&self, share: f64, back: f64) -> Point {
        let chord = self.chords[0] + (self.chords[1] - self.chords[0]) * share;
        add(add(self.root, solid::scale(self.span, share)), [0.0, 0.0, -back * chord])
    }
}

/// Adds both wings; returns one of them, its plan and where it is mounted.
pub(super) fn wings(
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

/// Adds fins and stabilisers; returns their arrangement.
pub(super) fn tail(
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
