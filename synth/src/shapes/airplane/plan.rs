//! The lines of an airplane, drawn before any of it is made.

use std::f64::consts::TAU;

use mesh_core::TriMesh;

use super::super::draw::Draw;
use super::super::solid::{self, Point};

pub(super) const GLASS: [f32; 3] = [0.12, 0.16, 0.21];
pub(super) const METAL: [f32; 3] = [0.68, 0.69, 0.71];
pub(super) const DARK: [f32; 3] = [0.13, 0.13, 0.14];
pub(super) const WHITE: [f32; 3] = [0.95, 0.95, 0.94];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Style {
    Airliner,
    Jumbo,
    Business,
    Propeller,
    Turboprop,
    Fighter,
}

/// Every style with its name and how many radii the fuselage is long, at least and at most.
pub(super) const STYLES: [(Style, &str, [f64; 2]); 6] = [
    (Style::Airliner, "airliner", [9.5, 12.0]),
    (Style::Jumbo, "jumbo", [9.0, 10.0]),
    (Style::Business, "business jet", [7.5, 9.0]),
    (Style::Propeller, "propeller", [5.6, 6.8]),
    (Style::Turboprop, "turboprop", [8.8, 10.5]),
    (Style::Fighter, "fighter", [9.0, 11.0]),
];

/// The lines of an airplane, metres; the fuselage's middle is at the origin.
pub(super) struct Plane {
    pub(super) length: f64,
    pub(super) radius: f64,
    /// Cross-sections: share of the length from the nose, half width, top and bottom.
    pub(super) cuts: Vec<[f64; 4]>,
}

impl Plane {
    pub(super) fn draw(draw: &mut Draw, style: Style, [low, high]: [f64; 2]) -> Self {
        let slender = draw.within(low, high);
        let hump = if style == Style::Jumbo { draw.pick(&[0.55, 0.75]) } else { 0.0 };
        let length = 10.0;
        let r = length / slender;
        // Share of the length, half width, top and bottom, in radii.
        let profile: &[[f64; 4]] = match style {
            Style::Propeller => &[
                [0.0, 0.45, 0.35, -0.45],
                [0.02, 0.7, 0.5, -0.65],
                [0.12, 0.85, 0.6, -0.85],
                [0.24, 0.95, 0.68, -0.95],
                [0.29, 1.0, 0.95, -0.98],
                [0.36, 1.0, 1.25, -1.0],
                [0.46, 0.98, 1.28, -1.0],
                [0.58, 0.8, 0.9, -0.8],
                [0.72, 0.5, 0.55, -0.45],
                [0.9, 0.2, 0.35, -0.05],
                [1.0, 0.06, 0.25, 0.08],
            ],
            Style::Fighter => &[
                [0.0, 0.03, 0.0, -0.06],
                [0.06, 0.24, 0.18, -0.26],
                [0.16, 0.48, 0.42, -0.5],
                [0.3, 0.7, 0.62, -0.7],
                [0.42, 1.05, 0.68, -0.78],
                [0.6, 1.15, 0.66, -0.78],
                [0.85, 0.95, 0.55, -0.62],
                [0.97, 0.62, 0.45, -0.48],
                [1.0, 0.55, 0.4, -0.42],
            ],
            _ => &[
                [0.0, 0.04, -0.22, -0.3],
                [0.008, 0.25, 0.02, -0.5],
                [0.025, 0.48, 0.28, -0.68],
                [0.05, 0.7, 0.58, -0.84],
                [0.085, 0.88, 0.86, -0.95],
                [0.13, 0.98, 0.98, -1.0],
                [0.2, 1.0, 1.0, -1.0],
                [0.4, 1.0, 1.0, -1.0],
                [0.62, 1.0, 1.0, -1.0],
                [0.75, 0.9, 1.0, -0.72],
                [0.87, 0.58, 0.92, -0.12],
                [0.96, 0.27, 0.78, 0.34],
                [1.0, 0.07, 0.66, 0.5],
            ],
        };
        // A second deck over the front, or over all of the cabin.
        let raised = |share: f64| match hump {
            h if h > 0.7 => {
                0.42 * ((share - 0.03) / 0.1).clamp(0.0, 1.0) * (1.0 - share).min(0.4) / 0.4
            }
            h if h > 0.0 => {
                let up = ((share - 0.02) / 0.07).clamp(0.0, 1.0);
                let down = ((0.42 - share) / 0.16).clamp(0.0, 1.0);
                0.5 * up.min(1.0) * down * down * (3.0 - 2.0 * down)
            }
            _ => 0.0,
        };
        let mut shares: Vec<f64> = profile.iter().map(|p| p[0]).collect();
        shares.extend([0.28, 0.34, 0.5]);
        shares.sort_by(f64::total_cmp);
        shares.dedup_by(|a, b| (*a - *b).abs() < 0.015);
        let cuts = shares
            .into_iter()
            .map(|share| {
                let [half, top, bottom] = read(profile, share);
                [share, half * r, (top + raised(share)) * r, bottom * r]
            })
            .collect();
        Self { length, radius: r, cuts }
    }

    pub(super) fn z(&self, share: f64) -> f64 {
        (0.5 - share) * self.length
    }

    /// Half width, top, bottom at a share of the length.
    pub(super) fn at(&self, share: f64) -> [f64; 3] {
        read(&self.cuts, share)
    }

    /// The skin at a share of the length and an angle up from the left side.
    pub(super) fn skin(&self, share: f64, angle: f64) -> Point {
        let [half, top, bottom] = self.at(share);
        let middle = middle(top, bottom);
        let (sin, cos) = angle.sin_cos();
        let rise = if sin > 0.0 { top - middle } else { middle - bottom };
        [half * cos, middle + rise * sin, self.z(share)]
    }

    pub(super) fn fuselage(&self) -> TriMesh {
        let ring = |cut: &[f64; 4]| -> Vec<Point> {
            (0..32).map(|k| self.skin(cut[0], TAU * f64::from(k) / 32.0)).collect()
        };
        solid::loft(&self.cuts.iter().map(ring).collect::<Vec<_>>())
    }

    /// A sheet on the left side: between two shares of the length and two angles.
    pub(super) fn sheet(&self, shares: [f64; 2], angles: [f64; 2], grid: [usize; 2]) -> TriMesh {
        let surface = |u: f64, v: f64| {
            let share = shares[0] + (shares[1] - shares[0]) * u;
            self.skin(share, angles[0] + (angles[1] - angles[0]) * v)
        };
        solid::plate(surface, grid, [0.03, 0.018])
    }
}

/// Where the two halves of a cross-section meet.
pub(super) fn middle(top: f64, bottom: f64) -> f64 {
    bottom + (top - bottom) * 0.48
}

/// Reads a table of `[share, a, b, c]` between its rows.
pub(super) fn read(table: &[[f64; 4]], share: f64) -> [f64; 3] {
    let k = table.windows(2).position(|w| share <= w[1][0]).unwrap_or(table.len() - 2);
    let (a, b) = (table[k], table[k + 1]);
    let t = ((share - a[0]) / (b[0] - a[0])).clamp(0.0, 1.0);
    [1, 2, 3].map(|i| a[i] + (b[i] - a[i]) * t)
}

pub(super) struct Colors {
    pub(super) body: [f32; 3],
    pub(super) accent: [f32; 3],
    pub(super) wing: [f32; 3],
    pub(super) livery: &'static str,
}
