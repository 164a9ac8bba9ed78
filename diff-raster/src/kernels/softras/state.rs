//! What SoftRas's forward pass finds out.

use super::face::Ready;
use crate::kernels::setup::Bands;

/// What the forward pass over one image finds out, for its gradient.
#[derive(Debug, Default)]
pub(super) struct ImageState<F> {
    pub(super) faces: Vec<Ready<F>>,
    pub(super) bands: Bands,
    /// Per pixel: `Π (1 - D)`, `max ζ`, `Σ W`.
    pub(super) sums: Vec<[F; 3]>,
    /// Per face: gradient of its corners, and of their colours.
    pub(super) grads: Vec<[F; 9]>,
    pub(super) of_corners: Vec<F>,
}

/// What the forward pass over a batch finds out.
#[derive(Debug, Default)]
pub struct State<F> {
    pub(super) images: Vec<ImageState<F>>,
}
