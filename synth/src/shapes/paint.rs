//! What a part is painted with: one colour, or a pattern of two.

use std::f64::consts::TAU;

use mesh_core::TriMesh;

use super::draw::{Draw, hsv};

/// An sRGB colour.
pub(super) type Color = [f32; 3];

/// A colour for each place on a part, in the part's own frame before it is put in its place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Paint {
    /// The same everywhere.
    Plain(Color),
    /// Bands of this width across an axis.
    Stripes { colors: [Color; 2], axis: usize, width: f64 },
    /// Squares of this width in the plane of two axes.
    Checks { colors: [Color; 2], axes: [usize; 2], width: f64 },
    /// Soft veins along an axis, as of wood.
    Grain { colors: [Color; 2], along: usize },
    /// Rings around the Y axis, the outermost from `edge` outwards.
    Border { colors: [Color; 2], edge: f64 },
}

/// Half of how wide the change of colour at the edge of a stripe is.
const BLUR: f64 = 0.0012;

impl Paint {
    /// A draw of a material: wood, metal or, of any other name, lacquer.
    pub(super) fn of(material: &str, draw: &mut Draw) -> Self {
        match material {
            "wood" => Self::wood(draw),
            "metal" => Self::metal(draw),
            _ => Self::lacquer(draw),
        }
    }

    /// Wood of a drawn tone.
    pub(super) fn wood(draw: &mut Draw) -> Self {
        let (hue, saturation) = (draw.within(0.055, 0.105), draw.within(0.4, 0.75));
        let value = draw.within(0.35, 0.88);
        let light = hsv(hue, saturation, value);
        let dark = hsv(hue - 0.01, (saturation + 0.08).min(1.0), value * 0.74);
        Self::Grain { colors: [light, dark], along: 1 }
    }

    /// Bare or lacquered metal.
    pub(super) fn metal(draw: &mut Draw) -> Self {
        Self::Plain(match draw.count(0, 3) {
            0 => hsv(0.6, 0.05, draw.within(0.66, 0.82)),
            1 => hsv(0.6, 0.12, draw.within(0.24, 0.34)),
            2 => hsv(draw.within(0.1, 0.13), 0.55, draw.within(0.68, 0.85)),
            _ => hsv(draw.within(0.04, 0.07), 0.55, draw.within(0.5, 0.66)),
        })
    }

    /// One strong or pale lacquer.
    pub(super) fn lacquer(draw: &mut Draw) -> Self {
        Self::Plain(match draw.count(0, 5) {
            0 => hsv(0.1, 0.05, draw.within(0.85, 0.95)),
            1 => hsv(0.6, 0.1, draw.within(0.22, 0.32)),
            _ => draw.color([0.45, 0.85], [0.5, 0.9]),
        })
    }

    /// Cloth: plain, striped or checked. Also the pattern's name.
    pub(super) fn cloth(draw: &mut Draw, width: f64) -> (Self, &'static str) {
        let first = draw.color([0.3, 0.8], [0.4, 0.85]);
        let other = if draw.chance(0.5) { hsv(0.12, 0.08, 0.93) } else { first.map(|c| 0.45 * c) };
        let colors = [first, other];
        match draw.count(0, 2) {
            0 => (Self::Plain(first), "plain"),
            1 => (Self::Stripes { colors, axis: 0, width }, "striped"),
            _ => (Self::Checks { colors, axes: [0, 2], width }, "checked"),
        }
    }

    /// The same pattern with its veins, or its second direction, along another axis.
    pub(super) fn along(self, axis: usize) -> Self {
        match self {
            Self::Grain { colors, .. } => Self::Grain { colors, along: axis },
            Self::Checks { colors, width, .. } => Self::Checks { colors, axes: [0, axis], width },
            other => other,
        }
    }

    /// The colour that there is most of.
    pub(super) fn main(self) -> Color {
        match self {
            Self::Plain(color) => color,
            Self::Stripes { colors, .. }
            | Self::Checks { colors, .. }
            | Self::Grain { colors, .. }
            | Self::Border { colors, .. } => colors[0],
        }
    }

    /// The colour at a place.
    fn at(self, p: [f32; 3]) -> Color {
        let p = p.map(f64::from);
        let band = |axis: usize, width: f64| (p[axis] / width + 0.5).floor() as i64;
        match self {
            Self::Plain(color) => color,
            Self::Stripes { colors, axis, width } => colors[(band(axis, width) & 1) as usize],
            Self::Checks { colors, axes: [u, v], width } => {
                colors[((band(u, width) + band(v, width)) & 1) as usize]
            }
            Self::Grain { colors, along } => {
                let (u, v) = (p[(along + 1) % 3], p[(along + 2) % 3]);
                let bend = 0.8 * (TAU * p[along] * 1.7 + 3.0 * u).sin();
                let vein = 0.5 + 0.5 * (TAU * 9.0 * (u + 0.83 * v) + bend).sin();
                mix(colors, vein * vein)
            }
            Self::Border { colors, edge } => colors[usize::from(p[0].hypot(p[2]) > edge)],
        }
    }

    /// Where along an axis, between `-half` and `half`, vertices must lie for edges to be sharp.
    pub(super) fn cuts(self, axis: usize, half: f64) -> Vec<f64> {
        let width = match self {
            Self::Stripes { axis: across, width, .. } if across == axis => width,
            Self::Checks { axes, width, .. } if axes.contains(&axis) => width,
            _ => return Vec::new(),
        };
        let mut cuts = Vec::new();
        let mut edge = 0.5 * width;
        while edge < half {
            for side in [-1.0, 1.0] {
                cuts.extend([side * edge - BLUR, side * edge + BLUR]);
            }
            edge += width;
        }
        cuts
    }

    /// The mesh in this paint.
    pub(super) fn on(self, mesh: TriMesh) -> TriMesh {
        let mut mesh = mesh;
        mesh.colors = Some(mesh.positions.iter().map(|&p| self.at(p)).collect());
        mesh
    }
}

fn mix([a, b]: [Color; 2], share: f64) -> Color {
    std::array::from_fn(|k| a[k] + share as f32 * (b[k] - a[k]))
}
