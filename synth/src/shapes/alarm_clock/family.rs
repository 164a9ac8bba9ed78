//! Alarm clocks of many kinds: what is drawn from a seed, beside the one clock of the demo.

use std::f64::consts::PI;

use mesh_core::{TriMesh, primitives};

use crate::shapes::draw::{Draw, hsv};
use crate::shapes::family::Family;
use crate::shapes::joinery::{
    Point, block, curve, ellipse, moved, pitched, plate, rod, rolled, sphere, turned,
};
use crate::shapes::paint::{Color, Paint};
use crate::shapes::shape::Shape;
use crate::shapes::solid::{on_ellipse, rounded_rectangle};
use crate::shapes::workpiece::Workpiece;

/// The outline of its body.
const BODIES: [&str; 3] = ["round", "square", "arched"];
/// What it stands on.
const FEET: [&str; 4] = ["pegs", "balls", "plinth", "bars"];
/// What is on top, beside bells.
#[cfg(test)]
const TOPS: [&str; 5] = ["handle", "hammer", "knob", "button", "none"];
/// How the hours are marked.
const MARKS: [&str; 4] = ["ticks", "dots", "quarters", "bars"];

pub(in crate::shapes) fn draw(seed: u64) -> Shape {
    let draw = &mut Draw::new(seed, 9);
    let mut clock = Clock::new(draw);
    clock.body(draw);
    clock.dial(draw);
    clock.hands(draw);
    clock.top(draw);
    clock.feet(draw);
    clock.made.finish(Family::AlarmClock, seed)
}

/// A clock being made: half its body's width is 1, the middle of its dial on the Z axis.
struct Clock {
    made: Workpiece,
    body: &'static str,
    depth: f64,
    /// Of the dial.
    radius: f64,
    shell: Paint,
    metal: Paint,
    dial: Color,
    ink: Color,
}

impl Clock {
    fn new(draw: &mut Draw) -> Self {
        let body = draw.pick(&BODIES);
        let material = if body == "round" {
            draw.pick(&["lacquer", "lacquer", "metal"])
        } else {
            draw.pick(&["lacquer", "wood", "metal"])
        };
        let shell = Paint::of(material, draw);
        let dark = draw.chance(0.2);
        let paper = hsv(draw.within(0.0, 1.0), draw.within(0.02, 0.12), draw.within(0.9, 0.98));
        let ink = hsv(draw.within(0.0, 1.0), draw.within(0.2, 0.6), draw.within(0.08, 0.22));
        let (dial, ink) = if dark { (ink, paper) } else { (paper, ink) };
        let mut made = Workpiece::default();
        made.note("body", body);
        made.note("material", material);
        made.note("dial", if dark { "dark" } else { "light" });
        let depth = draw.within(0.55, 0.95);
        let radius = if body == "round" { draw.within(0.8, 0.88) } else { draw.within(0.7, 0.84) };
        Self { made, body, depth, radius, shell, metal: Paint::metal(draw), dial, ink }
    }

    fn body(&mut self, draw: &mut Draw) {
        let outline = match self.body {
            "round" => ellipse(2.0, 2.0, 72),
            "square" => rounded_rectangle([2.0; 2], draw.within(0.12, 0.5), 6),
            _ => {
                let round = 0.1;
                let arch = |k| on_ellipse([0.0; 2], [1.0; 2], PI * f64::from(k) / 36.0);
                let mut outline: Vec<[f64; 2]> = (0..=36).map(arch).collect();
                for (x, from) in [(-1.0 + round, 180.0), (1.0 - round, 270.0)] {
                    let angle = |k| (from + 18.0 * f64::from(k)).to_radians();
                    let corner = |k| on_ellipse([x, -1.0 + round], [round; 2], angle(k));
                    outline.extend((0..=5).map(corner));
                }
                outline
            }
        };
        let shell = self.shell.along(2).on(plate(&outline, self.depth, 0.11, 3));
        self.made.add("body", shell);
        let front = 0.5 * self.depth;
        let rim = primitives::torus((self.radius + 0.02) as f32, 0.055, 56, 10);
        let rim = moved(pitched(rim, 90.0), [0.0, 0.0, front + 0.01]);
        self.made.add("rim", self.metal.on(rim));
        let dial = plate(&ellipse(2.0 * self.radius, 2.0 * self.radius, 56), 0.06, 0.01, 2);
        let dial = moved(dial, [0.0, 0.0, front - 0.01]).colored(self.dial);
        self.made.add("dial", dial);
    }

