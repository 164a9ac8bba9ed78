//! Cars: sedan, hatchback, SUV, pickup, sports car, van.

mod extras;

use super::assembly::Assembly;
use super::coachwork::cut_arches;
use super::draw::Draw;
use super::family::Family;
use super::shape::Shape;
use super::solid::{self, Point};
use super::wheel::{RUBBER, Wheel};

const GLASS: [f32; 3] = [0.13, 0.17, 0.21];
const TRIM: [f32; 3] = [0.10, 0.10, 0.11];
const CHROME: [f32; 3] = [0.74, 0.75, 0.77];
const HEADLIGHT: [f32; 3] = [0.97, 0.96, 0.86];
const TAILLIGHT: [f32; 3] = [0.80, 0.06, 0.06];

/// Radius of the arch over a wheel, in radii of the wheel.
const ARCH: f64 = 1.13;
/// Shares of the half width at which the body is cut lengthwise.
const CUTS: [f64; 11] = [-1.0, -0.985, -0.94, -0.86, -0.84, 0.0, 0.84, 0.86, 0.94, 0.985, 1.0];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Style {
    Sedan,
    Hatchback,
    Suv,
    Pickup,
    Sports,
    Van,
}

/// Length, width, height, ground, wheel; nose, cowl, belt, tail; windscreen foot and head from the
/// front, rear window's head and foot from the rear; overhangs.
type Lines = [f64; 15];

/// Every style with its name and its lines.
const STYLES: [(Style, &str, Lines); 6] = [
    (
        Style::Sedan,
        "sedan",
        [4.7, 1.82, 1.45, 0.2, 0.33, 0.72, 0.95, 0.98, 1.02, 1.25, 2.0, 1.55, 0.8, 0.86, 0.98],
    ),
    (
        Style::Hatchback,
        "hatchback",
        [3.95, 1.75, 1.5, 0.2, 0.31, 0.75, 0.98, 1.0, 0.98, 0.95, 1.6, 0.5, 0.18, 0.72, 0.62],
    ),
    (
        Style::Suv,
        "suv",
        [4.65, 1.9, 1.78, 0.28, 0.38, 0.95, 1.14, 1.17, 1.17, 1.25, 1.85, 0.38, 0.16, 0.84, 0.85],
    ),
    (
        Style::Pickup,
        "pickup",
        [5.35, 1.92, 1.82, 0.32, 0.4, 1.0, 1.16, 1.19, 1.19, 1.45, 2.0, 2.05, 1.9, 0.9, 1.15],
    ),
    (
        Style::Sports,
        "sports",
        [4.4, 1.92, 1.25, 0.14, 0.31, 0.69, 0.86, 0.9, 0.93, 1.45, 2.2, 1.5, 0.45, 0.9, 0.85],
    ),
    (
        Style::Van,
        "van",
        [5.0, 1.95, 2.15, 0.22, 0.35, 0.95, 1.2, 1.22, 1.22, 0.62, 1.35, 0.2, 0.13, 0.86, 0.95],
    ),
];

/// The lines of a car, metres. Heights are above the ground.
struct Car {
    style: Style,
    half: f64,
    front: f64,
    rear: f64,
    ground: f64,
    wheel: f64,
    /// Where the axles are.
    axles: [f64; 2],
    /// Heights of the nose, of the cowl under the windscreen, of the belt line and of the tail.
    nose: f64,
    cowl: f64,
    belt: f64,
    tail: f64,
    roof: f64,
    /// From the front: foot and head of the windscreen, head and foot of the rear window.
    glass: [f64; 4],
    /// Half widths of the cabin at belt and roof.
    cabin: [f64; 2],
}

