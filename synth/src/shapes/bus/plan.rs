//! The lines of a bus, drawn before any of it is made.

use std::f64::consts::FRAC_PI_2;

use super::super::assembly::Assembly;
use super::super::coachwork::cut_arches;
use super::super::draw::Draw;
use super::super::solid::{self, Point};

pub(super) const GLASS: [f32; 3] = [0.12, 0.16, 0.20];
pub(super) const TRIM: [f32; 3] = [0.11, 0.11, 0.12];
pub(super) const WHITE: [f32; 3] = [0.94, 0.94, 0.92];
pub(super) const AMBER: [f32; 3] = [0.98, 0.66, 0.12];
pub(super) const RED: [f32; 3] = [0.78, 0.06, 0.06];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Style {
    City,
    DoubleDecker,
    Articulated,
    Coach,
    School,
    Minibus,
}

/// Length, width, height, ground, wheel and lean of the front, metres.
pub(super) type Lines = [f64; 6];

/// Every style with its name and its lines.
pub(super) const STYLES: [(Style, &str, Lines); 6] = [
    (Style::City, "city", [10.8, 2.5, 3.0, 0.3, 0.5, 0.16]),
    (Style::DoubleDecker, "double decker", [9.6, 2.5, 4.35, 0.3, 0.5, 0.2]),
    (Style::Articulated, "articulated", [15.5, 2.5, 3.05, 0.3, 0.5, 0.16]),
    (Style::Coach, "coach", [11.6, 2.5, 3.65, 0.35, 0.52, 0.6]),
    (Style::School, "school", [9.4, 2.4, 3.1, 0.5, 0.5, 0.12]),
    (Style::Minibus, "minibus", [6.4, 2.1, 2.75, 0.35, 0.4, 0.5]),
];

/// The lines of a bus, metres.
pub(super) struct Bus {
    pub(super) style: Style,
    pub(super) half: f64,
    pub(super) front: f64,
    pub(super) rear: f64,
    pub(super) height: f64,
    pub(super) ground: f64,
    pub(super) wheel: f64,
    /// How far the windscreen leans back.
    pub(super) lean: f64,
    /// How long and high the bonnet is; a bus without one has no length here.
    pub(super) bonnet: [f64; 2],
    /// From the rear to the front.
    pub(super) axles: Vec<f64>,
    /// Lower and upper edge of the side windows, deck by deck.
    pub(super) decks: Vec<[f64; 2]>,
    /// Radii of the edges along the roof and at front and rear, seen from above.
    pub(super) round: f64,
}

/// A stretch of bodywork from its rear to its front.
#[derive(Clone, Copy)]
pub(super) struct Stretch {
    pub(super) rear: f64,
    pub(super) front: f64,
    /// Whether the ends are those of the bus, or joints.
    pub(super) ends: [bool; 2],
}

impl Bus {
    pub(super) fn draw(draw: &mut Draw, style: Style, lines: Lines) -> Self {
        let [length, width, height, ground, wheel, lean] = lines;
        let mut vary = |value: f64, share: f64| value * draw.within(1.0 - share, 1.0 + share);
        let (length, height, width) = (vary(length, 0.09), vary(height, 0.04), vary(width, 0.03));
        let (front, rear) = (0.5 * length, -0.5 * length);
        let (wheel, lean) = (vary(wheel, 0.05), vary(lean, 0.4));
        let bonnet = if style == Style::School { [vary(1.45, 0.15), 1.62] } else { [0.0, 0.0] };
        let round = 0.23 * vary(1.0, 0.3);
        let ahead = match style {
            Style::School => 1.15 * wheel + round + 0.16,
            Style::Minibus => 1.1,
            _ => vary(2.4, 0.08),
        };
        let mut axles = vec![rear + 0.24 * length, front - ahead];
        match style {
            Style::Articulated => axles = vec![rear + 2.6, rear + 0.5 * length, front - ahead],
            Style::Coach if draw.chance(0.5) => axles.insert(1, axles[0] + 1.3),
            _ => {}
        }
        let top = height - 0.42;
        let decks = match style {
            Style::DoubleDecker => {
                vec![[1.25, 0.5 * height - 0.12], [0.5 * height + 0.55, height - 0.42]]
            }
            Style::Coach => vec![[1.75, top]],
            Style::Minibus => vec![[1.25, top + 0.05]],
            Style::School => vec![[1.75, top - 0.05]],
            _ => vec![[1.25, top]],
        };
        Self {
            style,
            half: 0.5 * width,
            front,
            rear,
            height,
            ground,
            wheel,
            lean,
            bonnet,
            axles,
            decks,
            round,
        }
    }

    /// Where the windscreen begins, at the given height.
    pub(super) fn face(&self, y: f64) -> f64 {
        let low = if self.bonnet[0] > 0.0 { self.bonnet[1] } else { self.sill() };
        let share = ((y - low) / (self.height - low)).max(0.0);
        self.front - self.bonnet[0] - self.lean * share
    }

    /// Lower edge of the windscreen.
    pub(super) fn sill(&self) -> f64 {
        match self.style {
            Style::School => 1.8,
            Style::Coach | Style::Minibus => 1.25,
            _ => 1.1,
        }
    }

