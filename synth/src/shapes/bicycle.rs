//! Bicycles: classic, step-through, mountain, racing, cruiser.

mod drive;

use std::f64::consts::{PI, TAU};

use super::assembly::Assembly;
use super::draw::Draw;
use super::family::Family;
use super::shape::Shape;
use super::solid::{self, Point, add, mix, scale, sub};
use super::wheel::{RUBBER, mudguard};

const STEEL: [f32; 3] = [0.72, 0.73, 0.75];
const DARK: [f32; 3] = [0.12, 0.12, 0.13];
const X: Point = [1.0, 0.0, 0.0];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Style {
    Classic,
    StepThrough,
    Mountain,
    Racing,
    Cruiser,
}

/// Radii of wheel, tyre and tubes, wheelbase, length of the seat tube, its angle in degrees.
type Lines = [f64; 6];

/// Every style with its name and its lines.
const STYLES: [(Style, &str, Lines); 5] = [
    (Style::Classic, "classic", [0.335, 0.021, 0.019, 1.03, 0.54, 72.0]),
    (Style::StepThrough, "step-through", [0.335, 0.024, 0.021, 1.08, 0.5, 69.0]),
    (Style::Mountain, "mountain", [0.345, 0.034, 0.025, 1.1, 0.45, 71.0]),
    (Style::Racing, "racing", [0.335, 0.016, 0.018, 0.99, 0.56, 73.5]),
    (Style::Cruiser, "cruiser", [0.325, 0.034, 0.021, 1.14, 0.44, 68.0]),
];

/// The points and thicknesses that all parts hang on, metres.
struct Frame {
    style: Style,
    wheel: f64,
    tyre: f64,
    tube: f64,
    rear: Point,
    front: Point,
    /// Where the cranks turn.
    bottom: Point,
    /// Upper end of the seat tube, and the saddle.
    seat: Point,
    saddle: Point,
    /// Lower and upper end of the head tube.
    head: [Point; 2],
    color: [f32; 3],
}

impl Frame {
    fn draw(draw: &mut Draw, style: Style, lines: Lines) -> Self {
        let [wheel, tyre, tube, base, tall, angle] = lines;
        let mut vary = |value: f64, share: f64| value * draw.within(1.0 - share, 1.0 + share);
        let (base, tall) = (vary(base, 0.04), vary(tall, 0.1));
        let (wheel, tube) = (vary(wheel, 0.06), vary(tube, 0.1));
        let (sin, cos) = vary(angle, 0.02_f64).to_radians().sin_cos();
        let rear = [0.0, wheel, -0.5 * base];
        let front = [0.0, wheel, 0.5 * base];
        let bottom = [0.0, vary(0.28, 0.04), rear[2] + 0.43];
        let up = |length: f64| add(bottom, [0.0, length * sin, -length * cos]);
        // The fork comes down from the head along the steering axis, then a little forward.
        let foot = [0.0, wheel, front[2] - 0.05];
        let head = |height: f64| add(foot, scale([0.0, sin, -cos], (height - wheel) / sin));
        let clear = 2.0 * wheel + 0.09 + if style == Style::Mountain { 0.06 } else { 0.0 };
        let top = (bottom[1] + tall * sin + 0.03).max(clear + 0.12);
        let color = match draw.count(0, 4) {
            0 => draw.pick(&[[0.1, 0.1, 0.11], [0.9, 0.9, 0.88], [0.45, 0.47, 0.5]]),
            _ => draw.color([0.65, 0.95], [0.45, 0.9]),
        };
        Self {
            style,
            wheel,
            tyre,
            tube,
            rear,
            front,
            bottom,
            seat: up(tall),
            saddle: up(tall + draw.within(0.1, 0.2)),
            head: [head(clear), head(top)],
            color,
        }
    }

    /// The direction in which the steering axis points up.
    fn steering(&self) -> Point {
        solid::unit(sub(self.head[1], self.head[0]))
    }

    fn pipe(&self, a: Point, b: Point, thick: f64) -> mesh_core::TriMesh {
        let r = self.tube * thick;
        solid::rod(a, b, [r, r], 10)
    }
}