impl Car {
    fn draw(draw: &mut Draw, style: Style, lines: Lines) -> Self {
        let [l, w, h, g, r, nose, cowl, belt, tail, a, b, c, d, ahead, behind] = lines;
        let mut vary = |value: f64, share: f64| value * draw.within(1.0 - share, 1.0 + share);
        let stretch = vary(1.0, 0.07);
        let (l, w, h) = (l * stretch, vary(w, 0.03), vary(h, 0.05));
        let (front, rear) = (0.5 * l, -0.5 * l);
        let (wheel, nose, cowl) = (vary(r, 0.07), vary(nose, 0.04), vary(cowl, 0.02));
        // The arch stays clear of the hood over it.
        let wheel = wheel.min((0.5 * (nose + cowl) - 0.13) / (1.0 + ARCH));
        Self {
            style,
            half: 0.5 * w,
            front,
            rear,
            ground: vary(g, 0.1),
            wheel,
            axles: [
                front - (ahead * stretch).max(ARCH * wheel + 0.36),
                rear + (behind * stretch).max(ARCH * wheel + 0.38),
            ],
            nose,
            cowl,
            belt,
            tail: vary(tail, 0.03),
            roof: h,
            glass: [
                front - vary(a, 0.08) * stretch,
                front - vary(b, 0.05) * stretch,
                rear + vary(c, 0.12) * stretch,
                rear + d * stretch,
            ],
            cabin: [0.5 * w - 0.07, 0.5 * w * vary(0.77, 0.04)],
        }
    }

    /// The side view `[z, y]` at a share of the half width, wheel arches cut out.
    fn outline(&self, share: f64) -> Vec<[f64; 2]> {
        let s = share.abs();
        // Corners are round seen from above, shoulders round seen from the front.
        let bend = (s.powi(8) * 0.18 + s.powi(2) * 0.05) * self.half / 0.9;
        let drop = 0.015 * s * s + 0.085 * s.powi(24);
        let (f, r) = (self.front - bend, self.rear + bend);
        let sill = self.ground + 0.05 * s.powi(24);
        let mut points = vec![[f - 0.06, sill + 0.06], [f, sill + 0.14]];
        let nose = self.nose - drop;
        points.extend([[f - 0.01, 0.6 * nose + 0.4 * sill], [f - 0.05, nose - 0.07]]);
        points.extend([[f - 0.14, nose], [f - 0.14 - 0.4 * (f - 0.14 - self.glass[0]), 0.0]]);
        let cowl = self.cowl - drop;
        points[5][1] = nose + 0.55 * (cowl - nose);
        points.push([self.glass[0], cowl]);
        let [belt, tail] = [self.belt, self.tail].map(|y| y - drop);
        points.push([0.5 * (self.glass[1] + self.glass[2]), belt]);
        let bed = if self.style == Style::Pickup && s < 0.85 { self.wheel + 0.35 } else { tail };
        let start = self.glass[3].max(r + 0.16);
        points.extend([[start - 0.01, tail], [start - 0.03, bed]]);
        points.extend([[r + 0.10, bed], [r + 0.08, tail], [r + 0.02, tail - 0.06]]);
        points.extend([[r, 0.5 * (sill + tail)], [r + 0.02, sill + 0.14], [r + 0.08, sill + 0.06]]);
        let axles = [self.axles[1], self.axles[0]];
        cut_arches(&mut points, sill, &axles, self.wheel, ARCH * self.wheel);
        points
    }

    fn body(&self) -> mesh_core::TriMesh {
        let sections: Vec<Vec<Point>> = CUTS
            .iter()
            .map(|&s| self.outline(s).into_iter().map(|[z, y]| [s * self.half, y, z]).collect())
            .collect();
        solid::loft(&sections)
    }

    /// Half width and rear and front end of the cabin at a share of its height.
    fn cabin_at(&self, t: f64) -> [f64; 3] {
        let [a, b, c, d] = self.glass;
        let [wide, narrow] = self.cabin;
        [wide + (narrow - wide) * t, d + (c - d) * t, a + (b - a) * t]
    }

    fn level(&self, t: f64) -> f64 {
        let base = self.belt.min(self.cowl) - 0.03;
        base + (self.roof - base) * t
    }

