//! What only some cars have.

use super::super::assembly::Assembly;
use super::super::draw::Draw;
use super::super::solid;
use super::{Car, Style, TRIM};

/// What only some cars have.
pub(super) fn extras(
    all: &mut Assembly,
    car: &Car,
    draw: &mut Draw,
    (livery, open): (&'static str, bool),
    paint: [f32; 3],
) -> &'static str {
    if livery == "stripes" {
        stripes(all, car, draw.pick(&[[0.95, 0.95, 0.93], [0.08, 0.08, 0.09]]), open);
    }
    if livery == "band" {
        let color = draw.color([0.6, 0.9], [0.4, 0.85]);
        let z = [car.axles[1] + 0.55, car.axles[0] - 0.55];
        let at = [car.half - 0.02, car.belt - 0.3, 0.5 * (z[0] + z[1])];
        all.pair("band", solid::block(at, [0.06, 0.2, z[1] - z[0]]), color);
    }
    match livery {
        "taxi" => {
            let at = [0.0, car.roof + 0.07, 0.5 * (car.glass[1] + car.glass[2])];
            all.add("sign", solid::rounded_block(at, [0.7, 0.2, 0.22], 0.04), [0.97, 0.97, 0.92]);
            checkers(all, car);
            return "sign";
        }
        "police" => {
            let z = 0.5 * (car.glass[1] + car.glass[2]) + 0.1;
            for (x, color) in [(-0.3, [0.85, 0.08, 0.1]), (0.3, [0.1, 0.25, 0.9])] {
                let at = [x, car.roof + 0.06, z];
                all.add("beacon", solid::rounded_block(at, [0.58, 0.15, 0.24], 0.05), color);
            }
            let [front, rear] = car.axles;
            let size = [0.05, 0.42, front - rear - 2.9 * car.wheel];
            let at = [car.half - 0.015, car.ground + 0.42, 0.5 * (front + rear)];
            all.pair("door", solid::block(at, size), [0.93, 0.93, 0.94]);
            return "beacon";
        }
        _ => {}
    }
    match car.style {
        Style::Sports if draw.chance(0.65) => {
            spoiler(all, car, draw.within(0.16, 0.26), paint);
            "spoiler"
        }
        Style::Hatchback if draw.chance(0.5) => {
            let at = [0.0, car.roof - 0.035, car.glass[2] - 0.02];
            let lip = solid::rounded_block(at, [1.7 * car.cabin[1], 0.06, 0.4], 0.025);
            all.add("spoiler", lip, paint);
            "lip"
        }
        Style::Suv | Style::Van | Style::Hatchback if draw.chance(0.55) => {
            rack(all, car, draw);
            "rack"
        }
        Style::Pickup if draw.chance(0.5) => {
            let z = car.glass[3] - 0.22;
            let (x, low, high) = (car.half - 0.16, car.tail - 0.06, car.roof - 0.02);
            let path = [[-x, low, z], [-0.9 * x, high, z], [0.9 * x, high, z], [x, low, z]];
            for pair in path.windows(2) {
                let ends = [pair[0], pair[1]];
                all.add("roll bar", solid::bar(&ends, 0.045, 1, 10), TRIM);
            }
            "roll bar"
        }
        _ => "none",
    }
}

fn stripes(all: &mut Assembly, car: &Car, color: [f32; 3], open: bool) {
    let from = car.front - 0.16;
    let [_, head, back, foot] = car.glass;
    for x in [-0.17, 0.17] {
        let across = |u: f64| x + 0.2 * (u - 0.5);
        let hood = |u: f64, v: f64| {
            let z = from + (car.glass[0] + 0.02 - from) * v;
            [across(u), car.hood(z), z]
        };
        // u runs to +X and v backwards: their cross product is +Y.
        all.add("stripe", solid::plate(hood, [2, 12], [0.06, 0.014]), color);
        let roof = |u: f64, v: f64| {
            let z = head - 0.09 + (back + 0.18 - head) * v;
            [across(u), car.roof, z]
        };
        if !open {
            all.add("stripe", solid::plate(roof, [2, 6], [0.06, 0.012]), color);
        }
        let deck = |u: f64, v: f64| {
            let z = foot + (car.rear + 0.14 - foot) * v;
            [across(u), car.tail, z]
        };
        all.add("stripe", solid::plate(deck, [2, 4], [0.06, 0.012]), color);
    }
}

fn checkers(all: &mut Assembly, car: &Car) {
    let z = [car.axles[1] + 0.5, car.axles[0] - 0.5];
    let count = 14;
    let step = (z[1] - z[0]) / f64::from(count);
    for k in 0..count {
        let y = car.belt - 0.32 + if k % 2 == 0 { 0.0 } else { 0.07 };
        let at = [car.half, y, z[0] + (f64::from(k) + 0.5) * step];
        all.pair("checker", solid::block(at, [0.02, 0.07, step]), TRIM);
    }
}

fn spoiler(all: &mut Assembly, car: &Car, height: f64, paint: [f32; 3]) {
    let z = car.rear + 0.26;
    let y = car.tail + height;
    for x in [-0.55, 0.55] {
        let foot = [x * car.half, car.tail - 0.03 + 0.5 * height, z];
        all.add("post", solid::block(foot, [0.05, height + 0.06, 0.16]), TRIM);
    }
    let wing = solid::rounded_block([0.0, y, z - 0.03], [1.85 * car.half, 0.05, 0.34], 0.022);
    all.add("wing", solid::rotated(wing, [0.0, y, z], [1.0, 0.0, 0.0], 0.12), paint);
}

fn rack(all: &mut Assembly, car: &Car, draw: &mut Draw) {
    let [_, head, back, _] = car.glass;
    let (from, to) = (back + 0.3, head - 0.25);
    let (x, y) = (car.cabin[1] - 0.14, car.roof + 0.06);
    let ends = [[x, y - 0.12, from], [x, y, from + 0.12], [x, y, to - 0.12], [x, y - 0.12, to]];
    for pair in ends.windows(2) {
        all.pair("rail", solid::bar(&[pair[0], pair[1]], 0.028, 1, 8), TRIM);
    }
    let bars = draw.count(2, 4);
    for k in 0..bars {
        let z = from + (to - from) * (k as f64 + 1.0) / (bars as f64 + 1.0);
        all.add("bar", solid::rod([-x, y, z], [x, y, z], [0.025; 2], 8), TRIM);
    }
    if draw.chance(0.4) {
        let size = [0.75 * x * 2.0, 0.28, 0.55 * (to - from)];
        let at = [0.0, y + 0.15, 0.5 * (from + to)];
        all.add("roof box", solid::rounded_block(at, size, 0.12), [0.2, 0.2, 0.22]);
    }
}
