//! Motorbikes: sport, naked, cruiser, touring, dirt bike, scooter.

mod engine;
mod fairing;
mod plan;

use std::f64::consts::PI;

use super::assembly::Assembly;
use super::draw::Draw;
use super::family::Family;
use super::shape::Shape;
use super::solid::{self, Point, add, mix};
use super::wheel::{Wheel, mudguard};
use plan::{Bike, CHROME, DARK, LIGHT, RED, STEEL, STYLES, Style, X, hull};

pub(super) fn draw(seed: u64) -> Shape {
    let mut draw = Draw::new(seed, 18);
    let (style, name, lines) = draw.pick(&STYLES);
    let bike = Bike::draw(&mut draw, style, lines);
    let mut all = Assembly::default();
    let spokes = match style {
        Style::Dirt => 18,
        Style::Cruiser => draw.pick(&[5, 18, 24]),
        Style::Scooter => draw.pick(&[0, 5]),
        _ => draw.pick(&[3, 5, 6, 10]),
    };
    let rim = draw.pick(&[DARK, STEEL, [0.85, 0.65, 0.15], bike.paint]);
    wheel(&mut all, &bike, 0, (spokes, rim));
    let (engine, exhausts) = if style == Style::Scooter {
        fairing::scooter(&mut all, &bike, &mut draw)
    } else {
        (engine::engine(&mut all, &bike, &mut draw), engine::exhaust(&mut all, &bike, &mut draw))
    };
    if style != Style::Scooter {
        frame(&mut all, &bike);
        upper(&mut all, &bike, &mut draw);
    }
    let luggage = luggage(&mut all, &bike, &mut draw);
    // From here on, what turns with the handlebar.
    let first = all.len();
    wheel(&mut all, &bike, 1, (spokes, rim));
    fork(&mut all, &bike);
    let handlebar = controls(&mut all, &bike, &mut draw);
    let turn = draw.within(-0.3, 0.3);
    let axis = bike.steering();
    let swings = if style == Style::Sport { 0.3 * turn } else { turn };
    all.move_since(first, |mesh| solid::rotated(mesh, bike.head, axis, swings));
    let screen = fairing::fairing(&mut all, &bike, &mut draw);
    let traits = vec![
        ("style", name.to_owned()),
        ("engine", engine.to_owned()),
        ("exhausts", exhausts.to_string()),
        ("handlebar", handlebar.to_owned()),
        ("screen", screen.to_owned()),
        ("luggage", luggage.to_owned()),
        ("spokes", spokes.to_string()),
    ];
    all.finish(Family::Motorbike, seed, traits)
}

fn wheel(all: &mut Assembly, b: &Bike, end: usize, (spokes, color): (usize, [f32; 3])) {
    let center = [b.rear, b.front][end];
    let rim = if b.style == Style::Dirt { 0.76 } else { 0.66 };
    let wheel =
        Wheel { radius: b.radii[end], width: b.widths[end], rim, spokes, open: spokes > 0, color };
    wheel.build(all, center, 1.0);
    let r = 0.47 * b.radii[end];
    let disc = [[0.6 * r, -0.006], [r, -0.006], [r, 0.006], [0.6 * r, 0.006]];
    for side in [-1.0, 1.0] {
        let at = add(center, [side * (0.5 * b.widths[end] + 0.005), 0.0, 0.0]);
        all.add("brake disc", solid::turned_ring(&disc, 24, at, X), STEEL);
    }
    let half = 0.5 * b.widths[end] + 0.05;
    let ends = [-half, half].map(|x| add(center, [x, 0.0, 0.0]));
    all.add("axle", solid::rod(ends[0], ends[1], [0.018; 2], 8), DARK);
}