    fn cabin(&self) -> mesh_core::TriMesh {
        let rings = [(-0.1, 0.0), (0.0, 0.0), (0.5, -0.012), (0.86, 0.01), (0.94, 0.04)];
        let rings = rings.into_iter().chain([(0.98, 0.1), (1.0, 0.25)]);
        let section = |(t, inset): (f64, f64)| -> Vec<Point> {
            let [x, r, f] = self.cabin_at(t);
            let sides = [2.0 * (x - inset), f - r - 2.0 * inset];
            let ring = solid::rounded_rectangle(sides, 0.14, 4);
            ring.into_iter().map(|[x, z]| [x, self.level(t), z + 0.5 * (f + r)]).collect()
        };
        solid::loft(&rings.map(section).collect::<Vec<_>>())
    }

    /// A window in the side of the cabin between two shares of its length.
    fn side_window(&self, from: f64, to: f64, heights: [f64; 2]) -> mesh_core::TriMesh {
        let corner = |share: f64, t: f64| {
            let [x, r, f] = self.cabin_at(t);
            [x, self.level(t), r + (f - r) * share]
        };
        let corners = [(from, 0), (from, 1), (to, 1), (to, 0)].map(|(s, k)| corner(s, heights[k]));
        solid::plate(|u, v| solid::bilinear(corners, u, v), [4, 4], [0.05, 0.022])
    }

    /// A window across the front (`end` 2) or rear (`end` 1) of the cabin.
    fn end_window(&self, end: usize, heights: [f64; 2]) -> mesh_core::TriMesh {
        let corner = |side: f64, t: f64| {
            let at = self.cabin_at(t);
            [side * (at[0] - 0.11), self.level(t), at[end]]
        };
        let out = if end == 2 { 1.0 } else { -1.0 };
        let corners =
            [(-out, 0), (out, 0), (out, 1), (-out, 1)].map(|(s, k)| corner(s, heights[k]));
        solid::plate(|u, v| solid::bilinear(corners, u, v), [4, 4], [0.06, 0.02])
    }

    /// How high the hood is.
    fn hood(&self, z: f64) -> f64 {
        let points = self.outline(0.0);
        let share = |a: [f64; 2], b: [f64; 2]| a[1] + (b[1] - a[1]) * (z - a[0]) / (b[0] - a[0]);
        if z > points[5][0] { share(points[4], points[5]) } else { share(points[5], points[6]) }
    }
}

pub(super) fn draw(seed: u64) -> Shape {
    let mut draw = Draw::new(seed, 2);
    let (style, name, lines) = draw.pick(&STYLES);
    let car = Car::draw(&mut draw, style, lines);
    let paint = paint(&mut draw);
    let livery = match style {
        Style::Sports => draw.pick(&["plain", "stripes", "stripes"]),
        Style::Sedan => draw.pick(&["plain", "plain", "taxi", "police", "two-tone"]),
        Style::Van => draw.pick(&["plain", "two-tone", "band"]),
        _ => draw.pick(&["plain", "plain", "two-tone"]),
    };
    let (paint, second) = match livery {
        "taxi" => ([0.95, 0.75, 0.08], [0.95, 0.75, 0.08]),
        "police" => ([0.10, 0.11, 0.14], [0.93, 0.93, 0.94]),
        "two-tone" => (paint, draw.pick(&[[0.95, 0.95, 0.93], [0.09, 0.09, 0.10]])),
        _ => (paint, paint),
    };
    let mut all = Assembly::default();
    all.add("body", car.body(), paint);
    let open = style == Style::Sports && draw.chance(0.35);
    let top = if matches!(livery, "two-tone" | "police") { second } else { paint };
    let doors = if open {
        cockpit(&mut all, &car, &mut draw, paint);
        1
    } else {
        all.add("cabin", car.cabin(), top);
        windows(&mut all, &car, &mut draw)
    };
    if style == Style::Pickup {
        bed(&mut all, &car);
    }
    ends(&mut all, &car, &mut draw);
    sides(&mut all, &car, paint, doors);
    let spokes = wheels(&mut all, &car, &mut draw);
    let extra = extras::extras(&mut all, &car, &mut draw, (livery, open), paint);
    all.finish(
        Family::Car,
        seed,
        vec![
            ("style", name.to_owned()),
            ("livery", livery.to_owned()),
            ("roof", if open { "open" } else { "closed" }.to_owned()),
            ("extra", extra.to_owned()),
            ("spokes", spokes.to_string()),
            ("doors", doors.to_string()),
        ],
    )
}