pub(super) fn draw(seed: u64) -> Shape {
    let mut draw = Draw::new(seed, 7);
    let (style, name, lines) = draw.pick(&STYLES);
    let frame = Frame::draw(&mut draw, style, lines);
    let mut all = Assembly::default();
    tubes(&mut all, &frame);
    let spokes = draw.pick(&[12, 16, 20, 24, 28]);
    let wall = match style {
        Style::Cruiser if draw.chance(0.6) => [0.93, 0.9, 0.82],
        Style::Classic | Style::Racing if draw.chance(0.3) => [0.76, 0.6, 0.42],
        _ => RUBBER,
    };
    let rim = draw.pick(&[STEEL, STEEL, DARK]);
    wheel(&mut all, &frame, frame.rear, spokes, [wall, rim]);
    drive::drive(&mut all, &frame);
    let leather = draw.pick(&[DARK, DARK, [0.42, 0.25, 0.13], [0.85, 0.82, 0.75]]);
    saddle(&mut all, &frame, leather);
    let has_fenders = match style {
        Style::Mountain | Style::Racing => false,
        _ => draw.chance(0.65),
    };
    let fender = draw.pick(&[frame.color, frame.color, STEEL, DARK]);
    if has_fenders {
        guard(&mut all, &frame, frame.rear, ([0.3 * PI, 0.97 * PI], 0.8 * PI), fender);
    }
    let carrier = match style {
        Style::Racing => draw.pick(&["none", "bottle"]),
        Style::Mountain => draw.pick(&["none", "bottle", "bottle"]),
        _ => draw.pick(&["none", "rack", "rack", "basket", "rack and basket"]),
    };
    if carrier.contains("rack") {
        rack(&mut all, &frame);
    }
    if carrier == "bottle" {
        let (a, b) =
            (mix(frame.bottom, frame.head[0], 0.4), mix(frame.bottom, frame.head[0], 0.68));
        let off = scale(solid::unit([0.0, 1.0, -0.8]), frame.tube + 0.042);
        let color = draw.color([0.5, 0.9], [0.6, 0.95]);
        all.add("bottle", solid::bar(&[add(a, off), add(b, off)], 0.038, 2, 12), color);
    }
    // From here on, what turns with the handlebar.
    let first = all.len();
    wheel(&mut all, &frame, frame.front, spokes, [wall, rim]);
    fork(&mut all, &frame);
    let handlebar = match style {
        Style::Racing => "drop",
        Style::Mountain => draw.pick(&["flat", "riser"]),
        Style::Cruiser => "swept",
        _ => draw.pick(&["flat", "swept", "riser"]),
    };
    let grips = draw.pick(&[leather, DARK]);
    bars(&mut all, &frame, handlebar, grips);
    if has_fenders {
        guard(&mut all, &frame, frame.front, ([0.28 * PI, 1.02 * PI], 0.85 * PI), fender);
    }
    if carrier.contains("basket") {
        basket(&mut all, &frame, &mut draw);
    }
    let lamp = !matches!(style, Style::Racing | Style::Mountain) && draw.chance(0.6);
    if lamp {
        let at = add(frame.head[1], [0.0, -0.06, 0.1]);
        let axis = [0.0, 0.0, 1.0];
        let profile = [[0.0, -0.06], [0.03, -0.05], [0.045, 0.0], [0.045, 0.03], [0.0, 0.035]];
        all.add("lamp", solid::turned(&profile, 14, at, axis), STEEL);
        all.add("lamp arm", solid::rod(at, add(at, [0.0, 0.03, -0.09]), [0.012; 2], 6), STEEL);
    }
    let turn = draw.within(-0.45, 0.45);
    let (about, axis) = (frame.head[0], frame.steering());
    all.move_since(first, |mesh| solid::rotated(mesh, about, axis, turn));
    let traits = vec![
        ("style", name.to_owned()),
        ("handlebar", handlebar.to_owned()),
        ("carrier", carrier.to_owned()),
        ("fenders", if has_fenders { "yes" } else { "no" }.to_owned()),
        ("lamp", if lamp { "yes" } else { "no" }.to_owned()),
        ("spokes", spokes.to_string()),
    ];
    all.finish(Family::Bicycle, seed, traits)
}

