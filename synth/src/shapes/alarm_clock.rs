//! An alarm clock with two bells: round where a fit is easy, thin and concave where it is not.

use std::f64::consts::{FRAC_PI_2, TAU};

use mesh_core::{TriMesh, primitives};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

mod family;

use super::draw::hsv;
use super::joinery::{ellipse, turned};
use super::solid::on_ellipse;
pub(super) use family::draw;

/// A round alarm clock on two feet with two bells; lengths in units of the body's radius.
///
/// The clock stands upright (+Y), its dial looks along +Z, and the middle of its body is the
/// origin. Every part is closed and oriented outward. Bells, knob and feet stand on narrow necks
/// that sink into the body, so that hardly any surface is hidden, no ring of parts encloses a
/// hole, and a deformed sphere can come near all of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AlarmClock {
    /// Depth of the body, back to front.
    pub depth: f64,
    /// Radius of each bell.
    pub bell_radius: f64,
    /// Angle of each bell from the vertical, degrees.
    pub bell_angle: f64,
    /// How far the knob between the bells stands out.
    pub knob_length: f64,
    /// How far each foot stands out.
    pub foot_length: f64,
    /// Angle of each foot from the vertical, degrees.
    pub foot_angle: f64,
    /// The time shown: hours and their fraction, 0 to 12.
    pub hour: f64,
    /// Segments around the body; other parts follow it.
    pub segments: usize,
    /// What is painted how.
    pub colors: ClockColors,
}

/// The colours of an [`AlarmClock`], sRGB in `[0, 1]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ClockColors {
    /// The drum and its rim.
    pub body: [f32; 3],
    /// The dial.
    pub dial: [f32; 3],
    /// The marks of the hours.
    pub ticks: [f32; 3],
    /// Both hands and their hub.
    pub hands: [f32; 3],
    /// Both bells.
    pub bells: [f32; 3],
    /// The knob between the bells.
    pub knob: [f32; 3],
    /// Both feet.
    pub feet: [f32; 3],
}

impl Default for AlarmClock {
    fn default() -> Self {
        Self {
            depth: 0.75,
            bell_radius: 0.37,
            bell_angle: 40.0,
            knob_length: 0.24,
            foot_length: 0.34,
            foot_angle: 35.0,
            hour: 10.0 + 9.0 / 60.0,
            segments: 96,
            colors: ClockColors::default(),
        }
    }
}

impl Default for ClockColors {
    fn default() -> Self {
        Self {
            body: [0.80, 0.11, 0.12],
            dial: [0.96, 0.93, 0.84],
            ticks: [0.13, 0.14, 0.18],
            hands: [0.09, 0.11, 0.24],
            bells: [0.90, 0.68, 0.24],
            knob: [0.55, 0.57, 0.60],
            feet: [0.40, 0.41, 0.46],
        }
    }
}

/// How far the dial lies behind the rim.
const RECESS: f64 = 0.015;
/// Where the rim ends and the dial begins.
const DIAL: f64 = 0.84;
/// How far necks sink into the body.
const SUNK: f64 = 0.06;

impl AlarmClock {
    /// A clock with proportions, time and colours drawn from a seed.
    pub fn sample(seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut draw = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
        let standard = Self::default();
        let mut clock = Self {
            depth: draw(0.6, 0.95),
            bell_radius: draw(0.3, 0.4),
            bell_angle: draw(36.0, 46.0),
            knob_length: draw(0.2, 0.28),
            foot_length: draw(0.3, 0.42),
            foot_angle: draw(26.0, 36.0),
            hour: draw(0.0, 12.0),
            ..standard
        };
        // A strong hue for the body, a light dial, dark marks: recognisable in every draw.
        let (body, bell) = (draw(0.0, 1.0), draw(0.08, 0.16));
        clock.colors.body = hsv(body, 0.85, draw(0.55, 0.9));
        clock.colors.dial = hsv(draw(0.0, 1.0), 0.08, draw(0.88, 0.98));
        clock.colors.hands = hsv(draw(0.0, 1.0), 0.6, draw(0.1, 0.3));
        clock.colors.bells = hsv(bell, draw(0.4, 0.75), draw(0.75, 0.95));
        clock
    }

