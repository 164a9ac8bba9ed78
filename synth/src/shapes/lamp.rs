//! Lamps that stand on a desk or on the floor: one to three heads on straight, bowed or jointed arms.

use mesh_core::TriMesh;

use super::draw::{Draw, hsv};
use super::family::Family;
use super::joinery::{
    Point, add, block, curve, moved, profile, rod, scale, sphere, turned, unit, upright_along,
    yawed,
};
use super::paint::{Color, Paint};
use super::shape::Shape;
use super::workpiece::Workpiece;

/// How its arms are made.
const ARMS: [&str; 3] = ["straight", "arc", "jointed"];
/// What covers the light.
#[cfg(test)]
const SHADES: [&str; 4] = ["cone", "drum", "globe", "dome"];
/// What it stands on.
const BASES: [&str; 3] = ["round", "square", "tripod"];
/// The stem of a table lamp.
const BODIES: [&str; 3] = ["rod", "vase", "balls"];

pub(super) fn draw(seed: u64) -> Shape {
    let draw = &mut Draw::new(seed, 6);
    let mut lamp = Lamp::new(draw);
    let stem = lamp.base(draw);
    match lamp.arm {
        "straight" => lamp.straight(stem, draw),
        "arc" => lamp.arcs(stem, draw),
        _ => lamp.jointed(stem, draw),
    }
    lamp.made.finish(Family::Lamp, seed)
}

/// A lamp being made; its height is about 1, the ground at zero.
struct Lamp {
    made: Workpiece,
    floor: bool,
    arm: &'static str,
    shade: &'static str,
    base: &'static str,
    heads: usize,
    /// Of rods.
    thick: f64,
    /// Of a shade.
    radius: f64,
    frame: Paint,
    colors: [Color; 2],
}

impl Lamp {
    fn new(draw: &mut Draw) -> Self {
        let (floor, arm) = (draw.chance(0.5), draw.pick(&ARMS));
        let shade = if arm == "jointed" {
            draw.pick(&["cone", "dome"])
        } else {
            draw.pick(&["cone", "drum", "drum", "globe", "globe", "dome"])
        };
        let heads = match (floor, arm) {
            (true, "jointed") => draw.count(1, 2),
            (true, _) => draw.count(1, 3),
            _ => 1,
        };
        let base = draw.pick(if floor { &BASES } else { &["round", "round", "square"] });
        let material = draw.pick(&["metal", "metal", "wood", "lacquer"]);
        let frame = Paint::of(material, draw);
        let pattern =
            if shade == "globe" { "plain" } else { draw.pick(&["plain", "plain", "banded"]) };
        let main = match shade {
            "globe" => hsv(draw.within(0.11, 0.15), draw.within(0.05, 0.3), 0.98),
            _ if draw.chance(0.35) => hsv(0.12, draw.within(0.1, 0.3), 0.95),
            _ => draw.color([0.45, 0.85], [0.55, 0.95]),
        };
        let other = if pattern == "plain" { main } else { main.map(|c| 0.5 * c) };
        let mut made = Workpiece::default();
        made.note("kind", if floor { "floor" } else { "desk" });
        made.note("arm", arm);
        made.note("shade", shade);
        made.note("base", base);
        made.note("heads", heads.to_string());
        made.note("material", material);
        made.note("pattern", pattern);
        let wide = match (floor, heads) {
            (true, 1) => draw.within(0.15, 0.2),
            (true, _) => draw.within(0.1, 0.13),
            _ if arm == "straight" => draw.within(0.26, 0.36),
            _ => draw.within(0.2, 0.26),
        };
        Self {
            made,
            floor,
            arm,
            shade,
            base,
            heads,
            thick: if floor { draw.within(0.014, 0.019) } else { draw.within(0.018, 0.026) },
            radius: if shade == "globe" { 0.8 * wide } else { wide },
            frame,
            colors: [main, other],
        }
    }

