//! Chairs: on legs, a star or a bent bar; with backs and arms of many kinds.

use mesh_core::TriMesh;

use super::draw::Draw;
use super::family::Family;
use super::joinery::{
    Point, add, beam, bent, block, curve, ellipse, flat, moved, pitched, plate, rod, sphere,
    turned, yawed,
};
use super::paint::Paint;
use super::shape::Shape;
use super::workpiece::Workpiece;

/// What it stands on.
const BASES: [&str; 5] = ["four legs", "three legs", "star", "sled", "cantilever"];
/// How its legs are made.
const LEGS: [&str; 4] = ["square", "tapered", "round", "turned"];
/// What one leans against.
const BACKS: [&str; 6] = ["solid", "slats", "ladder", "upholstered", "spindles", "low"];
/// Where one's arms go.
const ARMS: [&str; 3] = ["none", "rails", "padded"];

pub(super) fn draw(seed: u64) -> Shape {
    let draw = &mut Draw::new(seed, 4);
    let mut chair = Chair::new(draw);
    chair.stand(draw);
    chair.seat(draw);
    chair.back(draw);
    chair.arms();
    chair.made.finish(Family::Chair, seed)
}

/// A chair being made; lengths in metres, the floor at zero.
struct Chair {
    made: Workpiece,
    width: f64,
    depth: f64,
    /// Of the seat's upper side.
    height: f64,
    /// Of the seat.
    thickness: f64,
    round: bool,
    base: &'static str,
    back: &'static str,
    arms: &'static str,
    /// Of the back, from the vertical, degrees.
    lean: f64,
    /// Of the back, above the seat.
    rise: f64,
    frame: Paint,
    /// Of a seat and a back of board.
    panel: Paint,
    cloth: Paint,
}

impl Chair {
    fn new(draw: &mut Draw) -> Self {
        let base = draw.pick(&BASES);
        let back = draw.pick(&BACKS);
        // Arms need a straight back's edge to end at.
        let bar = base == "sled" || base == "cantilever";
        let round = draw.chance(0.3) && back != "upholstered" && !bar;
        let round = round || base == "three legs";
        let back = if round && back == "upholstered" { "solid" } else { back };
        let arms = match back {
            _ if round => "none",
            "upholstered" | "solid" => draw.pick(&ARMS),
            _ => draw.pick(&ARMS[..2]),
        };
        let material = match base {
            "sled" | "cantilever" | "star" => draw.pick(&["metal", "lacquer"]),
            _ => draw.pick(&["wood", "wood", "lacquer"]),
        };
        let frame = Paint::of(material, draw);
        let panel = match draw.count(0, 2) {
            0 => Paint::wood(draw),
            1 => Paint::lacquer(draw),
            _ => frame,
        };
        // Sharp patterns need the straight grid of a square cushion.
        let (cloth, pattern) = match Paint::cloth(draw, 0.07) {
            (cloth, _) if round => (Paint::Plain(cloth.main()), "plain"),
            cloth => cloth,
        };
        let mut made = Workpiece::default();
        made.note("base", base);
        made.note("back", back);
        made.note("arms", arms);
        made.note("seat", if round { "round" } else { "square" });
        made.note("material", material);
        made.note("cloth", pattern);
        let low = back == "low";
        Self {
            made,
            width: draw.within(0.42, 0.54),
            depth: draw.within(0.40, 0.48),
            height: draw.within(0.40, 0.50),
            thickness: draw.within(0.035, 0.055),
            round,
            base,
            back,
            arms,
            lean: draw.within(4.0, 14.0),
            rise: if low { draw.within(0.17, 0.24) } else { draw.within(0.38, 0.62) },
            frame,
            panel,
            cloth,
        }
    }

    /// Half of the distances between what stands under the seat.
    fn corner(&self) -> [f64; 2] {
        let share = if self.round { 0.31 } else { 0.43 };
        [share * self.width, share * self.depth]
    }

