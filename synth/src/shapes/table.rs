//! Tables: tops of four outlines on legs, trestles, columns, crosses or cabinets.

use super::draw::Draw;
use super::family::Family;
use super::joinery::{
    Point, beam, bent, block, curve, ellipse, flat, moved, plate, profile, rod, sphere, turned,
    yawed,
};
use super::paint::Paint;
use super::shape::Shape;
use super::workpiece::Workpiece;

/// The outline of its top.
const TOPS: [&str; 4] = ["round", "square", "rectangular", "oval"];
/// What it stands on.
#[cfg(test)]
const BASES: [&str; 6] = ["four legs", "three legs", "trestle", "pedestal", "x legs", "cabinet"];
/// How its legs are made.
const LEGS: [&str; 4] = ["square", "tapered", "round", "turned"];

pub(super) fn draw(seed: u64) -> Shape {
    let draw = &mut Draw::new(seed, 5);
    let mut table = Table::new(draw);
    table.top(draw);
    let style = if table.base.contains("four") || table.base.contains("three") {
        draw.pick(&LEGS)
    } else {
        "none"
    };
    table.made.note("legs", style);
    let below = match table.base {
        "four legs" => draw.pick(&["none", "apron", "shelf", "drawers"]),
        _ => "none",
    };
    table.made.note("below", below);
    match table.base {
        "four legs" => table.four_legs(style, below, draw),
        "three legs" => table.three_legs(style, draw),
        "trestle" => table.trestle(draw),
        "pedestal" => table.pedestal(draw),
        "x legs" => table.crosses(),
        _ => table.cabinet(draw),
    }
    table.made.finish(Family::Table, seed)
}

/// A table being made; lengths in metres, the floor at zero.
struct Table {
    made: Workpiece,
    top: &'static str,
    base: &'static str,
    width: f64,
    depth: f64,
    /// Of the top's underside.
    height: f64,
    /// Of the top.
    thickness: f64,
    frame: Paint,
    board: Paint,
}

impl Table {
    fn new(draw: &mut Draw) -> Self {
        let top = draw.pick(&TOPS);
        let straight = top == "square" || top == "rectangular";
        let base = match top {
            "round" => draw.pick(&["four legs", "three legs", "pedestal", "pedestal"]),
            "oval" => draw.pick(&["four legs", "trestle", "pedestal"]),
            "square" => draw.pick(&["four legs", "four legs", "pedestal", "x legs"]),
            _ => draw.pick(&["four legs", "trestle", "x legs", "cabinet"]),
        };
        let kind = if base == "cabinet" { "dining" } else { draw.pick(&["dining", "coffee"]) };
        let width = match top {
            "round" => draw.within(0.75, 1.15),
            "square" => draw.within(0.75, 1.0),
            _ => draw.within(1.05, 1.5),
        };
        let depth = if straight && top == "square" || top == "round" {
            width
        } else {
            width * draw.within(0.5, 0.66)
        };
        let height =
            if kind == "dining" { draw.within(0.66, 0.76) } else { draw.within(0.36, 0.46) };
        let material = draw.pick(&["wood", "wood", "lacquer", "metal"]);
        let frame = Paint::of(material, draw);
        let mut made = Workpiece::default();
        made.note("top", top);
        made.note("base", base);
        made.note("kind", kind);
        made.note("material", material);
        let thickness = draw.within(0.038, 0.06);
        Self { made, top, base, width, depth, height, thickness, frame, board: frame }
    }

    fn is_round(&self) -> bool {
        self.top == "round" || self.top == "oval"
    }