fn tubes(all: &mut Assembly, f: &Frame) {
    let color = f.color;
    let [low, high] = f.head;
    let up = f.steering();
    let under = add(high, scale(up, -0.045));
    all.add(
        "head tube",
        f.pipe(add(low, scale(up, -0.02)), add(high, scale(up, 0.015)), 1.3),
        color,
    );
    all.add(
        "seat tube",
        f.pipe(f.bottom, add(f.seat, scale(sub(f.seat, f.bottom), 0.03)), 1.0),
        color,
    );
    all.add("down tube", f.pipe(f.bottom, add(low, scale(up, 0.02)), 1.15), color);
    match f.style {
        Style::Classic | Style::Racing => {
            let back = mix(f.seat, f.bottom, 0.05);
            all.add("top tube", f.pipe(back, under, 0.95), color);
        }
        Style::Mountain => {
            let back = mix(f.seat, f.bottom, 0.18);
            all.add("top tube", f.pipe(back, under, 1.1), color);
        }
        Style::StepThrough => {
            let back = mix(f.bottom, f.seat, 0.32);
            let middle = add(mix(back, under, 0.45), [0.0, -0.1, 0.03]);
            all.add("top tube", solid::bar(&[back, middle, under], f.tube, 6, 10), color);
        }
        Style::Cruiser => {
            let back = mix(f.seat, f.bottom, 0.06);
            let middle = add(mix(back, under, 0.5), [0.0, 0.05, 0.0]);
            all.add("top tube", solid::bar(&[back, middle, under], f.tube, 6, 10), color);
            let back = mix(f.seat, f.bottom, 0.4);
            let middle = add(mix(back, under, 0.5), [0.0, 0.04, 0.0]);
            let end = add(low, scale(up, 0.05));
            let lower = [back, middle, mix(end, under, 0.3)];
            all.add("lower tube", solid::bar(&lower, 0.8 * f.tube, 6, 10), color);
        }
    }
    let wide = f.tyre + 0.035;
    let rear = add(f.rear, [wide, 0.0, 0.0]);
    let thin = [0.62 * f.tube + 0.001; 2];
    let bottom = add(f.bottom, [0.025, 0.0, 0.0]);
    all.pair("chain stay", solid::rod(bottom, rear, thin, 8), color);
    let share = if f.style == Style::StepThrough { 0.25 } else { 0.1 };
    let seat = add(mix(f.seat, f.bottom, share), [0.014, 0.0, 0.0]);
    all.pair("seat stay", solid::rod(seat, rear, thin, 8), color);
    let shell = [[-0.045, 0.0], [0.045, 0.0]].map(|[x, _]| add(f.bottom, [x, 0.0, 0.0]));
    all.add("bottom bracket", solid::rod(shell[0], shell[1], [1.5 * f.tube; 2], 12), color);
}

fn wheel(all: &mut Assembly, f: &Frame, center: Point, spokes: usize, [wall, rim]: [[f32; 3]; 2]) {
    let r = f.wheel;
    all.add("tyre", solid::hoop(center, X, [r - f.tyre, f.tyre], [48, 8]), wall);
    let section = [
        [r - 2.4 * f.tyre - 0.014, -0.010],
        [r - 1.5 * f.tyre, -0.75 * f.tyre],
        [r - 1.5 * f.tyre, 0.75 * f.tyre],
        [r - 2.4 * f.tyre - 0.014, 0.010],
    ];
    all.add("rim", solid::turned_ring(&section, 48, center, X), rim);
    let hub = [
        [0.0, -0.05],
        [0.026, -0.05],
        [0.026, -0.042],
        [0.014, -0.036],
        [0.014, 0.036],
        [0.026, 0.042],
        [0.026, 0.05],
        [0.0, 0.05],
    ];
    all.add("hub", solid::turned(&hub, 12, center, X), STEEL);
    let axle = [-1.0, 1.0].map(|s| add(center, [s * (f.tyre + 0.045), 0.0, 0.0]));
    all.add("axle", solid::rod(axle[0], axle[1], [0.009; 2], 6), STEEL);
    for k in 0..spokes {
        let angle = TAU * k as f64 / spokes as f64;
        let side = if k % 2 == 0 { 0.04 } else { -0.04 };
        // Spokes leave the flange at a tangent, by turns one way and the other.
        let lead = if k % 4 < 2 { 0.5 } else { -0.5 };
        let at = |angle: f64, radius: f64, x: f64| {
            add(center, [x, radius * angle.cos(), radius * angle.sin()])
        };
        let (a, b) = (at(angle + lead, 0.022, side), at(angle, r - 2.2 * f.tyre - 0.01, 0.0));
        all.add("spoke", solid::rod(a, b, [0.0035; 2], 4), [0.66, 0.67, 0.69]);
    }
}

