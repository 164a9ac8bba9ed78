//! Buses: city, double decker, articulated, coach, school bus, minibus.

mod livery;
mod openings;
mod roof;

use std::f64::consts::FRAC_PI_2;

use super::assembly::Assembly;
use super::coachwork::cut_arches;
use super::draw::Draw;
use super::solid::{self, Point};
use super::wheel::Wheel;
use super::{Family, Shape};
use openings::{door, doors, windows};

const GLASS: [f32; 3] = [0.12, 0.16, 0.20];
const TRIM: [f32; 3] = [0.11, 0.11, 0.12];
const WHITE: [f32; 3] = [0.94, 0.94, 0.92];
const AMBER: [f32; 3] = [0.98, 0.66, 0.12];
const RED: [f32; 3] = [0.78, 0.06, 0.06];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Style {
    City,
    DoubleDecker,
    Articulated,
    Coach,
    School,
    Minibus,
}

impl Style {
    const ALL: [Self; 6] = [
        Self::City,
        Self::DoubleDecker,
        Self::Articulated,
        Self::Coach,
        Self::School,
        Self::Minibus,
    ];

    fn name(self) -> &'static str {
        match self {
            Self::City => "city",
            Self::DoubleDecker => "double decker",
            Self::Articulated => "articulated",
            Self::Coach => "coach",
            Self::School => "school",
            Self::Minibus => "minibus",
        }
    }
}

/// The lines of a bus, metres.
struct Bus {
    style: Style,
    half: f64,
    front: f64,
    rear: f64,
    height: f64,
    ground: f64,
    wheel: f64,
    /// How far the windscreen leans back.
    lean: f64,
    /// How long and high the bonnet is; a bus without one has no length here.
    bonnet: [f64; 2],
    /// From the rear to the front.
    axles: Vec<f64>,
    /// Lower and upper edge of the side windows, deck by deck.
    decks: Vec<[f64; 2]>,
    /// Radii of the edges along the roof and at front and rear, seen from above.
    round: f64,
}

/// A stretch of bodywork from its rear to its front.
#[derive(Clone, Copy)]
struct Stretch {
    rear: f64,
    front: f64,
    /// Whether the ends are those of the bus, or joints.
    ends: [bool; 2],
}

impl Bus {
    fn draw(draw: &mut Draw, style: Style) -> Self {
        let [length, width, height, ground, wheel, lean] = match style {
            Style::City => [10.8, 2.5, 3.0, 0.3, 0.5, 0.16],
            Style::DoubleDecker => [9.6, 2.5, 4.35, 0.3, 0.5, 0.2],
            Style::Articulated => [15.5, 2.5, 3.05, 0.3, 0.5, 0.16],
            Style::Coach => [11.6, 2.5, 3.65, 0.35, 0.52, 0.6],
            Style::School => [9.4, 2.4, 3.1, 0.5, 0.5, 0.12],
            Style::Minibus => [6.4, 2.1, 2.75, 0.35, 0.4, 0.5],
        };
        let mut vary = |value: f64, share: f64| value * draw.within(1.0 - share, 1.0 + share);
        let (length, height, width) = (vary(length, 0.09), vary(height, 0.04), vary(width, 0.03));
        let (front, rear) = (0.5 * length, -0.5 * length);
        let (wheel, lean) = (vary(wheel, 0.05), vary(lean, 0.4));
        let bonnet = if style == Style::School { [vary(1.45, 0.15), 1.62] } else { [0.0, 0.0] };
        let round = 0.23 * vary(1.0, 0.3);
        let ahead = match style {
            Style::School => 1.15 * wheel + round + 0.16,
            Style::Minibus => 1.1,
            _ => vary(2.4, 0.08),
        };
        let mut axles = vec![rear + 0.24 * length, front - ahead];
        match style {
            Style::Articulated => axles = vec![rear + 2.6, rear + 0.5 * length, front - ahead],
            Style::Coach if draw.chance(0.5) => axles.insert(1, axles[0] + 1.3),
            _ => {}
        }
        let top = height - 0.42;
        let decks = match style {
            Style::DoubleDecker => {
                vec![[1.25, 0.5 * height - 0.12], [0.5 * height + 0.55, height - 0.42]]
            }
            Style::Coach => vec![[1.75, top]],
            Style::Minibus => vec![[1.25, top + 0.05]],
            Style::School => vec![[1.75, top - 0.05]],
            _ => vec![[1.25, top]],
        };
        Self {
            style,
            half: 0.5 * width,
            front,
            rear,
            height,
            ground,
            wheel,
            lean,
            bonnet,
            axles,
            decks,
            round,
        }
    }

