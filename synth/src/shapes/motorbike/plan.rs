//! The lines of a motorbike, drawn before any of it is made.

use mesh_core::TriMesh;

use super::super::draw::Draw;
use super::super::solid::{self, Point, sub};

pub(super) const STEEL: [f32; 3] = [0.72, 0.73, 0.75];
pub(super) const CHROME: [f32; 3] = [0.82, 0.83, 0.85];
pub(super) const ENGINE: [f32; 3] = [0.4, 0.41, 0.43];
pub(super) const DARK: [f32; 3] = [0.11, 0.11, 0.12];
pub(super) const GLASS: [f32; 3] = [0.2, 0.26, 0.31];
pub(super) const LIGHT: [f32; 3] = [0.97, 0.96, 0.88];
pub(super) const RED: [f32; 3] = [0.8, 0.05, 0.05];
pub(super) const X: Point = [1.0, 0.0, 0.0];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Style {
    Sport,
    Naked,
    Cruiser,
    Touring,
    Dirt,
    Scooter,
}

/// Wheelbase, radii of the wheels, widths of the tyres, rake in degrees, heights of head and seat.
pub(super) type Lines = [f64; 8];

/// Every style with its name and its lines.
pub(super) const STYLES: [(Style, &str, Lines); 6] = [
    (Style::Sport, "sport", [1.4, 0.305, 0.3, 0.19, 0.13, 24.0, 0.86, 0.8]),
    (Style::Naked, "naked", [1.43, 0.305, 0.3, 0.18, 0.13, 25.0, 0.88, 0.79]),
    (Style::Cruiser, "cruiser", [1.66, 0.31, 0.33, 0.2, 0.13, 34.0, 0.86, 0.66]),
    (Style::Touring, "touring", [1.52, 0.31, 0.31, 0.19, 0.14, 27.0, 0.92, 0.78]),
    (Style::Dirt, "dirt", [1.48, 0.32, 0.345, 0.13, 0.1, 27.0, 1.0, 0.92]),
    (Style::Scooter, "scooter", [1.28, 0.225, 0.225, 0.13, 0.12, 25.0, 0.82, 0.75]),
];

/// The points that all parts hang on, metres.
pub(super) struct Bike {
    pub(super) style: Style,
    /// Rear and front.
    pub(super) radii: [f64; 2],
    pub(super) widths: [f64; 2],
    pub(super) rear: Point,
    pub(super) front: Point,
    pub(super) head: Point,
    pub(super) seat: f64,
    pub(super) paint: [f32; 3],
    pub(super) accent: [f32; 3],
}

impl Bike {
    pub(super) fn draw(draw: &mut Draw, style: Style, lines: Lines) -> Self {
        let [base, rear, front, thick, thin, rake, head, seat] = lines;
        let mut vary = |value: f64, share: f64| value * draw.within(1.0 - share, 1.0 + share);
        let (base, rake) = (vary(base, 0.05), vary(rake, 0.08_f64).to_radians());
        let radii = [vary(rear, 0.04), vary(front, 0.04)];
        let widths = [vary(thick, 0.1), vary(thin, 0.08)];
        let (head, seat) = (vary(head, 0.03), vary(seat, 0.02));
        let front = [0.0, radii[1], 0.5 * base];
        let paint = match draw.count(0, 5) {
            0 => draw.pick(&[[0.12, 0.12, 0.13], [0.92, 0.92, 0.9], [0.5, 0.52, 0.55]]),
            _ => draw.color([0.75, 0.98], [0.45, 0.92]),
        };
        let accent = draw.pick(&[[0.93, 0.93, 0.92], DARK, [0.95, 0.75, 0.1], paint]);
        Self {
            style,
            radii,
            widths,
            rear: [0.0, radii[0], -0.5 * base],
            front,
            head: [0.0, head, front[2] - rake.tan() * (head - radii[1])],
            seat,
            paint,
            accent,
        }
    }

    pub(super) fn steering(&self) -> Point {
        solid::unit(sub(self.head, self.front))
    }
}

/// A solid through superellipses across the Z axis: place, height, half width, half height.
pub(super) fn hull(cuts: &[[f64; 4]], exponent: f64) -> TriMesh {
    let ring = |&[z, y, half, tall]: &[f64; 4]| -> Vec<Point> {
        let ring = solid::superellipse([half, tall], exponent, 20).into_iter();
        ring.map(|[a, b]| [a, y + b, z]).collect()
    };
    solid::loft(&cuts.iter().map(ring).collect::<Vec<_>>())
}