    /// How far the dial stands out.
    fn front(&self) -> f64 {
        0.5 * self.depth + 0.02
    }

    /// A flat part on the dial, made upright, turned clockwise by a share of the full turn.
    fn on_dial(&mut self, name: &'static str, part: TriMesh, turns: f64) {
        let part = moved(rolled(part, -360.0 * turns), [0.0, 0.0, self.front()]);
        self.made.add(name, part);
    }

    fn dial(&mut self, draw: &mut Draw) {
        let marks = draw.pick(&MARKS);
        self.made.note("marks", marks);
        let far = self.radius * 0.88;
        let ink = Paint::Plain(self.ink);
        let bar = |wide: f64, long: f64| {
            moved(block([wide, long, 0.04], 0.008, [1, 2, 1], ink), [0.0, far - 0.5 * long, 0.0])
        };
        for hour in 0..12 {
            let turns = f64::from(hour) / 12.0;
            let main = hour % 3 == 0;
            match marks {
                "ticks" => {
                    let (wide, long) = if main { (0.07, 0.17) } else { (0.04, 0.1) };
                    self.on_dial("mark", bar(wide, long), turns);
                }
                "dots" => {
                    let r = if main { 0.062 } else { 0.042 };
                    let dot = plate(&ellipse(2.0 * r, 2.0 * r, 16), 0.04, 0.008, 0);
                    let dot = moved(dot, [0.0, far - r, 0.0]).colored(self.ink);
                    self.on_dial("mark", dot, turns);
                }
                "quarters" if main => self.on_dial("mark", bar(0.11, 0.24), turns),
                "quarters" => {}
                _ => {
                    // As Roman numbers look from afar.
                    let shift = if main { 0.045 } else { 0.0 };
                    for side in if main { vec![-shift, shift] } else { vec![0.0] } {
                        let stroke = moved(bar(0.042, 0.2), [side, 0.0, 0.0]);
                        self.on_dial("mark", stroke, turns);
                    }
                }
            }
        }
    }

    fn hands(&mut self, draw: &mut Draw) {
        let (style, alarm) = (draw.pick(&["bars", "pointed", "arrows"]), draw.chance(0.5));
        self.made.note("hands", style);
        self.made.note("alarm hand", if alarm { "yes" } else { "no" });
        let hour = draw.within(0.0, 12.0);
        let (far, ink) = (self.radius, self.ink);
        let mut hand = |long: f64, wide: f64, turns: f64, level: f64, color: Color| {
            let w = 0.5 * wide;
            let outline = match style {
                "bars" => vec![[-w, -0.14], [w, -0.14], [w, long], [-w, long]],
                "pointed" => vec![
                    [-0.6 * w, -0.16],
                    [0.6 * w, -0.16],
                    [1.3 * w, 0.3 * long],
                    [0.0, long],
                    [-1.3 * w, 0.3 * long],
                ],
                _ => vec![
                    [-0.6 * w, -0.14],
                    [0.6 * w, -0.14],
                    [0.6 * w, 0.62 * long],
                    [1.9 * w, 0.62 * long],
                    [0.0, long],
                    [-1.9 * w, 0.62 * long],
                    [-0.6 * w, 0.62 * long],
                ],
            };
            let outline: Vec<[f32; 2]> = outline.iter().map(|p| p.map(|x| x as f32)).collect();
            let mesh = primitives::extrude(&outline, 0.05).expect("a simple polygon");
            self.on_dial("hand", moved(mesh, [0.0, 0.0, level]).colored(color), turns);
        };

        hand(0.56 * far, 0.1, hour / 12.0, 0.02, ink);
        hand(0.84 * far, 0.07, hour.fract(), 0.04, ink);
        if alarm {
            hand(0.45 * far, 0.05, draw.within(0.0, 1.0), 0.05, [0.82, 0.13, 0.1]);
        }
        let hub = plate(&ellipse(0.17, 0.17, 20), 0.14, 0.02, 0).colored(ink);
        self.on_dial("hub", hub, 0.0);
    }