fn fork(all: &mut Assembly, b: &Bike) {
    let wide = 0.5 * b.widths[1] + 0.035;
    let foot = add(b.front, [wide, 0.0, 0.0]);
    let top = add(b.head, [wide, 0.03, -0.01]);
    let (stanchion, leg) = match b.style {
        Style::Cruiser => (CHROME, CHROME),
        Style::Sport => ([0.8, 0.62, 0.2], DARK),
        Style::Scooter => (DARK, DARK),
        _ => (STEEL, DARK),
    };
    all.pair("stanchion", solid::rod(mix(foot, top, 0.35), top, [0.022; 2], 12), stanchion);
    all.pair("fork leg", solid::rod(foot, mix(foot, top, 0.5), [0.032; 2], 12), leg);
    for share in [0.78, 1.0] {
        let at = mix(b.front, b.head, share);
        let size = [2.0 * wide + 0.08, 0.045, 0.1];
        all.add("yoke", solid::rounded_block(at, size, 0.02), DARK);
    }
    let r = b.radii[1];
    if b.style == Style::Dirt {
        let at = mix(b.front, b.head, 0.66);
        let beak = [
            [at[2] + 0.46, at[1] - 0.06, 0.05, 0.014],
            [at[2] + 0.3, at[1] + 0.02, 0.09, 0.02],
            [at[2] + 0.05, at[1] + 0.05, 0.1, 0.022],
            [at[2] - 0.2, at[1] + 0.03, 0.075, 0.018],
        ];
        all.add("mudguard", hull(&beak, 2.6), b.paint);
    } else {
        let angles = match b.style {
            Style::Cruiser | Style::Scooter => [0.12 * PI, 0.95 * PI],
            _ => [0.28 * PI, 0.82 * PI],
        };
        let half = 0.5 * b.widths[1] + 0.02;
        let guard = mudguard(b.front, [r + 0.035, half], angles, 0.04);
        all.add("mudguard", guard, b.paint);
    }
}

/// Adds handlebar, mirrors and what lights the road on bikes without a fairing.
fn controls(all: &mut Assembly, b: &Bike, draw: &mut Draw) -> &'static str {
    let kind = match b.style {
        Style::Sport => "clip-on",
        Style::Cruiser => draw.pick(&["ape hanger", "swept", "swept"]),
        Style::Naked => draw.pick(&["flat", "flat", "swept"]),
        _ => "flat",
    };
    let half: Vec<Point> = match kind {
        "clip-on" => vec![[0.0, 0.0, 0.0], [0.12, 0.0, 0.01], [0.33, -0.04, -0.08]],
        "ape hanger" => vec![
            [0.0, 0.03, 0.0],
            [0.1, 0.05, 0.0],
            [0.24, 0.22, -0.03],
            [0.3, 0.36, -0.1],
            [0.36, 0.34, -0.25],
        ],
        "swept" => vec![
            [0.0, 0.06, 0.0],
            [0.1, 0.08, 0.0],
            [0.24, 0.17, -0.06],
            [0.36, 0.15, -0.2],
            [0.42, 0.12, -0.32],
        ],
        _ => vec![
            [0.0, 0.05, 0.0],
            [0.08, 0.06, 0.0],
            [0.16, 0.13, -0.02],
            [0.26, 0.14, -0.05],
            [0.4, 0.12, -0.11],
        ],
    };
    let half: Vec<Point> = half.iter().map(|&p| add(b.head, p)).collect();
    let metal = if b.style == Style::Cruiser { CHROME } else { DARK };
    all.add("handlebar", solid::bar(&solid::both_sides(&half), 0.016, 4, 10), metal);
    let n = half.len();
    let grip = [mix(half[n - 2], half[n - 1], 0.35), add(half[n - 1], [0.006, 0.0, 0.0])];
    all.pair("grip", solid::bar(&grip, 0.025, 2, 10), DARK);
    let lever = [grip[0], add(grip[0], [0.03, 0.0, 0.07]), add(grip[1], [0.0, -0.01, 0.06])];
    all.pair("lever", solid::bar(&lever, 0.011, 3, 6), STEEL);
    if b.style != Style::Sport {
        let root = mix(half[n - 2], half[n - 1], 0.15);
        let high = if kind == "ape hanger" { 0.1 } else { 0.16 };
        let tip = add(root, [0.07, high, -0.02]);
        all.pair("mirror arm", solid::bar(&[root, tip], 0.011, 1, 8), metal);
        let glass = solid::ellipsoid(add(tip, [0.01, 0.02, 0.0]), [0.075, 0.05, 0.025], 8);
        all.pair("mirror", glass, if b.style == Style::Cruiser { CHROME } else { DARK });
    }
    let round = matches!(b.style, Style::Cruiser | Style::Naked);
    if round {
        let r = if b.style == Style::Cruiser { 0.1 } else { 0.088 };
        let at = add(b.head, [0.0, -0.06, 0.15]);
        let bowl = [
            [0.0, -0.13],
            [0.5 * r, -0.12],
            [0.9 * r, -0.05],
            [r, 0.0],
            [1.02 * r, 0.02],
            [0.0, 0.022],
        ];
        all.add("headlight", solid::turned(&bowl, 22, at, [0.0, 0.0, 1.0]), metal);
        let glass = [[0.0, 0.0], [0.88 * r, 0.0], [0.88 * r, 0.026], [0.4 * r, 0.045], [0.0, 0.05]];
        all.add("headlight glass", solid::turned(&glass, 22, at, [0.0, 0.0, 1.0]), LIGHT);
        let dial = add(b.head, [0.0, 0.09, 0.06]);
        let face = [[0.0, -0.03], [0.05, -0.03], [0.055, 0.02], [0.0, 0.025]];
        all.add("dial", solid::turned(&face, 16, dial, [0.0, 1.0, -0.7]), metal);
    }
    kind
}