    fn stand(&mut self, draw: &mut Draw) {
        let style = if self.base.contains("legs") { draw.pick(&LEGS) } else { "none" };
        self.made.note("legs", style);
        match self.base {
            "four legs" => self.four_legs(style, draw),
            "three legs" => self.three_legs(style, draw),
            "star" => self.star(draw),
            "sled" => self.sled(),
            _ => self.cantilever(),
        }
    }

    /// One leg, from under the seat to the floor.
    fn leg(&mut self, style: &str, top: Point, foot: Point, thick: f64) {
        let mesh = match style {
            "square" => beam(top, foot, [thick; 2], 1.0, self.frame),
            "tapered" => beam(top, foot, [1.15 * thick; 2], 0.6, self.frame),
            "round" => {
                self.frame.on(rod(&curve(&[top, foot], 8), |t| thick * (0.55 - 0.12 * t), 14))
            }
            _ => {
                let bulge = |t: f64| {
                    let rings = 1.0 + 0.28 * (t * 21.0).sin() * (t * 3.2).sin().max(0.0);
                    thick * (0.58 - 0.14 * t) * rings
                };
                self.frame.on(rod(&curve(&[top, foot], 28), bulge, 14))
            }
        };
        self.made.add("leg", mesh);
    }

    fn four_legs(&mut self, style: &str, draw: &mut Draw) {
        let [x, z] = self.corner();
        let top = self.height - 0.5 * self.thickness;
        let (thick, splay) = (draw.within(0.036, 0.05), draw.within(0.0, 0.07));
        let foot = |sx: f64, sz: f64| [sx * (x + splay), 0.0, sz * (z + splay)];
        for sx in [-1.0, 1.0] {
            for sz in [-1.0, 1.0] {
                self.leg(style, [sx * x, top, sz * z], foot(sx, sz), thick);
            }
        }
        let stretchers = draw.pick(&["none", "sides", "all"]);
        self.made.note("stretchers", stretchers);
        if stretchers == "none" {
            return;
        }
        let share = draw.within(0.3, 0.55);
        let at = |sx: f64, sz: f64, share: f64| {
            [sx * (x + splay * (1.0 - share)), top * share, sz * (z + splay * (1.0 - share))]
        };
        let mut bar = |from, to| {
            let mesh = beam(from, to, [0.024, 0.03], 1.0, self.frame);
            self.made.add("stretcher", mesh);
        };
        for side in [-1.0, 1.0] {
            bar(at(side, -1.0, share), at(side, 1.0, share));
            if stretchers == "all" {
                bar(at(-1.0, side, 0.8 * share), at(1.0, side, 0.8 * share));
            }
        }
    }

    fn three_legs(&mut self, style: &str, draw: &mut Draw) {
        self.made.note("stretchers", "none");
        let (thick, reach) = (draw.within(0.04, 0.052), draw.within(0.42, 0.5));
        let top = self.height - 0.5 * self.thickness;
        for k in 0..3 {
            let (sin, cos) = (120.0 * f64::from(k) + 180.0_f64).to_radians().sin_cos();
            let at = |r: f64, y: f64| [r * self.width * sin, y, r * self.depth * cos];
            self.leg(style, at(0.27, top), at(reach, 0.0), thick);
        }
    }