    /// The clock as one coloured mesh of closed parts.
    ///
    /// # Panics
    /// If there are fewer than 8 segments, or a length or angle is outside of what makes a clock
    /// (not positive, or parts that would not touch the body).
    pub fn build(&self) -> TriMesh {
        assert!(self.segments >= 8, "AlarmClock: {} segments, at least 8", self.segments);
        for (name, value, low, high) in [
            ("depth", self.depth, 0.3, 3.0),
            ("bell_radius", self.bell_radius, 0.1, 0.6),
            ("bell_angle", self.bell_angle, 10.0, 80.0),
            ("knob_length", self.knob_length, 0.18, 1.0),
            ("foot_length", self.foot_length, 0.05, 1.0),
            ("foot_angle", self.foot_angle, 5.0, 80.0),
            ("hour", self.hour, 0.0, 12.0),
        ] {
            assert!((low..=high).contains(&value), "AlarmClock: {name} {value}, {low} to {high}");
        }
        let mut clock = self.body();
        let mut add =
            |part: TriMesh| clock.append(&part).expect("parts are small and all coloured");
        for side in [-1.0, 1.0] {
            add(stand(self.bell(), side * self.bell_angle).colored(self.colors.bells));
            add(stand(self.foot(), 180.0 - side * self.foot_angle).colored(self.colors.feet));
        }
        add(stand(self.knob(), 0.0).colored(self.colors.knob));
        for hour in 0..12 {
            let long = if hour % 3 == 0 { 0.15 } else { 0.09 };
            let half = if hour % 3 == 0 { 0.032 } else { 0.02 };
            let outline = [[-half, 0.76 - long], [half, 0.76 - long], [half, 0.76], [-half, 0.76]];
            add(self.on_dial(&outline, hour as f64 / 12.0, 0.006).colored(self.colors.ticks));
        }
        let minute = self.hour.fract();
        let hand = |length: f64, half: f64| {
            [[-half, -0.12], [half, -0.12], [0.6 * half, length], [-0.6 * half, length]]
        };
        add(self.on_dial(&hand(0.42, 0.055), self.hour / 12.0, 0.01).colored(self.colors.hands));
        add(self.on_dial(&hand(0.62, 0.038), minute, 0.014).colored(self.colors.hands));
        add(self.on_dial(&ellipse(0.15, 0.15, 24), 0.0, 0.02).colored(self.colors.hands));
        clock
    }

    /// The drum with rounded edges, its rim, and the dial set into it: one closed surface.
    fn body(&self) -> TriMesh {
        let half = self.depth / 2.0;
        let round = 0.09_f64.min(0.4 * half);
        let mut profile = vec![[0.0, -half - 0.05], [0.3, -half - 0.045], [0.6, -half - 0.025]];
        let corner = |center: f64, from: f64| {
            let angle = move |k| from + FRAC_PI_2 * k as f64 / 6.0;
            (0..=6).map(move |k| on_ellipse([1.0 - round, center], [round; 2], angle(k)))
        };
        profile.extend(corner(-half + round, -FRAC_PI_2));
        profile.extend(corner(half - round, 0.0));
        let dial = half - RECESS;
        profile.extend([
            [DIAL + 0.02, half],
            [DIAL + 0.004, dial],
            [DIAL, dial],
            [DIAL - 0.02, dial],
        ]);
        profile.extend([[0.6, dial], [0.3, dial], [0.0, dial]]);
        let mut body = turned(&profile, self.segments).transformed(&[
            [1.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, -1.0, 0.0],
            [0.0, 1.0, 0.0, 0.0],
        ]);
        let is_dial = |p: &[f32; 3]| {
            p[2] as f64 > dial - 1e-3 && (p[0] as f64).hypot(p[1] as f64) < DIAL + 2e-3
        };
        let paint = |p: &[f32; 3]| if is_dial(p) { self.colors.dial } else { self.colors.body };
        body.colors = Some(body.positions.iter().map(paint).collect());
        body
    }

    /// A bell on its neck, upright, the neck's foot at the origin.
    fn bell(&self) -> TriMesh {
        let r = self.bell_radius;
        let rim = SUNK + 0.3 * r;
        let mut profile =
            vec![[0.4 * r, 0.0], [0.4 * r, SUNK + 0.1 * r], [0.88 * r, rim - 0.07 * r]];
        let dome = |k| on_ellipse([0.0, rim], [r, 0.85 * r], FRAC_PI_2 * k as f64 / 12.0);
        profile.extend((0..12).map(dome));
        profile.push([0.0, rim + 0.85 * r]);
        turned(&profile, (self.segments / 2).max(6))
    }

    fn knob(&self) -> TriMesh {
        let (length, r) = (self.knob_length + SUNK, 0.14);
        let mut profile = vec![[0.9 * r, 0.0], [0.8 * r, length - 1.6 * r]];
        let angle = |k| -0.6 + (FRAC_PI_2 + 0.6) * k as f64 / 8.0;
        profile.extend((0..8).map(|k| on_ellipse([0.0, length - r], [r, r], angle(k))));
        profile.push([0.0, length]);
        turned(&profile, (self.segments / 4).max(6))
    }