    pub(super) fn body(&self, stretch: Stretch) -> mesh_core::TriMesh {
        let inner = 1.0 - self.round / self.half;
        let mut cuts: Vec<(f64, f64)> = (0..=5)
            .map(|k| {
                let (sin, cos) = (FRAC_PI_2 * f64::from(k) / 5.0).sin_cos();
                (inner + (1.0 - inner) * sin, self.round * (1.0 - cos))
            })
            .collect();
        cuts.push((0.0, 0.0));
        cuts.extend(cuts.clone()[..6].iter().map(|&(s, bend)| (-s, bend)));
        cuts.sort_by(|a, b| a.0.total_cmp(&b.0));
        let section = |&(s, bend): &(f64, f64)| -> Vec<Point> {
            let outline = self.outline(stretch, bend).into_iter();
            outline.map(|[z, y]| [s * self.half, y, z]).collect()
        };
        solid::loft(&cuts.iter().map(section).collect::<Vec<_>>())
    }

    /// The side view, drawn in by `bend` at roof and ends.
    pub(super) fn outline(&self, stretch: Stretch, bend: f64) -> Vec<[f64; 2]> {
        let [rear_bend, front_bend] = stretch.ends.map(|end| if end { bend } else { 0.2 * bend });
        let (h, g) = (self.height - bend, self.ground);
        let (r, f) = (stretch.rear + rear_bend, stretch.front - front_bend);
        let mut points = Vec::new();
        if stretch.ends[1] {
            points.extend([[f - 0.04, g], [f, g + 0.18]]);
            if self.bonnet[0] > 0.0 {
                let top = self.bonnet[1] - 0.6 * bend;
                points.extend([[f - 0.02, top - 0.35], [f - 0.12, top - 0.12], [f - 0.35, top]]);
                points.push([self.face(0.0) - front_bend + 0.02, top + 0.05]);
            } else {
                points.push([f, self.sill()]);
            }
            let head = self.face(self.height - 0.2) - front_bend;
            points.extend([[head, h - 0.2], [head - 0.05, h - 0.07], [head - 0.2, h]]);
        } else {
            points.extend([[f, g], [f, h]]);
        }
        if stretch.ends[0] {
            points.extend([[r + 0.25, h], [r + 0.07, h - 0.06], [r, h - 0.25], [r, g + 0.2]]);
            points.push([r + 0.05, g]);
        } else {
            points.extend([[r, h], [r, g]]);
        }
        let inside = |z: &&f64| (stretch.rear..stretch.front).contains(*z);
        let axles: Vec<f64> = self.axles.iter().filter(inside).copied().collect();
        cut_arches(&mut points, g, &axles, self.wheel, 1.15 * self.wheel);
        points
    }

    /// A thin upright sheet on both sides, or on one (`Some(sign)`).
    pub(super) fn on_side(
        &self,
        all: &mut Assembly,
        name: &'static str,
        (z, y): ([f64; 2], [f64; 2]),
        (round, proud): (f64, f64),
        color: [f32; 3],
        side: Option<f64>,
    ) {
        let outline: Vec<[f64; 2]> = solid::rounded_rectangle([z[1] - z[0], y[1] - y[0]], round, 2)
            .into_iter()
            .map(|[a, b]| [a + 0.5 * (z[0] + z[1]), b + 0.5 * (y[0] + y[1])])
            .collect();
        let sheet = solid::side_prism(&outline, [self.half - 0.05, self.half + proud]);
        match side {
            None => all.pair(name, sheet, color),
            Some(sign) if sign > 0.0 => all.add(name, sheet, color),
            Some(_) => all.add(name, solid::mirrored(&sheet), color),
        }
    }

    /// A sheet over the sides from the sill up, wheel arches cut out.
    pub(super) fn skirt(
        &self,
        [r, f]: [f64; 2],
        [rear_top, front_top]: [f64; 2],
    ) -> mesh_core::TriMesh {
        let arch = 1.15 * self.wheel;
        // An arch that would be cut in two stays out.
        let inside: Vec<f64> = self
            .axles
            .iter()
            .copied()
            .filter(|z| r < z - arch - 0.05 && z + arch + 0.05 < f)
            .collect();
        let mut outline = vec![[f, self.ground + 0.02], [f, front_top], [r, rear_top]];
        outline.push([r, self.ground + 0.02]);
        cut_arches(&mut outline, self.ground + 0.02, &inside, self.wheel, arch);
        solid::side_prism(&outline, [self.half - 0.05, self.half + 0.012])
    }

    /// A sheet across the front between two heights, out to a share of the half width.
    pub(super) fn on_front(
        &self,
        [low, high]: [f64; 2],
        [left, right]: [f64; 2],
    ) -> mesh_core::TriMesh {
        let at = |x: f64, y: f64| [x, y, self.face(y)];
        let corners = [at(left, low), at(right, low), at(right, high), at(left, high)];
        solid::plate(|u, v| solid::bilinear(corners, u, v), [2, 4], [0.08, 0.025])
    }
}
