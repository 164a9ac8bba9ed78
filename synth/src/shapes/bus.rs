//! Buses: city, double decker, articulated, coach, school bus, minibus.

mod livery;
mod openings;
mod plan;
mod roof;

use super::assembly::Assembly;
use super::draw::Draw;
use super::family::Family;
use super::shape::Shape;
use super::solid::{self, Point};
use super::wheel::Wheel;
use openings::{door, doors, windows};
use plan::{AMBER, Bus, GLASS, RED, STYLES, Stretch, Style, TRIM, WHITE};

pub(super) fn draw(seed: u64) -> Shape {
    let mut draw = Draw::new(seed, 3);
    let (style, name, lines) = draw.pick(&STYLES);
    let bus = Bus::draw(&mut draw, style, lines);
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
        ("style", name.to_owned()),
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