fn fork(all: &mut Assembly, f: &Frame) {
    let up = f.steering();
    let wide = f.tyre + 0.035;
    let crown = add(f.head[0], scale(up, -0.03));
    let shoulder = add(crown, [wide, 0.0, 0.0]);
    let foot = add(f.front, [wide, 0.0, 0.0]);
    if f.style == Style::Mountain {
        // Telescopic: thin bright stanchions in thick legs.
        let middle = mix(shoulder, foot, 0.45);
        all.pair("stanchion", solid::rod(shoulder, middle, [0.017; 2], 10), STEEL);
        all.pair("fork leg", solid::rod(mix(shoulder, foot, 0.36), foot, [0.026; 2], 10), DARK);
    } else {
        let middle = add(mix(shoulder, foot, 0.72), [0.0, 0.0, -0.012]);
        let path = [shoulder, mix(shoulder, middle, 0.5), middle, foot];
        all.pair("fork leg", solid::bar(&path, 0.72 * f.tube, 4, 8), f.color);
    }
    let across = [2.0 * wide + 0.045, 0.045, 0.05];
    all.add("fork crown", solid::rounded_block(crown, across, 0.02), f.color);
    let stem = add(f.head[1], scale(up, 0.06));
    all.add("steerer", solid::rod(crown, stem, [0.015; 2], 10), STEEL);
}

fn bars(all: &mut Assembly, f: &Frame, kind: &str, grips: [f32; 3]) {
    let up = f.steering();
    let rise = match kind {
        "drop" => 0.03,
        "flat" => 0.06,
        _ => 0.1,
    };
    let top = add(f.head[1], scale(up, rise));
    let reach = if kind == "drop" { 0.1 } else { 0.06 };
    let clamp = add(top, [0.0, 0.0, reach]);
    all.add("stem", solid::rod(add(f.head[1], scale(up, 0.01)), top, [0.017; 2], 10), STEEL);
    all.add("stem", solid::bar(&[top, clamp], 0.019, 1, 10), STEEL);
    let half: Vec<Point> = match kind {
        "drop" => vec![
            [0.0, 0.0, 0.0],
            [0.17, 0.0, 0.0],
            [0.205, 0.0, 0.03],
            [0.21, -0.01, 0.085],
            [0.212, -0.055, 0.115],
            [0.214, -0.11, 0.09],
            [0.216, -0.13, 0.02],
            [0.218, -0.135, -0.04],
        ],
        "flat" => vec![[0.0, 0.0, 0.0], [0.16, 0.0, 0.0], [0.31, 0.0, -0.03]],
        "riser" => vec![
            [0.0, 0.0, 0.0],
            [0.07, 0.0, 0.0],
            [0.13, 0.06, -0.005],
            [0.2, 0.065, -0.02],
            [0.35, 0.06, -0.06],
        ],
        _ => vec![
            [0.0, 0.0, 0.0],
            [0.1, 0.04, 0.03],
            [0.2, 0.1, 0.02],
            [0.28, 0.1, -0.08],
            [0.3, 0.07, -0.22],
        ],
    };
    let path: Vec<Point> = half.iter().map(|&p| add(clamp, p)).collect();
    all.add("handlebar", solid::bar(&solid::both_sides(&path), 0.0145, 4, 8), STEEL);
    let n = path.len();
    let grip: Vec<Point> = if kind == "drop" {
        path[2..].to_vec()
    } else {
        vec![mix(path[n - 2], path[n - 1], 0.25), add(path[n - 1], [0.004, 0.0, 0.0])]
    };
    all.pair("grip", solid::bar(&grip, 0.021, 3, 8), grips);
    let lever = if kind == "drop" { path[3] } else { mix(path[n - 2], path[n - 1], 0.3) };
    let tip = if kind == "drop" {
        add(lever, [0.005, -0.1, 0.075])
    } else {
        add(lever, [0.1, -0.025, 0.05])
    };
    let knee = add(lever, [0.0, 0.0, 0.05]);
    all.pair("brake lever", solid::bar(&[lever, knee, tip], 0.009, 3, 6), DARK);
}

fn saddle(all: &mut Assembly, f: &Frame, color: [f32; 3]) {
    let top = f.saddle;
    all.add("seat post", solid::rod(mix(f.bottom, f.seat, 0.8), top, [0.0135; 2], 10), STEEL);
    let long = if f.style == Style::Racing { 0.28 } else { 0.26 };
    let wide = match f.style {
        Style::Racing => 0.068,
        Style::Mountain => 0.075,
        Style::Cruiser => 0.12,
        _ => 0.1,
    };
    // From nose to tail: place, half width, height of the top, thickness.
    let cuts = [
        (0.52, 0.012, 0.0, 0.02),
        (0.5, 0.022, 0.006, 0.035),
        (0.2, 0.034, 0.008, 0.045),
        (-0.1, 0.55 * wide, 0.006, 0.05),
        (-0.3, 0.95 * wide, 0.014, 0.055),
        (-0.44, wide, 0.024, 0.055),
        (-0.5, 0.75 * wide, 0.022, 0.04),
    ];
    let rings: Vec<Vec<Point>> = cuts
        .iter()
        .map(|&(share, half, rise, thick)| {
            let ring = solid::superellipse([half, 0.5 * thick], 2.6, 14);
            let y = top[1] + rise + 0.03 - 0.5 * thick;
            ring.into_iter().map(|[x, b]| [x, y + b, top[2] + share * long]).collect()
        })
        .collect();
    all.add("saddle", solid::loft(&rings), color);
}