/// Tubes between head, engine and rear wheel.
fn frame(all: &mut Assembly, b: &Bike) {
    let color = if b.style == Style::Dirt { b.accent } else { DARK };
    let neck = add(b.head, [0.0, -0.07, -0.02]);
    let pivot = [0.1, 0.36, b.rear[2] + 0.5];
    let side = [[0.05, neck[1], neck[2]], [0.13, 0.62, 0.5 * (neck[2] + pivot[2]) + 0.05], pivot];
    all.pair("frame", solid::bar(&side, 0.03, 6, 10), color);
    let cradle = [[0.03, neck[1] - 0.06, neck[2]], [0.09, 0.4, neck[2] - 0.1], [0.1, 0.2, 0.05]];
    let cradle = [cradle[0], cradle[1], cradle[2], pivot];
    all.pair("cradle", solid::bar(&cradle, 0.021, 5, 8), color);
    let wide = 0.5 * b.widths[0] + 0.045;
    let axle = add(b.rear, [wide, 0.0, 0.0]);
    let metal = if b.style == Style::Sport { STEEL } else { color };
    let arm = [[wide - 0.02, pivot[1], pivot[2]], axle];
    all.pair("swing arm", solid::rod(arm[0], arm[1], [0.038, 0.03], 10), metal);
    let cross = [-wide, wide].map(|x| [x, pivot[1], pivot[2]]);
    all.add("pivot", solid::rod(cross[0], cross[1], [0.04; 2], 10), metal);
    let rail = [pivot[0], b.seat - 0.08, b.rear[2] + 0.12];
    all.pair("subframe", solid::rod([0.09, 0.6, pivot[2] + 0.05], rail, [0.02; 2], 8), color);
    let shock = [[wide, b.radii[0] + 0.03, b.rear[2] + 0.08], [wide - 0.02, b.seat - 0.1, rail[2]]];
    if matches!(b.style, Style::Cruiser | Style::Naked | Style::Touring) {
        all.pair("shock", solid::rod(shock[0], shock[1], [0.022; 2], 10), STEEL);
        let spring = [mix(shock[0], shock[1], 0.35), mix(shock[0], shock[1], 0.9)];
        all.pair("spring", solid::rod(spring[0], spring[1], [0.036; 2], 12), DARK);
    } else {
        let mono = [[0.0, 0.34, pivot[2] - 0.08], [0.0, b.seat - 0.12, pivot[2] + 0.02]];
        all.add("shock", solid::rod(mono[0], mono[1], [0.045; 2], 12), b.accent);
    }
    let peg = [0.13, 0.33, pivot[2] + 0.08];
    all.pair("peg", solid::rod(peg, add(peg, [0.14, 0.0, 0.0]), [0.018; 2], 8), DARK);
    // Down to the ground on the left.
    let stand = [[0.12, 0.24, pivot[2] + 0.1], [0.26, 0.01, pivot[2] + 0.02]];
    all.add("stand", solid::bar(&stand, 0.014, 1, 8), DARK);
}