    /// What it stands on; gives where the stem begins.
    fn base(&mut self, draw: &mut Draw) -> f64 {
        let wide = if self.floor { draw.within(0.13, 0.17) } else { draw.within(0.19, 0.25) };
        match self.base {
            "round" => {
                let tall = draw.within(0.025, 0.06);
                let foot = [
                    [0.97 * wide, 0.0],
                    [wide, 0.008],
                    [wide, 0.02],
                    [0.93 * wide, 0.028],
                    [0.6 * wide, 0.3 * tall + 0.028],
                    [2.2 * self.thick, tall + 0.02],
                    [0.0, tall + 0.022],
                ];
                self.made.add("foot", self.frame.on(turned(&foot, 48)));
                0.02
            }
            "square" => {
                let tall = draw.within(0.03, 0.05);
                let foot =
                    block([1.7 * wide, tall, 1.7 * wide], 0.01, [6, 1, 6], self.frame.along(0));
                self.made.add("foot", moved(foot, [0.0, 0.5 * tall, 0.0]));
                0.5 * tall
            }
            _ => {
                let (hub, reach) = (draw.within(0.3, 0.62), draw.within(0.2, 0.26));
                for k in 0..3 {
                    let path = curve(&[[0.0, hub, 0.0], [0.0, 0.0, reach]], 8);
                    let leg = rod(&path, |t| self.thick * (1.1 - 0.3 * t), 12);
                    self.made.add("leg", self.frame.on(yawed(leg, 120.0 * f64::from(k) + 60.0)));
                }
                let hub_ball = self.frame.on(sphere(2.0 * self.thick, 16));
                self.made.add("hub", moved(hub_ball, [0.0, hub, 0.0]));
                hub - 0.01
            }
        }
    }

    /// A rod of the frame along a path.
    fn rod(&mut self, name: &'static str, path: &[Point]) {
        let thick = self.thick;
        self.made.add(name, self.frame.on(rod(path, |_| thick, 14)));
    }

    /// A stem in the middle, with a head on top, or branches.
    fn straight(&mut self, low: f64, draw: &mut Draw) {
        let body = if self.floor || self.base == "tripod" { "rod" } else { draw.pick(&BODIES) };
        self.made.note("body", body);
        let top = if self.heads > 1 { 0.98 } else { 0.84 };
        match body {
            "vase" => {
                let r = draw.within(0.11, 0.16);
                let points = [
                    [0.6 * r, low],
                    [r, low + 0.14],
                    [0.85 * r, low + 0.27],
                    [0.3 * r, low + 0.42],
                    [0.34 * r, low + 0.46],
                ];
                let vase = self.frame.on(turned(&profile(&points, 8), 40));
                self.made.add("body", vase);
            }
            "balls" => {
                let count = draw.count(2, 4);
                let r = 0.25 / count as f64;
                for k in 0..count {
                    let y = low + r * (2.0 * k as f64 + 0.9) * 0.94;
                    let paint = if k % 2 == 0 { self.frame } else { Paint::Plain(self.colors[0]) };
                    let bead = paint.on(sphere(r, 28));
                    self.made.add("body", moved(bead, [0.0, y, 0.0]));
                }
            }
            _ => {}
        }
        self.rod("stem", &[[0.0, low, 0.0], [0.0, 0.5 * top, 0.0], [0.0, top, 0.0]]);
        if self.heads == 1 {
            let up = if self.shade == "globe" { [0.0, 1.0, 0.0] } else { [0.0, -1.0, 0.0] };
            self.head([0.0, top, 0.0], up);
            return;
        }
        let (turn, rising) = (draw.within(0.0, 120.0), draw.chance(0.5));
        for k in 0..self.heads {
            let from = 0.9 - 0.14 * k as f64;
            let reach = 0.2 + 0.03 * k as f64;
            let around = turn + 360.0 * k as f64 / self.heads as f64;
            let (sin, cos) = around.to_radians().sin_cos();
            let at = |r: f64, y: f64| [r * sin, y, r * cos];
            let end = if rising { at(reach, from + 0.06) } else { at(reach, from - 0.02) };
            let path = if rising {
                [at(0.0, from - 0.08), at(0.7 * reach, from - 0.06), end]
            } else {
                [at(0.0, from), at(0.6 * reach, from + 0.07), end]
            };
            self.rod("branch", &curve(&path, 8));
            let direction = if rising { [0.0, 1.0, 0.0] } else { [0.0, -1.0, 0.0] };
            self.head(end, direction);
        }
    }