    /// Where the shell's upper side is over a place, and how steep it is there, degrees.
    fn roof(&self, x: f64) -> (f64, f64) {
        if self.body == "square" {
            (1.0, -0.25 * x.asin().to_degrees())
        } else {
            ((1.0 - x * x).sqrt(), -x.asin().to_degrees())
        }
    }

    /// Sets an upright part, its foot at the origin, on the roof.
    fn on_roof(&mut self, name: &'static str, part: TriMesh, x: f64) {
        let (y, lean) = self.roof(x);
        self.made.add(name, moved(rolled(part, lean), [x, y, 0.0]));
    }

    fn top(&mut self, draw: &mut Draw) {
        let bells = draw.pick(&[2, 2, 2, 1, 0]);
        let top = match bells {
            2 => draw.pick(&["handle", "hammer", "knob", "none"]),
            1 => draw.pick(&["hammer", "none"]),
            _ => draw.pick(&["handle", "button", "button", "knob"]),
        };
        self.made.note("bells", bells.to_string());
        self.made.note("top", top);
        let metal = Paint::metal(draw);
        let r = if bells == 1 { draw.within(0.42, 0.55) } else { draw.within(0.32, 0.4) };
        let places = match bells {
            2 => vec![-0.58, 0.58],
            1 => vec![0.0],
            _ => vec![],
        };
        for &x in &places {
            self.on_roof("bell", metal.on(bell(r)), x);
        }
        let tip = 0.2 + 0.92 * r;
        match top {
            "handle" => {
                let ends = if bells == 2 {
                    let (y, lean) = self.roof(0.58);
                    let (sin, cos) = lean.to_radians().sin_cos();
                    [0.58 - tip * sin, y + tip * cos]
                } else {
                    [0.55, self.roof(0.55).0 - 0.03]
                };
                let [x, y] = ends;
                let rise = draw.within(0.22, 0.34);
                let path = [
                    [-x, y, 0.0],
                    [-0.86 * x, y + 0.7 * rise, 0.0],
                    [-0.4 * x, y + rise, 0.0],
                    [0.4 * x, y + rise, 0.0],
                    [0.86 * x, y + 0.7 * rise, 0.0],
                    [x, y, 0.0],
                ];
                self.made.add("handle", self.metal.on(rod(&curve(&path, 8), |_| 0.06, 14)));
            }
            "hammer" if bells == 1 => {
                // Beside the bell, striking it from the right.
                let x = 0.82;
                let y = self.roof(x).0;
                let head: Point = [r + 0.1, 1.0 + 0.2 + 0.35 * r, 0.0];
                let path = [[x, y - 0.1, 0.0], [x + 0.06, y + 0.25, 0.0], head];
                self.made.add("hammer", self.metal.on(rod(&curve(&path, 8), |_| 0.045, 12)));
                self.made.add("hammer head", moved(self.metal.on(sphere(0.12, 18)), head));
            }
            "hammer" => {
                let stalk = rod(&[[0.0, -0.1, 0.0], [0.0, 0.45, 0.0]], |_| 0.05, 12);
                self.on_roof("hammer", self.metal.on(stalk), 0.0);
                let head = turned(&[[0.07, -0.2], [0.1, -0.17], [0.1, 0.17], [0.07, 0.2]], 18);
                let head = moved(rolled(head, 90.0), [0.0, 0.45, 0.0]);
                self.on_roof("hammer head", self.metal.on(head), 0.0);
            }
            "knob" => {
                let knob = turned(
                    &[
                        [0.11, -0.08],
                        [0.1, 0.12],
                        [0.17, 0.18],
                        [0.17, 0.26],
                        [0.12, 0.32],
                        [0.0, 0.33],
                    ],
                    24,
                );
                self.on_roof("knob", self.metal.on(knob), 0.0);
            }
            "button" => {
                let color = draw.color([0.6, 0.9], [0.6, 0.95]);
                let key =
                    block([0.75, 0.24, 0.5 * self.depth], 0.07, [4, 2, 4], Paint::Plain(color));
                self.on_roof("button", moved(key, [0.0, 0.04, 0.0]), 0.0);
            }
            _ => {}
        }
    }

