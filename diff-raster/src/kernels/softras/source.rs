//! Where the colour of a face at a pixel comes from.

use autodiff_lite::Real;

use super::face::TEXEL_GUARD;
use crate::kernels::lanes::{Lanes, MAX_LANES, three};

/// Colours of faces.
#[derive(Clone, Copy, Debug)]
pub enum Colors<'a, F> {
    /// Of vertices, `[N, V, C]`, interpolated.
    Vertices(&'a [F]),
    /// Of `side²` texels of each face, `[N, F, side², C]`; the nearest counts.
    Texels(&'a [F], usize),
}

impl<'a, F> Colors<'a, F> {
    pub(super) fn all(self) -> &'a [F] {
        match self {
            Self::Vertices(all) | Self::Texels(all, _) => all,
        }
    }
}

/// Offsets into the colours of an image.
#[derive(Clone, Copy)]
pub(super) enum Source<L: Lanes> {
    /// Of the corners, with their weights.
    Corners([usize; 3], [L::V; 3]),
    /// Of the texel of each lane.
    Texels([usize; MAX_LANES]),
}

impl<L: Lanes> Source<L> {
    #[inline(always)]
    pub(super) fn color(&self, l: L, colors: &[L::F], channel: usize) -> L::V {
        match self {
            Self::Corners(from, weights) => {
                let corner = three!(i => l.splat(colors[from[i] + channel]));
                let last = l.mul(weights[2], corner[2]);
                l.fma(weights[0], corner[0], l.fma(weights[1], corner[1], last))
            }
            Self::Texels(from) => {
                let mut lanes = [L::F::from_f64(0.0); MAX_LANES];
                for (lane, &from) in lanes[..L::N].iter_mut().zip(from) {
                    *lane = colors[from + channel];
                }
                l.load(&lanes)
            }
        }
    }

    /// The texels of a face, whose colours begin at `first`, that weights fall on.
    #[inline(always)]
    pub(super) fn texels(
        l: L,
        cut: &[L::V; 3],
        side: usize,
        [first, channels]: [usize; 2],
    ) -> Self {
        let mut lanes = [[L::F::from_f64(0.0); MAX_LANES]; 2];
        l.store(&mut lanes[0], cut[0]);
        l.store(&mut lanes[1], cut[1]);
        let mut from = [first; MAX_LANES];
        for (i, from) in from[..L::N].iter_mut().enumerate() {
            *from += texel([lanes[0][i], lanes[1][i]], side) * channels;
        }
        Self::Texels(from)
    }
}

/// The texel that the first two weights fall on.
///
/// Beyond the side opposite to corner 2 they add up to 1, and rounding must not say on which side of a
/// diagonal that is.
#[inline(always)]
fn texel<F: Real>(cut: [F; 2], side: usize) -> usize {
    let size = side as f64;
    let (x, y) = (cut[0].to_f64() * size, cut[1].to_f64() * size);
    let (column, row) = ((x as usize).min(side - 1), (y as usize).min(side - 1));
    if x + y - (column + row) as f64 <= 1.0 + TEXEL_GUARD {
        row * side + column
    } else {
        (side - 1 - row) * side + (side - 1 - column)
    }
}