/// Tank, seat, tail and rear mudguard.
fn upper(all: &mut Assembly, b: &Bike, draw: &mut Draw) {
    let front = b.head[2] - 0.05;
    let middle = match b.style {
        Style::Cruiser => -0.12,
        Style::Dirt => 0.05,
        _ => -0.03,
    };
    let (top, wide, tall) = match b.style {
        Style::Dirt => (b.seat - 0.02, 0.11, 0.12),
        Style::Cruiser => (b.head[1] - 0.1, 0.15, 0.11),
        _ => (b.head[1] - 0.02, draw.within(0.14, 0.165), draw.within(0.12, 0.14)),
    };
    let at = |share: f64| front + (middle - front) * share;
    let drop = (top + 0.3 * tall - b.seat).max(0.0);
    let tank = [
        [at(-0.02), top - 0.04, 0.4 * wide, 0.4 * tall],
        [at(0.1), top - 0.01, 0.8 * wide, 0.8 * tall],
        [at(0.35), top, wide, tall],
        [at(0.6), top - 0.02, 0.95 * wide, 0.95 * tall],
        [at(0.85), top - 0.25 * drop - 0.03, 0.7 * wide, 0.72 * tall],
        [at(1.08), top - 0.6 * drop - 0.05, 0.48 * wide, 0.5 * tall],
    ];
    all.add("tank", hull(&tank, 2.6), b.paint);
    if b.accent != b.paint {
        let strip = |u: f64, v: f64| {
            let z = at(0.15 + 0.7 * u);
            [
                wide * (1.0 - 0.15 * (2.0 * u - 1.0).powi(2)) - 0.004,
                top - 0.02 + 0.07 * (v - 0.5),
                z,
            ]
        };
        all.pair("stripe", solid::plate(strip, [6, 2], [0.05, 0.008]), b.accent);
    }
    let cap = [[0.0, -0.03], [0.035, -0.03], [0.035, 0.01], [0.0, 0.014]];
    all.add("cap", solid::turned(&cap, 14, [0.0, top + tall, at(0.42)], [0.0, 1.0, 0.0]), STEEL);
    let (y, tail) = (b.seat, b.rear[2]);
    let leather = draw.pick(&[DARK, DARK, [0.4, 0.24, 0.13]]);
    let kick = if b.style == Style::Sport { 0.14 } else { 0.05 };
    let (seat, end): (Vec<[f64; 4]>, f64) = match b.style {
        Style::Cruiser => (
            vec![
                [middle + 0.02, y - 0.01, 0.06, 0.05],
                [middle - 0.15, y - 0.03, 0.13, 0.06],
                [middle - 0.36, y - 0.01, 0.17, 0.07],
                [middle - 0.46, y + 0.05, 0.15, 0.075],
                [tail + 0.1, y + 0.06, 0.12, 0.055],
                [tail - 0.05, y + 0.06, 0.08, 0.04],
            ],
            tail,
        ),
        Style::Dirt => (
            vec![
                [middle + 0.14, y, 0.05, 0.04],
                [middle - 0.1, y, 0.075, 0.055],
                [middle - 0.45, y + 0.01, 0.09, 0.055],
                [tail + 0.02, y + 0.04, 0.06, 0.04],
            ],
            tail,
        ),
        _ => (
            vec![
                [middle + 0.03, y - 0.01, 0.06, 0.05],
                [middle - 0.12, y - 0.02, 0.12, 0.055],
                [middle - 0.32, y, 0.15, 0.06],
                [middle - 0.42, y + 0.4 * kick + 0.02, 0.125, 0.06],
                [tail + 0.12, y + kick, 0.1, 0.05],
                [tail - 0.06, y + kick + 0.03, 0.06, 0.03],
            ],
            tail - 0.08,
        ),
    };
    all.add("seat", hull(&seat, 3.0), leather);
    if b.style == Style::Cruiser {
        let half = 0.5 * b.widths[0] + 0.035;
        let guard = mudguard(b.rear, [b.radii[0] + 0.06, half], [0.3 * PI, 1.0 * PI], 0.05);
        all.add("mudguard", guard, b.paint);
    } else {
        let lift = if b.style == Style::Dirt { 0.04 } else { kick };
        let cowl = [
            [middle - 0.1, y - 0.09, 0.1, 0.05],
            [middle - 0.35, y - 0.06, 0.14, 0.06],
            [tail + 0.1, y + lift - 0.05, 0.1, 0.05],
            [end - 0.1, y + lift + 0.005, 0.055, 0.03],
            [end - 0.16, y + lift + 0.015, 0.03, 0.015],
        ];
        all.add("tail", hull(&cowl, 2.8), b.paint);
        let from = [0.0, y + lift - 0.04, tail + 0.02];
        let flap = [from, add(from, [0.0, -0.12, -0.22]), add(from, [0.0, -0.27, -0.3])];
        all.add("flap", solid::bar(&flap, 0.025, 4, 8), DARK);
        all.add("plate", solid::block(flap[2], [0.16, 0.13, 0.03]), [0.92, 0.92, 0.9]);
        let guard =
            mudguard(b.rear, [b.radii[0] + 0.03, 0.5 * b.widths[0]], [0.3 * PI, 0.68 * PI], 0.03);
        all.add("hugger", guard, DARK);
    }
    let lamp = match b.style {
        Style::Cruiser => [0.0, b.radii[0] + 0.3, tail - 0.3],
        Style::Dirt => [0.0, y + 0.04, end - 0.12],
        _ => [0.0, y + kick, end - 0.1],
    };
    all.add("tail light", solid::rounded_block(lamp, [0.13, 0.06, 0.07], 0.025), RED);
    let panel = [0.11, 0.62, 0.5 * (middle + tail) + 0.12];
    all.pair("side panel", solid::rounded_block(panel, [0.07, 0.2, 0.3], 0.03), b.paint);
}