    /// Where the windscreen begins, at the given height.
    fn face(&self, y: f64) -> f64 {
        let low = if self.bonnet[0] > 0.0 { self.bonnet[1] } else { self.sill() };
        let share = ((y - low) / (self.height - low)).max(0.0);
        self.front - self.bonnet[0] - self.lean * share
    }

    /// Lower edge of the windscreen.
    fn sill(&self) -> f64 {
        match self.style {
            Style::School => 1.8,
            Style::Coach | Style::Minibus => 1.25,
            _ => 1.1,
        }
    }

    fn body(&self, stretch: Stretch) -> mesh_core::TriMesh {
        let inner = 1.0 - self.round / self.half;
        let mut cuts: Vec<(f64, f64)> = (0..=5)
            .map(|k| {
                let (sin, cos) = (FRAC_PI_2 * f64::from(k) / 5.0).sin_cos();
                (inner + (1.0 - inner) * sin, self.round * (1.0 - cos))
            })
            .collect();
        cuts.push((0.0, 0.0));
        cuts.extend(cuts.clone()[..6].iter().map(|&(s, bend)| (-s, bend)));
        cuts.sort_by(|a, b| a.0.total_cmp(&b.0));
        let section = |&(s, bend): &(f64, f64)| -> Vec<Point> {
            let outline = self.outline(stretch, bend).into_iter();
            outline.map(|[z, y]| [s * self.half, y, z]).collect()
        };
        solid::loft(&cuts.iter().map(section).collect::<Vec<_>>())
    }

    /// The side view, drawn in by `bend` at roof and ends.
    fn outline(&self, stretch: Stretch, bend: f64) -> Vec<[f64; 2]> {
        let [rear_bend, front_bend] = stretch.ends.map(|end| if end { bend } else { 0.2 * bend });
        let (h, g) = (self.height - bend, self.ground);
        let (r, f) = (stretch.rear + rear_bend, stretch.front - front_bend);
        let mut points = Vec::new();
        if stretch.ends[1] {
            points.extend([[f - 0.04, g], [f, g + 0.18]]);
            if self.bonnet[0] > 0.0 {
                let top = self.bonnet[1] - 0.6 * bend;
                points.extend([[f - 0.02, top - 0.35], [f - 0.12, top - 0.12], [f - 0.35, top]]);
                points.push([self.face(0.0) - front_bend + 0.02, top + 0.05]);
            } else {
                points.push([f, self.sill()]);
            }
            let head = self.face(self.height - 0.2) - front_bend;
            points.extend([[head, h - 0.2], [head - 0.05, h - 0.07], [head - 0.2, h]]);
        } else {
            points.extend([[f, g], [f, h]]);
        }
        if stretch.ends[0] {
            points.extend([[r + 0.25, h], [r + 0.07, h - 0.06], [r, h - 0.25], [r, g + 0.2]]);
            points.push([r + 0.05, g]);
        } else {
            points.extend([[r, h], [r, g]]);
        }
        let inside = |z: &&f64| (stretch.rear..stretch.front).contains(*z);
        let axles: Vec<f64> = self.axles.iter().filter(inside).copied().collect();
        cut_arches(&mut points, g, &axles, self.wheel, 1.15 * self.wheel);
        points
    }

