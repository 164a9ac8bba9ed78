//! What SoftRas's forward pass finds out.

use super::face::Ready;
use crate::kernels::lanes::MAX_LANES;
use crate::kernels::setup::{BAND_ROWS, Bands};

/// Where planes of numbers of the pixels lie: bands of rows one after the other, in each of them plane after
/// plane, and behind each row room for a vector that begins at its last pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layout {
    planes: usize,
    stride: usize,
}

impl Layout {
    pub(super) fn new(planes: usize, width: usize) -> Self {
        Self { planes, stride: width + MAX_LANES }
    }

    /// Numbers of a row.
    pub(super) fn stride(self) -> usize {
        self.stride
    }

    /// Numbers of a plane of a band: so far apart are the planes of a pixel.
    #[inline(always)]
    pub(super) fn plane(self) -> usize {
        BAND_ROWS * self.stride
    }

    /// Numbers of a band.
    #[inline(always)]
    pub(super) fn band(self) -> usize {
        self.planes * self.plane()
    }

    /// Numbers of an image.
    pub(super) fn len(self, height: usize) -> usize {
        height.div_ceil(BAND_ROWS) * self.band()
    }

    /// Where the first plane has a pixel.
    #[inline(always)]
    pub(super) fn at(self, row: usize, column: usize) -> usize {
        row / BAND_ROWS * self.band() + row % BAND_ROWS * self.stride + column
    }
}

/// What the forward pass over one image finds out, for its gradient.
#[derive(Debug, Default)]
pub(super) struct ImageState<F> {
    pub(super) faces: Vec<Ready<F>>,
    pub(super) bands: Bands,
    /// Planes of `Π (1 - D)`, `max ζ`, `Σ W`, and `Σ W colour` of each channel.
    pub(super) sums: Vec<F>,
    /// Planes of what the gradient of a face needs to know of a pixel.
    pub(super) pulls: Vec<F>,
    /// Per face: gradient of its corners, and of their colours.
    pub(super) grads: Vec<[F; 9]>,
    pub(super) of_corners: Vec<F>,
}

/// What the forward pass over a batch finds out.
#[derive(Debug, Default)]
pub struct State<F> {
    pub(super) images: Vec<ImageState<F>>,
}