    fn star(&mut self, draw: &mut Draw) {
        self.made.note("stretchers", "none");
        let (arms, reach) = (draw.count(4, 6), draw.within(0.26, 0.33));
        let wheels = draw.chance(0.6);
        let low = if wheels { 0.065 } else { 0.02 };
        for k in 0..arms {
            let turn = 360.0 * k as f64 / arms as f64;
            let arm = beam([0.0, 0.11, 0.0], [0.0, low, reach], [0.055, 0.04], 0.6, self.frame);
            self.made.add("arm of the star", yawed(arm, turn));
            let wheel = if wheels { sphere(0.032, 14) } else { sphere(0.026, 12) };
            let place = [0.0, if wheels { 0.032 } else { 0.02 }, reach];
            let wheel = moved(wheel, place).colored([0.1, 0.1, 0.11]);
            self.made.add("wheel", yawed(wheel, turn));
        }
        let top = self.height - 0.6 * self.thickness;
        let column = [
            [0.05, 0.07],
            [0.05, 0.12],
            [0.036, 0.14],
            [0.036, 0.6 * top],
            [0.026, 0.61 * top],
            [0.026, top - 0.05],
            [0.09, top - 0.03],
            [0.11, top],
        ];
        self.made.add("column", self.frame.on(turned(&column, 28)));
    }

    fn sled(&mut self) {
        self.made.note("stretchers", "none");
        let [x, z] = self.corner();
        let (top, r) = (self.height - 0.5 * self.thickness, 0.017);
        let path = [[x, top, 0.9 * z], [x, r, 1.1 * z], [x, r, -1.2 * z], [x, top, -0.9 * z]];
        let runner = self.frame.on(rod(&bent(&path, 0.07), |_| r, 12));
        self.made.add_pair("runner", runner);
        for side in [-0.85, 0.85] {
            let bar = [[-x, top - 0.02, side * z], [x, top - 0.02, side * z]];
            self.made.add("cross bar", self.frame.on(rod(&bar, |_| r, 12)));
        }
    }

    /// Bars that bear the seat from its front alone.
    fn cantilever(&mut self) {
        self.made.note("stretchers", "none");
        let [x, z] = self.corner();
        let (top, r) = (self.height - 0.5 * self.thickness, 0.019);
        let path = [
            [0.0, r, -1.15 * z],
            [x, r, -1.15 * z],
            [x, r, 1.1 * z],
            [x, top, 1.0 * z],
            [x, top, -0.9 * z],
        ];
        let runner = self.frame.on(rod(&bent(&path, 0.09), |_| r, 12));
        self.made.add_pair("runner", runner);
        let bar = [[-x, top, 0.0], [x, top, 0.0]];
        self.made.add("cross bar", self.frame.on(rod(&bar, |_| r, 12)));
    }

    fn seat(&mut self, draw: &mut Draw) {
        let (w, d, t) = (self.width, self.depth, self.thickness);
        let soft = self.back == "upholstered";
        let cushion = if soft { "seat" } else { draw.pick(&["none", "none", "loose"]) };
        self.made.note("cushion", cushion);
        let middle = [0.0, self.height - 0.5 * t, 0.0];
        let wooden = self.panel.along(0);
        let board = if self.round {
            wooden.on(flat(plate(&ellipse(w, d, 56), t, 0.4 * t, 5)))
        } else {
            let dip = draw.within(0.0, 0.25) * t;
            block([w, t, d], 0.35 * t, [12, 1, 12], wooden).map_positions(|[x, y, z]| {
                // Hollowed a little where one sits.
                let (u, v) = (2.0 * f64::from(x) / w, 2.0 * f64::from(z) / d);
                let hollow = if y > 0.0 { dip * (1.0 - u * u) * (1.0 - v * v) } else { 0.0 };
                [x, y - hollow as f32, z]
            })
        };
        self.made.add("seat", moved(board, middle));
        if cushion == "none" {
            return;
        }
        let high = if soft { draw.within(0.07, 0.1) } else { draw.within(0.04, 0.055) };
        let pad = if self.round {
            let disc = flat(plate(&ellipse(0.92 * w, 0.92 * d, 56), high, 0.45 * high, 8));
            self.cloth.on(disc)
        } else {
            pillow([0.97 * w, high, 0.95 * d], self.cloth.along(2))
        };
        self.made.add("cushion", moved(pad, [0.0, self.height + 0.38 * high, 0.0]));
        self.height += if soft { 0.8 * high } else { 0.0 };
    }