/// Colours that cars come in: mostly white, greys and black, the rest strong.
fn paint(draw: &mut Draw) -> [f32; 3] {
    if draw.chance(0.35) {
        let gray = draw.pick(&[0.95, 0.82, 0.62, 0.4, 0.22]) as f32;
        return [gray, gray, gray * 1.02_f32.min(1.0 / gray)];
    }
    let hue = draw.pick(&[0.0, 0.0, 0.01, 0.06, 0.12, 0.33, 0.52, 0.58, 0.6, 0.63, 0.92]);
    super::draw::hsv(hue, draw.within(0.6, 0.92), draw.within(0.45, 0.9))
}

/// The inside of an open car: a dark well, seats, a framed windscreen.
fn cockpit(all: &mut Assembly, car: &Car, draw: &mut Draw, paint: [f32; 3]) {
    let leather =
        draw.pick(&[[0.45, 0.27, 0.15], [0.16, 0.16, 0.17], [0.82, 0.76, 0.66], [0.6, 0.1, 0.1]]);
    let [foot, _, back, _] = car.glass;
    let (from, to) = (back - 0.15, foot - 0.2);
    let y = car.belt;
    let well = [1.72 * car.cabin[1], 0.12, to - from];
    all.add("well", solid::rounded_block([0.0, y - 0.03, 0.5 * (from + to)], well, 0.05), TRIM);
    for x in [-0.42, 0.42] {
        let x = x * car.half;
        let z = from + 0.32;
        let rest = solid::rounded_block([x, y + 0.1, z], [0.44, 0.46, 0.14], 0.06);
        all.add("seat", solid::rotated(rest, [x, y, z], [1.0, 0.0, 0.0], -0.2), leather);
        let pillow = solid::rounded_block([x, y + 0.38, z - 0.07], [0.24, 0.15, 0.1], 0.045);
        all.add("headrest", pillow, leather);
        all.add("seat", solid::rounded_block([x, y, z + 0.3], [0.44, 0.16, 0.45], 0.06), leather);
        let hoop = [[x - 0.17, y, z - 0.2], [x - 0.15, y + 0.33, z - 0.22]];
        let hoop = [hoop[0], hoop[1], [x + 0.15, y + 0.33, z - 0.22], [x + 0.17, y, z - 0.2]];
        for pair in hoop.windows(2) {
            all.add("hoop", solid::bar(&[pair[0], pair[1]], 0.028, 1, 10), CHROME);
        }
    }
    let wheel = [0.42 * car.half, y + 0.14, from + 0.95];
    all.add("steering wheel", solid::hoop(wheel, [0.0, 0.4, -1.0], [0.17, 0.022], [20, 6]), TRIM);
    all.add("windscreen", car.end_window(2, [0.0, 0.8]), GLASS);
    let corner = |side: f64, t: f64| {
        let at = car.cabin_at(t);
        [side * (at[0] - 0.1), car.level(t), at[2]]
    };
    let frame = [corner(-1.0, 0.0), corner(-1.0, 0.8), corner(1.0, 0.8), corner(1.0, 0.0)];
    for pair in frame.windows(2) {
        all.add("frame", solid::bar(&[pair[0], pair[1]], 0.035, 1, 10), paint);
    }
}

/// The liner in a pickup's bed.
fn bed(all: &mut Assembly, car: &Car) {
    let (from, to) = (car.rear + 0.14, car.glass[3] - 0.06);
    let at = [0.0, car.wheel + 0.35, 0.5 * (from + to)];
    all.add("liner", solid::block(at, [1.66 * car.half, 0.04, to - from]), TRIM);
}