    /// A thin upright sheet on both sides, or on one (`Some(sign)`).
    fn on_side(
        &self,
        all: &mut Assembly,
        name: &'static str,
        (z, y): ([f64; 2], [f64; 2]),
        (round, proud): (f64, f64),
        color: [f32; 3],
        side: Option<f64>,
    ) {
        let outline: Vec<[f64; 2]> = solid::rounded_rectangle([z[1] - z[0], y[1] - y[0]], round, 2)
            .into_iter()
            .map(|[a, b]| [a + 0.5 * (z[0] + z[1]), b + 0.5 * (y[0] + y[1])])
            .collect();
        let sheet = solid::side_prism(&outline, [self.half - 0.05, self.half + proud]);
        match side {
            None => all.pair(name, sheet, color),
            Some(sign) if sign > 0.0 => all.add(name, sheet, color),
            Some(_) => all.add(name, solid::mirrored(&sheet), color),
        }
    }

    /// A sheet over the sides from the sill up, wheel arches cut out.
    fn skirt(&self, [r, f]: [f64; 2], [rear_top, front_top]: [f64; 2]) -> mesh_core::TriMesh {
        let arch = 1.15 * self.wheel;
        // An arch that would be cut in two stays out.
        let inside: Vec<f64> = self
            .axles
            .iter()
            .copied()
            .filter(|z| r < z - arch - 0.05 && z + arch + 0.05 < f)
            .collect();
        let mut outline = vec![[f, self.ground + 0.02], [f, front_top], [r, rear_top]];
        outline.push([r, self.ground + 0.02]);
        cut_arches(&mut outline, self.ground + 0.02, &inside, self.wheel, arch);
        solid::side_prism(&outline, [self.half - 0.05, self.half + 0.012])
    }

    /// A sheet across the front between two heights, out to a share of the half width.
    fn on_front(&self, [low, high]: [f64; 2], [left, right]: [f64; 2]) -> mesh_core::TriMesh {
        let at = |x: f64, y: f64| [x, y, self.face(y)];
        let corners = [at(left, low), at(right, low), at(right, high), at(left, high)];
        solid::plate(|u, v| solid::bilinear(corners, u, v), [2, 4], [0.08, 0.025])
    }
}

pub(super) fn draw(seed: u64) -> Shape {
    let mut draw = Draw::new(seed, 3);
    let style = draw.pick(&Style::ALL);
    let bus = Bus::draw(&mut draw, style);
    let colors = livery::Colors::draw(&mut draw, style);
    // Doors are on the right, or on the left where traffic keeps to the left.
    let curb = if draw.chance(0.7) { -1.0 } else { 1.0 };
    let mut all = Assembly::default();
    let stretches = stretches(&bus);
    for &stretch in &stretches {
        all.add("body", bus.body(stretch), colors.base);
    }
    if stretches.len() == 2 {
        bellows(&mut all, &bus, [stretches[0].front, stretches[1].rear]);
    }
    livery::livery(&mut all, &bus, &colors, &stretches);
    let doors = doors(&bus);
    let glazing = draw.pick(&["panes", "ribbon"]);
    let panes = windows(&mut all, &bus, &mut draw, &stretches, (&doors, curb, glazing));
    for &z in &doors {
        door(&mut all, &bus, z, curb);
    }
    front(&mut all, &bus, &mut draw, &colors);
    rear(&mut all, &bus);
    wheels(&mut all, &bus, &mut draw);
    let roof = roof::roof(&mut all, &bus, &mut draw, &stretches);
    let traits = vec![
        ("style", style.name().to_owned()),
        ("livery", colors.livery.to_owned()),
        ("glazing", glazing.to_owned()),
        ("panes", panes.to_string()),
        ("doors", doors.len().to_string()),
        ("curb", if curb < 0.0 { "right" } else { "left" }.to_owned()),
        ("roof", roof.to_owned()),
        ("axles", bus.axles.len().to_string()),
    ];
    all.finish(Family::Bus, seed, traits)
}