    /// Puts a part of the back, made upright with its foot at the origin, where it belongs.
    fn lean_on(&mut self, name: &'static str, mesh: TriMesh) {
        let share = if self.round { 0.36 } else { 0.45 };
        let mesh = pitched(mesh, -self.lean);
        self.made.add(name, moved(mesh, [0.0, self.height - 0.01, -share * self.depth]));
    }

    /// Half the width of the back.
    fn half(&self) -> f64 {
        self.width * if self.round { 0.31 } else { 0.45 }
    }

    fn back(&mut self, draw: &mut Draw) {
        let (half, rise) = (self.half(), self.rise);
        match self.back {
            "solid" => {
                let (bow, arch) = (draw.within(0.0, 0.05), draw.within(0.0, 0.1));
                let board = block([2.0 * half, rise + 0.03, 0.032], 0.014, [12, 12, 1], self.panel);
                let board = board.map_positions(|p| {
                    let [x, y, z] = bowed(p, half, bow);
                    let u = f64::from(x) / half;
                    let top = (f64::from(y) / rise + 0.5).max(0.0);
                    [x, y + (arch * top * (1.0 - u * u)) as f32, z]
                });
                self.lean_on("back", moved(board, [0.0, 0.5 * rise - 0.015, 0.0]));
            }
            "upholstered" => {
                let thick = draw.within(0.07, 0.1);
                let back = pillow([2.1 * half, rise, thick], self.cloth.along(1));
                self.lean_on("back", moved(back, [0.0, 0.5 * rise - 0.01, 0.0]));
                self.buttons(thick, draw);
            }
            "slats" | "spindles" => {
                self.posts(draw);
                let bow = draw.within(0.0, 0.03);
                self.rung(rise - 0.03, 0.065, bow);
                self.rung(0.3 * rise, 0.04, bow);
                let round = self.back == "spindles";
                let count = if round { draw.count(4, 6) } else { draw.count(3, 5) };
                for k in 0..count {
                    let x = half * (2.0 * (k as f64 + 1.0) / (count as f64 + 1.0) - 1.0);
                    let z = bow * (x / half).powi(2) - 0.5 * bow;
                    let low = if round { -0.02 } else { 0.3 * rise };
                    let (from, to) = ([x, low, if round { 0.0 } else { z }], [x, rise - 0.04, z]);
                    let slat = if round {
                        self.frame.on(rod(
                            &curve(&[from, to], 6),
                            |t| 0.011 + 0.003 * (3.0 * t).sin(),
                            10,
                        ))
                    } else {
                        let wide = 1.1 * half / count as f64;
                        beam(from, to, [wide, 0.016], 1.0, self.frame)
                    };
                    self.lean_on("slat", slat);
                }
            }
            "ladder" => {
                self.posts(draw);
                let (count, bow) = (draw.count(2, 4), draw.within(0.01, 0.035));
                for k in 0..count {
                    let share = 1.0 - 0.78 * k as f64 / count as f64;
                    self.rung(share * rise - 0.04, draw.within(0.05, 0.075), bow);
                }
            }
            _ => {
                self.posts(draw);
                let bow = draw.within(0.03, 0.06);
                self.rung(rise - 0.05, 0.1, bow);
            }
        }
    }

    fn posts(&mut self, draw: &mut Draw) {
        let (half, rise) = (self.half(), self.rise);
        let (x, ends) = (half - 0.012, draw.chance(0.4));
        for side in [-1.0, 1.0] {
            let (from, to) = ([side * x, -0.03, 0.0], [side * x, rise, 0.0]);
            let post = beam(from, to, [0.036, 0.036], 0.85, self.frame);
            self.lean_on("post", post);
            if ends {
                let knob = self.frame.on(sphere(0.026, 12));
                self.lean_on("knob", moved(knob, to));
            }
        }
    }