/// Adds the windows; returns the number of doors on a side.
fn windows(all: &mut Assembly, car: &Car, draw: &mut Draw) -> usize {
    let high = [0.14, 0.84];
    all.add("windscreen", car.end_window(2, [0.1, 0.9]), GLASS);
    let rear = match car.style {
        Style::Pickup => [0.25, 0.85],
        Style::Van | Style::Suv => [0.2, 0.85],
        _ => [0.12, 0.9],
    };
    all.add("rear window", car.end_window(1, rear), GLASS);
    let (doors, panes): (usize, Vec<[f64; 2]>) = match car.style {
        Style::Sports => (1, vec![[0.3, 0.9]]),
        Style::Hatchback if draw.chance(0.5) => (1, vec![[0.08, 0.44], [0.47, 0.9]]),
        Style::Hatchback => (2, vec![[0.08, 0.48], [0.51, 0.9]]),
        Style::Sedan => (2, vec![[0.14, 0.5], [0.53, 0.9]]),
        Style::Suv => (2, vec![[0.05, 0.28], [0.31, 0.58], [0.61, 0.92]]),
        Style::Pickup if draw.chance(0.5) => (1, vec![[0.15, 0.88]]),
        Style::Pickup => (2, vec![[0.1, 0.46], [0.5, 0.9]]),
        Style::Van if draw.chance(0.5) => (1, vec![[0.72, 0.93]]),
        Style::Van => (2, vec![[0.04, 0.35], [0.38, 0.68], [0.72, 0.93]]),
    };
    let high = if car.style == Style::Van { [0.2, 0.78] } else { high };
    for [from, to] in panes {
        all.pair("window", car.side_window(from, to, high), GLASS);
    }
    doors
}

/// Lights, grille, bumpers, plates.
fn ends(all: &mut Assembly, car: &Car, draw: &mut Draw) {
    let (f, r, half) = (car.front, car.rear, car.half);
    let tall = car.nose - car.ground;
    let light = draw.pick(&[[0.36, 0.13], [0.26, 0.17], [0.44, 0.1]]);
    let y = car.nose - 0.06 - 0.6 * light[1];
    let x = 0.9 * half - 0.5 * light[0];
    let bend = 0.19 * half;
    let head = solid::rounded_block([x, y, f - 0.5 * bend - 0.09], [light[0], light[1], 0.3], 0.05);
    all.pair("headlight", solid::rotated(head, [x, y, f - 0.1], [0.0, 1.0, 0.0], 0.22), HEADLIGHT);
    let grille = [2.0 * (x - 0.55 * light[0]), draw.within(0.14, 0.3) * tall];
    let grille_y = car.nose - 0.1 - 0.5 * grille[1];
    let face = f - 0.06;
    all.add(
        "grille",
        solid::rounded_block([0.0, grille_y, face], [grille[0], grille[1], 0.13], 0.04),
        TRIM,
    );
    if draw.chance(0.5) {
        let bar = [grille[0] * 0.96, 0.035, 0.15];
        all.add("badge bar", solid::rounded_block([0.0, grille_y, face], bar, 0.01), CHROME);
    }
    let intake = [1.5 * half, 0.22 * tall, 0.14];
    let low = car.ground + 0.05 + 0.5 * intake[1];
    all.add("intake", solid::rounded_block([0.0, low, f - 0.09], intake, 0.05), TRIM);
    let plate = [0.46, 0.11, 0.04];
    all.add(
        "plate",
        solid::block([0.0, low + 0.03, f + 0.01], [0.46, 0.1, 0.05]),
        [0.93, 0.93, 0.9],
    );
    let rear_low = [1.6 * half, 0.2, 0.14];
    all.add(
        "rear bumper",
        solid::rounded_block([0.0, car.ground + 0.2, r + 0.06], rear_low, 0.05),
        TRIM,
    );
    let tail = car.tail - car.ground;
    all.add(
        "plate",
        solid::block([0.0, car.ground + 0.55 * tail, r + 0.01], plate),
        [0.93, 0.93, 0.9],
    );
    let upright = matches!(car.style, Style::Suv | Style::Van | Style::Pickup);
    let size = if upright { [0.15, 0.36] } else { [0.38, 0.14] };
    let depth = if car.style == Style::Pickup { 0.18 } else { 0.28 };
    let x = 0.93 * half - 0.5 * size[0];
    let y = car.tail - 0.1 - 0.5 * size[1];
    let lamp = solid::rounded_block([x, y, r + 0.08], [size[0], size[1], depth], 0.04);
    all.pair("taillight", solid::rotated(lamp, [x, y, r + 0.1], [0.0, 1.0, 0.0], -0.2), TAILLIGHT);
}