fn stretches(bus: &Bus) -> Vec<Stretch> {
    let whole = Stretch { rear: bus.rear, front: bus.front, ends: [true, true] };
    if bus.style != Style::Articulated {
        return vec![whole];
    }
    let joint = bus.axles[1] - 1.6;
    vec![
        Stretch { front: joint - 0.5, ends: [true, false], ..whole },
        Stretch { rear: joint + 0.5, ends: [false, true], ..whole },
    ]
}

fn bellows(all: &mut Assembly, bus: &Bus, [from, to]: [f64; 2]) {
    let folds = 7;
    let rings: Vec<Vec<Point>> = (0..=2 * folds)
        .map(|k| {
            let inset = if k % 2 == 0 { 0.05 } else { 0.16 };
            let sides = [2.0 * (bus.half - inset), bus.height - bus.ground - 0.1 - 2.0 * inset];
            let z = from - 0.05 + (to - from + 0.1) * f64::from(k) / f64::from(2 * folds);
            let y = 0.5 * (bus.height + bus.ground);
            solid::rounded_rectangle(sides, 0.2, 3)
                .into_iter()
                .map(|[a, b]| [a, y + b, z])
                .collect()
        })
        .collect();
    all.add("bellows", solid::loft(&rings), [0.17, 0.17, 0.18]);
}

fn front(all: &mut Assembly, bus: &Bus, draw: &mut Draw, colors: &livery::Colors) {
    let wide = bus.half - bus.round - 0.02;
    let mut screens = vec![[bus.sill() + 0.12, bus.decks[0][1] + 0.02]];
    if bus.style == Style::DoubleDecker {
        screens.push(bus.decks[1]);
    }
    for (k, &y) in screens.iter().enumerate() {
        let split = k == 1 || matches!(bus.style, Style::School) || draw.chance(0.5);
        if split {
            all.add("windscreen", bus.on_front(y, [-wide, -0.03]), GLASS);
            all.add("windscreen", bus.on_front(y, [0.03, wide]), GLASS);
        } else {
            all.add("windscreen", bus.on_front(y, [-wide, wide]), GLASS);
        }
    }
    let y = bus.decks[0][1];
    if bus.style == Style::DoubleDecker {
        all.add("sign", bus.on_front([y + 0.12, bus.decks[1][0] - 0.12], [-0.8, 0.8]), TRIM);
        all.add("route", sign(bus, y + 0.22, bus.decks[1][0] - 0.22), AMBER);
    } else if !matches!(bus.style, Style::Coach | Style::Minibus) {
        all.add("sign", bus.on_front([y + 0.07, y + 0.34], [-0.85, 0.85]), TRIM);
        all.add("route", sign(bus, y + 0.12, y + 0.28), AMBER);
    }
    let f = bus.front;
    let light_y = if bus.bonnet[0] > 0.0 { 1.05 } else { bus.ground + 0.42 };
    for (x, size, color) in [(0.78, [0.32, 0.2], WHITE), (0.52, [0.18, 0.18], [0.97, 0.95, 0.85])] {
        let at = [x * bus.half, light_y, f - 0.06 - 0.14 * (x - 0.5)];
        let lamp = solid::rounded_block(at, [size[0], size[1], 0.28], 0.06);
        all.pair("headlight", lamp, color);
    }
    let bumper = solid::rounded_block(
        [0.0, bus.ground + 0.12, f - 0.14],
        [1.98 * bus.half, 0.24, 0.42],
        0.1,
    );
    all.add("bumper", bumper, TRIM);
    let grille_y = if bus.bonnet[0] > 0.0 { 1.1 } else { bus.ground + 0.42 };
    let grille = [0.7 * bus.half, if bus.bonnet[0] > 0.0 { 0.6 } else { 0.22 }, 0.1];
    all.add("grille", solid::rounded_block([0.0, grille_y, f - 0.02], grille, 0.04), TRIM);
    mirrors(all, bus, colors);
}