    /// A bar of the back from post to post, bowed backwards.
    fn rung(&mut self, height: f64, tall: f64, bow: f64) {
        let half = self.half();
        let bar = block([2.0 * half, tall, 0.024], 0.008, [14, 2, 1], self.frame.along(0));
        let bar = bar.map_positions(|p| bowed(p, half, bow));
        self.lean_on("rung", moved(bar, [0.0, height, 0.0]));
    }

    fn buttons(&mut self, thick: f64, draw: &mut Draw) {
        let (columns, rows) = (draw.count(2, 4), draw.count(2, 3));
        let color = self.cloth.main().map(|c| 0.55 * c);
        for i in 0..columns {
            for j in 0..rows {
                let x = self.half() * (2.0 * (i as f64 + 0.5) / columns as f64 - 1.0) * 0.95;
                let y = self.rise * (0.22 + 0.62 * (j as f64 + 0.5) / rows as f64);
                let button = sphere(0.014, 8).colored(color);
                self.lean_on("button", moved(button, [x, y, 0.5 * thick + 0.004]));
            }
        }
    }

    fn arms(&mut self) {
        let (w, d, h) = (self.width, self.depth, self.height);
        let level = if self.back == "low" { self.rise - 0.05 } else { 0.21 };
        let behind = -0.45 * d - level * self.lean.to_radians().tan();
        match self.arms {
            "rails" => {
                let x = 0.5 * w - 0.01;
                let top = [x, h + level, 0.36 * d];
                let pad = beam([x, h + level, behind - 0.01], top, [0.05, 0.03], 1.0, self.frame);
                let post = [x, h - 0.04, 0.3 * d];
                let post =
                    beam(post, add(post, [0.0, level + 0.04, 0.0]), [0.032; 2], 1.0, self.frame);
                self.made.add_pair("arm", pad);
                self.made.add_pair("arm post", post);
            }
            "padded" => {
                let tall = level + 0.09;
                let side = pillow([0.085, tall, 0.95 * d], self.cloth.along(1));
                let place = [0.5 * w + 0.02, h + level - 0.5 * tall, 0.02];
                self.made.add_pair("arm", moved(side, place));
            }
            _ => {}
        }
    }
}

/// A box with soft edges, its sides bulging.
fn pillow(sides: Point, paint: Paint) -> TriMesh {
    let thin = sides.iter().copied().fold(f64::INFINITY, f64::min);
    let bulge = 0.16;
    block(sides, 0.38 * thin, [10, 10, 10], paint).map_positions(|p| {
        std::array::from_fn(|k| {
            let [u, v] = [(k + 1) % 3, (k + 2) % 3].map(|a| 2.0 * f64::from(p[a]) / sides[a]);
            let grow = bulge * thin / sides[k] * (1.0 - u * u).max(0.0) * (1.0 - v * v).max(0.0);
            p[k] * (1.0 + grow) as f32
        })
    })
}

/// Bent about the vertical, the middle towards the back.
fn bowed([x, y, z]: [f32; 3], half: f64, bow: f64) -> [f32; 3] {
    let u = f64::from(x) / half;
    [x, y, z + (bow * (u * u - 1.0)) as f32]
}

#[cfg(test)]
mod tests {
    use super::super::testing::{assert_family, assert_values};
    use super::*;

    #[test]
    fn chairs_are_sound() {
        assert_family(Family::Chair);
    }

    #[test]
    fn every_style_occurs() {
        let values = |name: &str| match name {
            "base" => BASES.to_vec(),
            "back" => BACKS.to_vec(),
            "arms" => ARMS.to_vec(),
            "legs" => [&LEGS[..], &["none"]].concat(),
            "seat" => vec!["round", "square"],
            "material" => vec!["wood", "metal", "lacquer"],
            "cloth" => vec!["plain", "striped", "checked"],
            "stretchers" => vec!["none", "sides", "all"],
            "cushion" => vec!["none", "loose", "seat"],
            other => panic!("trait {other}"),
        };
        assert_values(Family::Chair, values);
    }
}