/// A mudguard with its stays, which hold it at an angle.
fn guard(
    all: &mut Assembly,
    f: &Frame,
    center: Point,
    (angles, held): ([f64; 2], f64),
    color: [f32; 3],
) {
    let (r, half) = (f.wheel + 0.018, f.tyre + 0.012);
    all.add("mudguard", mudguard(center, [r, half], angles, 0.012), color);
    let (sin, cos) = held.sin_cos();
    let tip = add(center, [half, (r - 0.012) * sin, (r - 0.012) * cos]);
    let root = add(center, [f.tyre + 0.04, 0.0, 0.0]);
    all.pair("stay", solid::rod(root, tip, [0.005; 2], 5), STEEL);
}

fn rack(all: &mut Assembly, f: &Frame) {
    let y = 2.0 * f.wheel + 0.07;
    let (front, back) = (f.rear[2] + 0.16, f.rear[2] - 0.26);
    let x = 0.06;
    let loop_ = [[x, y, front], [x, y, back], [0.0, y, back - 0.03]];
    all.pair("rack", solid::bar(&loop_, 0.009, 3, 6), DARK);
    for k in 0..4 {
        let z = front + (back - front) * (f64::from(k) + 0.2) / 3.4;
        all.add("rack", solid::rod([-x, y, z], [x, y, z], [0.008; 2], 6), DARK);
    }
    let foot = add(f.rear, [f.tyre + 0.045, 0.0, 0.0]);
    all.pair("rack leg", solid::rod(foot, [x, y, f.rear[2] - 0.1], [0.008; 2], 6), DARK);
    let joint = add(mix(f.seat, f.bottom, 0.25), [0.015, 0.0, 0.0]);
    all.pair("rack leg", solid::rod([x, y, front], joint, [0.008; 2], 6), DARK);
    let at = [0.0, y - 0.02, back - 0.04];
    all.add("tail light", solid::rounded_block(at, [0.07, 0.05, 0.03], 0.012), [0.8, 0.05, 0.05]);
}

fn basket(all: &mut Assembly, f: &Frame, draw: &mut Draw) {
    let color = draw.pick(&[[0.68, 0.5, 0.3], [0.45, 0.3, 0.17], [0.25, 0.25, 0.27]]);
    let size = [0.36, 0.22, 0.26];
    let base = add(f.head[1], [0.0, -0.1, 0.21]);
    let ring = |grow: f64, y: f64| -> Vec<Point> {
        let sides = [size[0] * grow, size[2] * grow];
        let ring = solid::rounded_rectangle(sides, 0.06, 3).into_iter();
        ring.map(|[x, z]| add(base, [x, y, z])).collect()
    };
    // One skin: up the outside, over the rim, down the inside, across the floor.
    let h = size[1];
    let mut rings = vec![ring(0.78, 0.0)];
    rings.extend([ring(0.86, 0.33 * h), ring(0.93, 0.66 * h), ring(1.0, h - 0.012)]);
    rings.extend([ring(1.05, h - 0.01), ring(1.05, h + 0.012), ring(0.95, h + 0.012)]);
    rings.extend([ring(0.86, 0.5 * h), ring(0.7, 0.02)]);
    let skin = solid::loft(&rings);
    all.painted("basket", skin, |p| {
        let level = ((p[1] - base[1]) / h * 3.0).round() as i32;
        if level % 2 == 0 { color } else { color.map(|v| 0.82 * v) }
    });
    let arm = add(base, [0.0, 0.6 * h, -0.5 * size[2]]);
    all.add("bracket", solid::rod(arm, add(f.head[1], [0.0, 0.03, 0.0]), [0.014; 2], 6), DARK);
}

#[cfg(test)]
mod tests {
    use super::super::tests::check;
    use super::*;

    #[test]
    fn bicycles_are_sound_and_differ() {
        check(
            Family::Bicycle,
            &[
                ("style", &["classic", "step-through", "mountain", "racing", "cruiser"]),
                ("handlebar", &["drop", "flat", "riser", "swept"]),
                ("carrier", &["none", "rack", "basket", "rack and basket", "bottle"]),
                ("fenders", &["no", "yes"]),
                ("lamp", &["no", "yes"]),
                ("spokes", &["12", "16", "20", "24", "28"]),
            ],
        );
    }
}