    fn feet(&mut self, draw: &mut Draw) {
        let feet = draw.pick(&FEET);
        self.made.note("feet", feet);
        let flat = self.body != "round";
        let (x, lean) = if flat { (0.7, 8.0) } else { (0.55, 30.0) };
        let low = if flat { -1.0 } else { -(1.0_f64 - x * x).sqrt() };
        match feet {
            "pegs" => {
                let long = draw.within(0.26, 0.4);
                let peg = turned(
                    &[[0.12, -0.1], [0.13, 0.0], [0.09, long - 0.05], [0.06, long], [0.0, long]],
                    20,
                );
                for z in [-0.3, 0.3] {
                    let peg = rolled(peg.clone(), 180.0 + lean);
                    let peg = moved(peg, [x, low, z * self.depth]);
                    self.made.add_pair("foot", self.metal.on(peg));
                }
            }
            "balls" => {
                let r = draw.within(0.15, 0.2);
                for z in [-0.25, 0.25] {
                    let foot = moved(sphere(r, 20), [x, low - 0.6 * r, z * self.depth]);
                    self.made.add_pair("foot", self.metal.on(foot));
                }
            }
            "plinth" => {
                let tall = if flat { 0.2 } else { 0.36 };
                let wide = if flat { 2.3 } else { 1.5 };
                let base =
                    block([wide, tall, self.depth + 0.22], 0.05, [6, 2, 4], self.shell.along(0));
                let y = if flat { -1.05 } else { -1.0 };
                self.made.add("plinth", moved(base, [0.0, y, 0.0]));
            }
            _ => {
                // One bar at each side, front to back.
                let bar = block(
                    [0.22, 0.3, self.depth + 0.1],
                    0.06,
                    [1, 1, 4],
                    Paint::Plain(self.metal.main()),
                );
                let bar = moved(rolled(bar, 0.6 * lean), [x, low - 0.06, 0.0]);
                self.made.add_pair("foot", bar);
            }
        }
    }
}

/// A bell on its neck, upright, the neck's foot below the origin.
fn bell(r: f64) -> TriMesh {
    let rim = 0.2;
    let mut profile = vec![[0.2 * r, -0.1], [0.2 * r, rim], [0.9 * r, rim - 0.03], [r, rim - 0.03]];
    let angle = |k| (9.0 * f64::from(k)).to_radians();
    let dome = |k| on_ellipse([0.0, rim], [0.98 * r, 0.82 * r], angle(k));
    profile.extend((0..10).map(dome));
    profile.extend([[0.11 * r, rim + 0.83 * r], [0.12 * r, rim + 0.95 * r], [0.0, rim + 1.0 * r]]);
    turned(&profile, 36)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::testing::{assert_family, assert_values};

    #[test]
    fn clocks_are_sound() {
        assert_family(Family::AlarmClock);
    }

    #[test]
    fn every_style_occurs() {
        let values = |name: &str| match name {
            "body" => BODIES.to_vec(),
            "material" => vec!["lacquer", "wood", "metal"],
            "dial" => vec!["dark", "light"],
            "marks" => MARKS.to_vec(),
            "hands" => vec!["bars", "pointed", "arrows"],
            "alarm hand" => vec!["yes", "no"],
            "bells" => vec!["0", "1", "2"],
            "top" => TOPS.to_vec(),
            "feet" => FEET.to_vec(),
            other => panic!("trait {other}"),
        };
        assert_values(Family::AlarmClock, values);
    }
}