    /// Bows that rise from the foot and hang over.
    fn arcs(&mut self, low: f64, draw: &mut Draw) {
        self.made.note("body", "rod");
        let turn = draw.within(40.0, 100.0);
        for k in 0..self.heads {
            let (sin, cos) = (turn + 125.0 * k as f64).to_radians().sin_cos();
            let at = |r: f64, y: f64| [r * sin, y, r * cos];
            let tall = 1.0 - 0.12 * k as f64;
            let reach = if self.floor { draw.within(0.34, 0.5) } else { draw.within(0.3, 0.42) };
            let reach = (reach * (1.0 - 0.12 * k as f64)).max(1.6 * self.radius);
            let path = [
                [0.0, low, 0.0],
                at(-0.02 * reach, 0.6 * tall),
                at(0.25 * reach, 0.93 * tall),
                at(0.65 * reach, tall),
                at(0.95 * reach, 0.87 * tall),
                at(reach, 0.78 * tall),
            ];
            self.rod("arm", &curve(&path, 8));
            self.head(path[5], [0.0, -1.0, 0.0]);
        }
    }

    /// Two bars with joints, and a head that looks down and out.
    fn jointed(&mut self, low: f64, draw: &mut Draw) {
        self.made.note("body", "rod");
        let start = if self.floor { draw.within(0.5, 0.6) } else { (low + 0.05).max(0.08) };
        self.rod("stem", &[[0.0, low, 0.0], [0.0, 0.5 * (low + start), 0.0], [0.0, start, 0.0]]);
        let turn = draw.within(30.0, 100.0);
        let (back, out) = (draw.within(0.12, 0.22), draw.within(0.22, 0.32));
        let pairs = draw.chance(0.5);
        for k in 0..self.heads {
            let (sin, cos) = (turn + 180.0 * k as f64).to_radians().sin_cos();
            let at = |r: f64, y: f64| [r * sin, y, r * cos];
            let left = 1.0 - start;
            let shoulder = [0.0, start - 0.1 * k as f64, 0.0];
            let elbow = at(-back, shoulder[1] + 0.55 * left);
            let wrist = at(out, shoulder[1] + 0.92 * left);
            for (from, to) in [(shoulder, elbow), (elbow, wrist)] {
                if pairs {
                    let aside = scale([cos, 0.0, -sin], 1.2 * self.thick);
                    for side in [1.0, -1.0] {
                        let off = scale(aside, side);
                        self.rod("arm", &curve(&[add(from, off), add(to, off)], 4));
                    }
                } else {
                    self.rod("arm", &curve(&[from, to], 4));
                }
            }
            for joint in [shoulder, elbow, wrist] {
                let size = self.thick * if pairs { 2.5 } else { 1.9 };
                let knuckle = sphere(size, 16).colored([0.25, 0.26, 0.28]);
                self.made.add("joint", moved(knuckle, joint));
            }
            let direction = unit(add(at(0.45, 0.0), [0.0, -1.0, 0.0]));
            self.head(wrist, direction);
        }
    }