/// Adds cases; returns what there is.
fn luggage(all: &mut Assembly, b: &Bike, draw: &mut Draw) -> &'static str {
    let kind = match b.style {
        Style::Touring => draw.pick(&["cases", "cases and trunk"]),
        Style::Scooter | Style::Naked => draw.pick(&["none", "none", "trunk"]),
        Style::Cruiser => draw.pick(&["none", "cases"]),
        _ => "none",
    };
    let z = b.rear[2];
    let color =
        if b.style == Style::Cruiser { [0.3, 0.19, 0.11] } else { draw.pick(&[DARK, b.paint]) };
    if kind.contains("cases") {
        let at = [0.5 * b.widths[0] + 0.19, 0.58, z - 0.02];
        let size = if b.style == Style::Cruiser { [0.17, 0.28, 0.42] } else { [0.22, 0.38, 0.5] };
        all.pair("case", solid::rounded_block(at, size, 0.07), color);
        let strap = [size[0] + 0.015, size[1] * 0.98, 0.04];
        all.pair("strap", solid::rounded_block(at, strap, 0.02), STEEL);
        let bars = [[-at[0], 0.66, z], [at[0], 0.66, z]];
        all.add("case holder", solid::rod(bars[0], bars[1], [0.02; 2], 8), DARK);
    }
    if kind.contains("trunk") {
        let y = b.seat + if b.style == Style::Touring { 0.24 } else { 0.2 };
        let at = [0.0, y, z - 0.12];
        all.add("trunk", solid::rounded_block(at, [0.44, 0.28, 0.36], 0.09), color);
        all.add("seam", solid::rounded_block(at, [0.45, 0.03, 0.37], 0.01), STEEL);
        let foot = [0.0, b.seat - 0.05, z + 0.02];
        all.add("trunk rack", solid::rod(foot, [0.0, y - 0.1, z - 0.12], [0.06; 2], 8), DARK);
    }
    kind
}

#[cfg(test)]
mod tests {
    use super::super::tests::check;
    use super::*;

    #[test]
    fn motorbikes_are_sound_and_differ() {
        check(
            Family::Motorbike,
            &[
                ("style", &["sport", "naked", "cruiser", "touring", "dirt", "scooter"]),
                ("engine", &["V-twin", "single", "four", "boxer", "hidden"]),
                ("exhausts", &["1", "2", "4"]),
                ("handlebar", &["clip-on", "ape hanger", "swept", "flat"]),
                ("screen", &["none", "full fairing", "half fairing", "windscreen", "flyscreen"]),
                ("luggage", &["none", "cases", "trunk", "cases and trunk"]),
            ],
        );
    }
}