/// The lit part of a destination sign.
fn sign(bus: &Bus, low: f64, high: f64) -> mesh_core::TriMesh {
    let at = |x: f64, y: f64| [x, y, bus.face(y) + 0.02];
    let corners = [at(-0.6, low), at(0.6, low), at(0.6, high), at(-0.6, high)];
    solid::plate(|u, v| solid::bilinear(corners, u, v), [1, 1], [0.05, 0.02])
}

fn mirrors(all: &mut Assembly, bus: &Bus, colors: &livery::Colors) {
    let y = bus.decks[0][1] - 0.1;
    let z = bus.face(y) - bus.round;
    let tip = [bus.half + 0.17, y - 0.05, z + 0.38];
    let arm = [[bus.half - 0.12, y + 0.12, z + 0.02], [bus.half + 0.13, y + 0.12, z + 0.3], tip];
    all.pair("mirror arm", solid::bar(&arm, 0.035, 3, 8), TRIM);
    let head = [tip[0], tip[1] - 0.2, tip[2]];
    let color = if bus.style == Style::School { TRIM } else { colors.base };
    all.pair("mirror", solid::rounded_block(head, [0.2, 0.44, 0.12], 0.05), color);
}

fn rear(all: &mut Assembly, bus: &Bus) {
    let r = bus.rear;
    let wide = bus.half - bus.round - 0.05;
    for deck in &bus.decks {
        let outline = solid::rounded_rectangle([2.0 * wide, deck[1] - deck[0] - 0.1], 0.12, 2);
        let y = 0.5 * (deck[0] + deck[1]);
        let outline: Vec<[f64; 2]> = outline.into_iter().map(|[a, b]| [a, b + y]).collect();
        all.add("rear window", solid::front_prism(&outline, [r - 0.025, r + 0.05]), GLASS);
    }
    let x = 0.82 * bus.half;
    let lamp = |y: f64, high: f64| solid::rounded_block([x, y, r + 0.1], [0.2, high, 0.3], 0.05);
    all.pair("taillight", lamp(bus.ground + 0.75, 0.42), RED);
    all.pair("indicator", lamp(bus.ground + 0.48, 0.14), AMBER);
    let bumper =
        solid::rounded_block([0.0, bus.ground + 0.12, r + 0.14], [1.98 * bus.half, 0.24, 0.4], 0.1);
    all.add("bumper", bumper, TRIM);
    let vent = [1.1 * bus.half, 0.34, 0.08];
    all.add("vent", solid::rounded_block([0.0, bus.ground + 0.62, r], vent, 0.03), TRIM);
}

fn wheels(all: &mut Assembly, bus: &Bus, draw: &mut Draw) {
    let wheel = Wheel {
        radius: bus.wheel,
        width: 0.36,
        rim: 0.6,
        spokes: draw.pick(&[0, 0, 6, 8]),
        open: false,
        color: draw.pick(&[[0.7, 0.71, 0.73], [0.5, 0.51, 0.53], [0.9, 0.9, 0.88]]),
    };
    for &z in &bus.axles {
        for out in [-1.0, 1.0] {
            let x = out * (bus.half + 0.01 - 0.5 * wheel.width);
            wheel.build(all, [x, bus.wheel, z], out);
        }
        let ends = [-0.8, 0.8].map(|x| [x * bus.half, bus.wheel, z]);
        all.add("axle", solid::rod(ends[0], ends[1], [0.12; 2], 8), TRIM);
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::check;
    use super::*;

    #[test]
    fn buses_are_sound_and_differ() {
        let styles = ["city", "double decker", "articulated", "coach", "school", "minibus"];
        check(
            Family::Bus,
            &[
                ("style", &styles),
                ("livery", &["plain", "skirt", "band", "diagonal", "roof", "school"]),
                ("glazing", &["panes", "ribbon"]),
                ("doors", &["1", "2", "3"]),
                ("curb", &["left", "right"]),
                ("roof", &["bare", "hatches", "cooler", "tanks", "rack", "beacons"]),
                ("axles", &["2", "3"]),
            ],
        );
    }
}