    fn top(&mut self, draw: &mut Draw) {
        let (w, d, t) = (self.width, self.depth, self.thickness);
        let place = [0.0, self.height + 0.5 * t, 0.0];
        let surface = if draw.chance(0.5) { self.frame } else { Paint::wood(draw) };
        let main = surface.main();
        let other =
            if draw.chance(0.5) { main.map(|c| 0.5 * c) } else { main.map(|c| 0.4 + 0.6 * c) };
        let colors = [main, other];
        let pattern = if self.is_round() {
            draw.pick(&["plain", "border"])
        } else {
            draw.pick(&["plain", "planks", "checked", "striped"])
        };
        self.made.note("pattern", pattern);
        self.board = match pattern {
            "border" => Paint::Border { colors, edge: 0.4 * d },
            "checked" => Paint::Checks { colors, axes: [0, 2], width: d / 7.0 },
            "striped" => Paint::Stripes { colors, axis: 2, width: d / 7.0 },
            _ => surface.along(0),
        };
        if self.is_round() {
            let disc = flat(plate(&ellipse(w, d, 72), t, 0.45 * t, 9));
            self.made.add("top", moved(self.board.on(disc), place));
        } else if pattern == "planks" {
            let count = draw.count(4, 6);
            let wide = d / count as f64;
            for k in 0..count {
                let paint = if k % 2 == 0 { self.board } else { Paint::Plain(other) };
                let plank = block([w, t, wide], 0.006, [12, 1, 2], paint);
                let z = wide * (k as f64 + 0.5) - 0.5 * d;
                self.made.add("plank", moved(plank, [0.0, place[1], z]));
            }
        } else {
            let slab = block([w, t, d], 0.3 * t, [14, 1, 10], self.board);
            self.made.add("top", moved(slab, place));
        }
    }

    /// Where legs stand, from the middle.
    fn corner(&self) -> [f64; 2] {
        if self.is_round() {
            [0.32 * self.width, 0.32 * self.depth]
        } else {
            [0.5 * self.width - 0.06, 0.5 * self.depth - 0.06]
        }
    }

    fn leg(&mut self, style: &str, top: Point, foot: Point, thick: f64) {
        let mesh = match style {
            "square" => beam(top, foot, [thick; 2], 1.0, self.frame),
            "tapered" => beam(top, foot, [1.2 * thick; 2], 0.55, self.frame),
            "round" => self.frame.on(rod(&curve(&[top, foot], 8), |_| 0.5 * thick, 16)),
            _ => {
                let bulge = |t: f64| {
                    let rings = 1.0 + 0.3 * (t * 18.0).sin() * (t * 3.2).sin().max(0.0);
                    thick * (0.62 - 0.14 * t) * rings
                };
                self.frame.on(rod(&curve(&[top, foot], 30), bulge, 16))
            }
        };
        self.made.add("leg", mesh);
    }

    fn four_legs(&mut self, style: &str, below: &str, draw: &mut Draw) {
        let [x, z] = self.corner();
        let (thick, h) = (draw.within(0.055, 0.085), self.height);
        let splay = if below == "shelf" { 0.0 } else { draw.pick(&[0.0, 0.0, 0.05, 0.09]) };
        for sx in [-1.0, 1.0] {
            for sz in [-1.0, 1.0] {
                let foot = [sx * (x + splay), 0.0, sz * (z + splay)];
                self.leg(style, [sx * x, h + 0.01, sz * z], foot, thick);
            }
        }
        match below {
            "apron" => self.apron(0.08),
            "shelf" => {
                let level = draw.within(0.25, 0.4) * h;
                let shelf = if self.is_round() {
                    let outline = ellipse(2.7 * x, 2.7 * z, 56);
                    self.frame.along(0).on(flat(plate(&outline, 0.036, 0.012, 4)))
                } else {
                    block(
                        [2.0 * x + 0.02, 0.036, 2.0 * z + 0.02],
                        0.01,
                        [10, 1, 8],
                        self.frame.along(0),
                    )
                };
                self.made.add("shelf", moved(shelf, [0.0, level, 0.0]));
            }
            "drawers" => {
                let tall = 0.3_f64.min(0.34 * h);
                let chest = block([2.0 * x, tall, 2.0 * z], 0.01, [8, 3, 8], self.frame.along(0));
                self.made.add("chest", moved(chest, [0.0, h - 0.5 * tall, 0.0]));
                let count = draw.count(1, 3);
                for k in 0..count {
                    let wide = 2.0 * x / count as f64;
                    let at = [wide * (k as f64 + 0.5) - x, h - 0.5 * tall, z];
                    self.drawer([0.9 * wide, 0.72 * tall], at);
                }
            }
            _ => {}
        }
    }