    /// A shade with its socket and light, hung at a place, open towards a direction.
    fn head(&mut self, at: Point, direction: Point) {
        let r = self.radius;
        let rows = upright_along(scale(direction, -1.0), at);
        let socket = turned(
            &[[0.2 * r, -0.34 * r], [0.22 * r, 0.0], [0.16 * r, 0.12 * r], [0.0, 0.14 * r]],
            24,
        );
        self.made.add("socket", self.frame.on(socket).transformed(&rows));
        self.made.add("shade", self.cover().transformed(&rows));
        if self.shade == "cone" || self.shade == "dome" {
            let bulb = sphere(0.34 * r, 20).colored([1.0, 0.95, 0.72]);
            self.made.add("bulb", moved(bulb, [0.0, -0.5 * r, 0.0]).transformed(&rows));
        }
    }

    /// The shade alone, open downwards, hung at the origin.
    fn cover(&self) -> TriMesh {
        let (r, t) = (self.radius, 0.07 * self.radius);
        let wall = |from: [f64; 2], to: [f64; 2]| -> Vec<[f64; 2]> {
            // Two rings at each change of colour.
            let mut shares = vec![0.0, 1.0];
            for k in 1..6 {
                shares.extend([f64::from(k) / 6.0 - 0.006, f64::from(k) / 6.0 + 0.006]);
            }
            shares.sort_by(f64::total_cmp);
            let at = |s: f64| [from[0] + s * (to[0] - from[0]), from[1] + s * (to[1] - from[1])];
            shares.into_iter().map(at).collect()
        };
        let (low, high, outline) = match self.shade {
            "globe" => {
                return moved(sphere(r, 40), [0.0, -0.92 * r, 0.0]).colored(self.colors[0]);
            }
            "drum" => {
                let (low, high) = (-1.05 * r, 0.28 * r);
                let (wide, slim) = (r, 0.86 * r);
                let mut outline =
                    vec![[0.0, -0.04 * r], [slim - 1.6 * t, -0.04 * r], [wide - t, low]];
                outline.extend(wall([wide, low], [slim, high]));
                outline.extend([[slim - t, high], [slim - 1.5 * t, 0.04 * r], [0.0, 0.04 * r]]);
                (low, high, outline)
            }
            "cone" => {
                let (low, high) = (-1.15 * r, 0.02 * r);
                let slim = 0.3 * r;
                let mut outline = vec![[0.0, high - t], [slim - 0.5 * t, high - t], [r - t, low]];
                outline.extend(wall([r, low], [slim, high]));
                outline.push([0.0, high]);
                (low, high, outline)
            }
            _ => {
                let (low, high) = (-0.85 * r, 0.1 * r);
                let arc = |radius: f64, k: usize| {
                    let (sin, cos) = (90.0 * k as f64 / 14.0).to_radians().sin_cos();
                    [radius * cos, low + (radius - r + high - low) * sin.max(0.0)]
                };
                let mut outline = vec![[0.0, high - t]];
                outline.extend((0..14).rev().map(|k| arc(r - t, k)));
                outline.extend((0..14).map(|k| arc(r, k)));
                outline.push([0.0, high]);
                (low, high, outline)
            }
        };
        let mut cover = turned(&outline, 44);
        let color = |p: &[f32; 3]| {
            let share = ((f64::from(p[1]) - low) / (high - low)).clamp(0.0, 0.999);
            self.colors[(share * 6.0) as usize & 1]
        };
        cover.colors = Some(cover.positions.iter().map(color).collect());
        cover
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{assert_family, assert_values};
    use super::*;

    #[test]
    fn lamps_are_sound() {
        assert_family(Family::Lamp);
    }

    #[test]
    fn every_style_occurs() {
        let values = |name: &str| match name {
            "kind" => vec!["floor", "desk"],
            "arm" => ARMS.to_vec(),
            "shade" => SHADES.to_vec(),
            "base" => BASES.to_vec(),
            "heads" => vec!["1", "2", "3"],
            "material" => vec!["metal", "wood", "lacquer"],
            "pattern" => vec!["plain", "banded"],
            "body" => BODIES.to_vec(),
            other => panic!("trait {other}"),
        };
        assert_values(Family::Lamp, values);
    }
}