    fn foot(&self) -> TriMesh {
        let length = self.foot_length + SUNK;
        let mut profile = vec![[0.13, 0.0], [0.125, 0.4 * length], [0.1, length - 0.08]];
        let tip = |k| on_ellipse([0.0, length - 0.08], [0.1, 0.08], FRAC_PI_2 * k as f64 / 5.0);
        profile.extend((1..5).map(tip));
        profile.push([0.0, length]);
        turned(&profile, (self.segments / 4).max(6))
    }

    /// A flat part on the dial, its outline turned clockwise by a share of the full turn.
    fn on_dial(&self, outline: &[[f64; 2]], turns: f64, height: f64) -> TriMesh {
        let sink = 0.01;
        let (sin, cos) = (TAU * turns).sin_cos();
        let outline: Vec<[f32; 2]> = outline.iter().map(|p| p.map(|v| v as f32)).collect();
        let middle = self.depth / 2.0 - RECESS + (height - sink) / 2.0;
        primitives::extrude(&outline, (height + sink) as f32)
            .expect("a simple polygon of positive height")
            .transformed(&[[cos, sin, 0.0, 0.0], [-sin, cos, 0.0, 0.0], [0.0, 0.0, 1.0, middle]])
    }
}

/// Sets an upright part onto the body, at an angle from the vertical in degrees, clockwise seen
/// from the front.
fn stand(part: TriMesh, degrees: f64) -> TriMesh {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let out = 1.0 - SUNK;
    part.transformed(&[
        [cos, sin, 0.0, out * sin],
        [-sin, cos, 0.0, out * cos],
        [0.0, 0.0, 1.0, 0.0],
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_is_a_clock(clock: &AlarmClock) {
        let mesh = clock.build();
        let health = mesh.health();
        assert!(health.finite && health.indices_in_range && health.oriented && health.outward);
        assert_eq!((health.boundary_edges, health.non_manifold_edges), (0, 0));
        assert_eq!((health.degenerate_faces, health.isolated_vertices), (0, 0));
        // Body, 2 bells, 2 feet, knob, 12 ticks, 2 hands, hub, each like a sphere.
        assert_eq!((health.components, health.euler), (21, 42));
        let colors = mesh.colors.as_ref().map_or(0, Vec::len);
        assert_eq!(colors, mesh.positions.len());
        // It stands on its feet, the bells are on top, and it is mirrored about its middle.
        let (low, high) = mesh.bounds().expect("a clock has vertices");
        assert!(low[1] < -1.02 && high[1] > 1.15 && (low[0] + high[0]).abs() < 1e-3);
    }

    #[test]
    fn every_part_is_closed() {
        assert_is_a_clock(&AlarmClock::default());
        assert_is_a_clock(&AlarmClock { segments: 8, ..AlarmClock::default() });
        for seed in 0..20 {
            assert_is_a_clock(&AlarmClock::sample(seed));
        }
    }

    #[test]
    fn a_seed_is_a_clock() {
        assert_eq!(AlarmClock::sample(7), AlarmClock::sample(7));
        assert_ne!(AlarmClock::sample(7), AlarmClock::sample(8));
    }

    #[test]
    fn the_hands_show_the_hour() {
        // Three o'clock: the hour hand points right, the minute hand up.
        let clock = AlarmClock { hour: 3.0, ..AlarmClock::default() }.build();
        let (colors, hands) = (clock.colors.unwrap_or_default(), ClockColors::default().hands);
        let hand = |want: fn(&[f32; 3]) -> bool| {
            clock.positions.iter().zip(&colors).any(|(p, &c)| c == hands && want(p))
        };
        assert!(hand(|p| p[0] > 0.4) && hand(|p| p[1] > 0.6));
        assert!(!hand(|p| p[0] < -0.2) && !hand(|p| p[1] < -0.2));
    }

    #[test]
    fn parts_touch_the_body_and_not_each_other() {
        // Bells and knob leave a gap, so no hole opens between them.
        for seed in 0..50 {
            let c = AlarmClock::sample(seed);
            let inner = c.bell_angle.to_radians().sin() * (1.0 + 0.3 * c.bell_radius)
                - c.bell_angle.to_radians().cos() * c.bell_radius;
            assert!(inner > 0.2, "seed {seed}: the bells come within {inner} of the middle");
        }
    }
}