    /// Boards below the edge of the top.
    fn apron(&mut self, tall: f64) {
        let [x, z] = self.corner();
        let y = self.height - 0.5 * tall;
        for side in [-1.0, 1.0] {
            let (l, r) = ([-x, y, side * z], [x, y, side * z]);
            self.made.add("apron", beam(l, r, [tall, 0.03], 1.0, self.frame));
            let (b, f) = ([side * x, y, -z], [side * x, y, z]);
            self.made.add("apron", beam(b, f, [0.03, tall], 1.0, self.frame));
        }
    }

    /// A drawer's front with its knob; `at` is the middle of the place on the chest.
    fn drawer(&mut self, size: [f64; 2], at: Point) {
        let color = self.frame.main().map(|c| (0.62 * c + 0.3).min(1.0));
        let front = block([size[0], size[1], 0.03], 0.008, [4, 3, 1], Paint::Plain(color));
        self.made.add("drawer", moved(front, [at[0], at[1], at[2] + 0.005]));
        let knob = sphere(0.02, 14).colored([0.2, 0.19, 0.18]);
        self.made.add("knob", moved(knob, [at[0], at[1], at[2] + 0.035]));
    }

    fn three_legs(&mut self, style: &str, draw: &mut Draw) {
        let (thick, reach) = (draw.within(0.06, 0.085), draw.within(0.34, 0.46));
        for k in 0..3 {
            let (sin, cos) = (120.0 * f64::from(k)).to_radians().sin_cos();
            let at = |r: f64, y: f64| [r * self.width * sin, y, r * self.depth * cos];
            let (top, foot) = (at(0.27, self.height + 0.01), at(reach, 0.0));
            self.leg(style, top, foot, thick);
        }
    }

    fn trestle(&mut self, draw: &mut Draw) {
        let (h, x) = (self.height, self.width * draw.within(0.28, 0.36));
        let (z, upright) = (0.38 * self.depth, draw.chance(0.5));
        for side in [-x, x] {
            let mut bar = |from: Point, to: Point, section| {
                self.made.add("trestle", beam(from, to, section, 1.0, self.frame));
            };
            bar([side, h - 0.03, -z], [side, h - 0.03, z], [0.07, 0.06]);
            if upright {
                bar([side, 0.03, -z], [side, 0.03, z], [0.09, 0.06]);
                bar([side, 0.03, 0.0], [side, h - 0.03, 0.0], [0.07, 0.16]);
            } else {
                bar([side, h - 0.03, -0.15 * z], [side, 0.0, -z], [0.06, 0.06]);
                bar([side, h - 0.03, 0.15 * z], [side, 0.0, z], [0.06, 0.06]);
                bar([side, 0.35 * h, -0.7 * z], [side, 0.35 * h, 0.7 * z], [0.05, 0.05]);
            }
        }
        let y = 0.35 * h;
        let long = beam([-x, y, 0.0], [x, y, 0.0], [0.07, 0.05], 1.0, self.frame);
        self.made.add("stretcher", long);
    }

    fn pedestal(&mut self, draw: &mut Draw) {
        let (h, r) = (self.height, draw.within(0.045, 0.075));
        let feet = draw.count(2, 4);
        let disc = feet == 2;
        let low = if disc { 0.0 } else { 0.1 };
        let mut points = vec![[1.3 * r, low], [1.1 * r, 0.12 + low]];
        if draw.chance(0.5) {
            points.extend([[1.9 * r, 0.3 * h + 0.05], [0.9 * r, 0.52 * h + 0.05]]);
        }
        points.extend([[r, 0.8 * h], [1.5 * r, h - 0.03], [2.4 * r, h + 0.005]]);
        self.made.add("column", self.frame.on(turned(&profile(&points, 8), 36)));
        let reach = 0.5 * self.depth * draw.within(0.62, 0.8);
        if disc {
            let foot = [
                [0.97 * reach, 0.0],
                [reach, 0.012],
                [reach, 0.03],
                [0.9 * reach, 0.042],
                [0.5 * reach, 0.06],
                [1.5 * r, 0.1],
                [0.0, 0.12],
            ];
            self.made.add("foot", self.frame.on(turned(&foot, 56)));
            return;
        }
        for k in 0..feet {
            let path = curve(
                &[
                    [0.0, 0.3, 0.0],
                    [0.0, 0.22, 0.35 * reach],
                    [0.0, 0.045, 0.75 * reach],
                    [0.0, 0.03, reach],
                ],
                6,
            );
            let foot = rod(&path, |t| 0.045 - 0.015 * t, 14);
            let turn = 360.0 * (k as f64 + 0.5) / feet as f64;
            self.made.add("foot", self.frame.on(yawed(foot, turn)));
        }
    }