/// Door joints, handles, sills, mirrors.
fn sides(all: &mut Assembly, car: &Car, paint: [f32; 3], doors: usize) {
    let dark = paint.map(|v| 0.45 * v);
    let arch = ARCH * car.wheel + 0.06;
    let [front, rear] = car.axles;
    let (a, b) = (front - arch - 0.02, rear + arch + 0.02);
    let (low, high) = (car.ground + 0.14, car.belt - 0.13);
    let joints: Vec<f64> = match doors {
        1 => vec![a, (a - 1.15).max(b)],
        _ => vec![a, 0.5 * (a + b) + 0.03, b],
    };
    for &z in &joints {
        let at = [car.half, 0.5 * (low + high), z];
        all.pair("joint", solid::block(at, [0.012, high - low, 0.022]), dark);
    }
    for pair in joints.windows(2) {
        let at = [car.half + 0.005, high - 0.07, pair[1] + 0.15];
        all.pair("handle", solid::rounded_block(at, [0.04, 0.035, 0.17], 0.015), dark);
    }
    let sill = solid::rounded_block(
        [car.half - 0.05, car.ground + 0.07, 0.5 * (front + rear)],
        [0.14, 0.1, front - rear - 2.2 * car.wheel],
        0.03,
    );
    all.pair("sill", sill, TRIM);
    let at = [car.half + 0.08, car.belt + 0.07, car.glass[0] - 0.22];
    all.pair("mirror", solid::rounded_block(at, [0.22, 0.14, 0.11], 0.045), paint);
}

fn wheels(all: &mut Assembly, car: &Car, draw: &mut Draw) -> usize {
    let spokes = draw.pick(&[0, 5, 5, 6, 8, 10]);
    let wheel = Wheel {
        radius: car.wheel,
        width: 0.25 * (car.wheel / 0.33),
        rim: draw.within(0.6, 0.74),
        spokes,
        open: false,
        color: draw.pick(&[CHROME, [0.6, 0.61, 0.63], [0.3, 0.3, 0.32]]),
    };
    for z in car.axles {
        for out in [-1.0, 1.0] {
            let x = out * (car.half + 0.015 - 0.5 * wheel.width);
            wheel.build(all, [x, car.wheel, z], out);
        }
        // What is seen through the arch behind the wheel.
        let axle = [[-0.7, 0.0], [0.7, 0.0]].map(|[x, _]| [x * car.half, car.wheel, z]);
        all.add("axle", solid::rod(axle[0], axle[1], [0.07; 2], 8), RUBBER);
    }
    spokes
}

#[cfg(test)]
mod tests {
    use super::super::tests::check;
    use super::*;

    #[test]
    fn cars_are_sound_and_differ() {
        check(
            Family::Car,
            &[
                ("style", &["sedan", "hatchback", "suv", "pickup", "sports", "van"]),
                ("livery", &["plain", "two-tone", "taxi", "police", "stripes", "band"]),
                ("extra", &["none", "sign", "beacon", "spoiler", "lip", "rack", "roll bar"]),
                ("roof", &["open", "closed"]),
                ("spokes", &["0", "5", "6", "8", "10"]),
                ("doors", &["1", "2"]),
            ],
        );
    }
}