    fn crosses(&mut self) {
        let (h, [x, z]) = (self.height, self.corner());
        let x = 0.88 * x;
        for side in [-x, x] {
            for sign in [-1.0, 1.0] {
                // A little apart where they cross.
                let shift = side + 0.012 * sign;
                let (from, to) = ([shift, h + 0.01, sign * z], [shift, 0.0, -sign * z]);
                self.made.add("leg", beam(from, to, [0.05, 0.065], 1.0, self.frame));
            }
        }
        let bar = bent(&[[-x, 0.5 * h, 0.0], [x, 0.5 * h, 0.0]], 0.0);
        self.made.add("stretcher", self.frame.on(rod(&bar, |_| 0.025, 14)));
    }

    /// A desk: drawers to one or both sides, legs or a panel where there are none.
    fn cabinet(&mut self, draw: &mut Draw) {
        let (h, both, panel) = (self.height, draw.chance(0.35), draw.chance(0.5));
        let [x, z] = self.corner();
        let (wide, deep) = (0.27 * self.width, 0.88 * self.depth);
        let rows = draw.count(2, 4);
        for side in if both { vec![-1.0, 1.0] } else { vec![1.0] } {
            let middle = side * (0.5 * self.width - 0.03 - 0.5 * wide);
            let low = 0.04;
            let body = block([wide, h - low + 0.01, deep], 0.01, [4, 8, 6], self.frame);
            self.made.add("cabinet", moved(body, [middle, 0.5 * (h + low), 0.0]));
            let plinth =
                block([0.9 * wide, 0.06, 0.92 * deep], 0.006, [2, 1, 2], Paint::Plain([0.16; 3]));
            self.made.add("plinth", moved(plinth, [middle, 0.03, 0.0]));
            let tall = (h - low - 0.02) / rows as f64;
            for row in 0..rows {
                let y = low + 0.01 + tall * (row as f64 + 0.5);
                self.drawer([0.88 * wide, 0.84 * tall], [middle, y, 0.5 * deep]);
            }
        }
        if both {
            let back =
                block([self.width - wide, 0.5 * h, 0.04], 0.006, [6, 3, 1], self.frame.along(0));
            self.made.add("panel", moved(back, [0.0, 0.75 * h, -0.4 * deep]));
        } else if panel {
            let side = block([0.045, h + 0.01, deep], 0.008, [1, 6, 6], self.frame);
            self.made.add("panel", moved(side, [-x, 0.5 * h, 0.0]));
        } else {
            for sz in [-z, z] {
                self.leg("square", [-x, h + 0.01, sz], [-x, 0.0, sz], 0.06);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{assert_family, assert_values};
    use super::*;

    #[test]
    fn tables_are_sound() {
        assert_family(Family::Table);
    }

    #[test]
    fn every_style_occurs() {
        let values = |name: &str| match name {
            "top" => TOPS.to_vec(),
            "base" => BASES.to_vec(),
            "kind" => vec!["dining", "coffee"],
            "material" => vec!["wood", "lacquer", "metal"],
            "pattern" => vec!["plain", "border", "planks", "checked", "striped"],
            "legs" => [&LEGS[..], &["none"]].concat(),
            "below" => vec!["none", "apron", "shelf", "drawers"],
            other => panic!("trait {other}"),
        };
        assert_values(Family::Table, values);
    }
}
