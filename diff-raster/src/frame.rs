//! Images of meshes on a tape.

use std::sync::Arc;

use autodiff_lite::{Real, Var};

use crate::{Fragments, Scratch};

/// What is seen of a batch of meshes, ready to be drawn: projected positions with their fragments.
///
/// Each method puts one image, or a batch of them, on the tape of the positions; the free function of
/// the same name says what it is. Drop a frame before the tape is reset, as any [`Var`]: its memory is
/// then used for the next one.
///
/// ```
/// use std::sync::Arc;
///
/// use autodiff_lite::Tape;
/// use diff_raster::{Faces, Renderer, Settings};
/// use ndarray::{arr2, arr3};
///
/// let renderer = Renderer::new(Arc::new(Faces::new(3, &[[0, 1, 2]])?), Settings::new(4, 4));
/// let tape = Tape::eval();
/// let corners = arr3(&[[[-1.0, -1.0, 2.0], [1.0, -1.0, 2.0], [-1.0, 1.0, 2.0]]]);
/// let frame = renderer.frame(tape.constant(corners));
/// let colors = tape.constant(arr2(&[[1.0_f32, 0.0, 0.0]; 3]));
/// assert_eq!(frame.interpolate(colors).value()[[0, 0, 0, 0]], 1.0); // red over the lower left half
/// assert_eq!(frame.depth(9.0).value()[[0, 0, 3]], 9.0); // and nothing in the upper right corner
/// assert_eq!(frame.mask()[..4], [1.0, 0.0, 0.0, 0.0]);
/// # Ok::<(), diff_raster::FacesError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Frame<'t, F: Real = f32> {
    pub(crate) projected: Var<'t, F>,
    pub(crate) fragments: Arc<Fragments<F>>,
    pub(crate) scratch: Scratch<F>,
}

impl<'t, F: Real> Frame<'t, F> {
    /// A frame of visibility that is known already: of the same meshes, from [`rasterize`](crate::rasterize())
    /// or an earlier frame. [`Renderer::frame`](crate::Renderer::frame) finds it.
    ///
    /// # Shapes
    /// `projected [N, V, 3]`, the positions that were rasterised; methods panic if it has another shape.
    pub fn new(projected: Var<'t, F>, fragments: Arc<Fragments<F>>, scratch: Scratch<F>) -> Self {
        Self { projected, fragments, scratch }
    }

    /// What is seen at each pixel, without a gradient.
    pub fn fragments(&self) -> &Arc<Fragments<F>> {
        &self.fragments
    }

    /// Hard coverage, without a gradient: 1 where a face is seen, else 0.
    ///
    /// # Shapes
    /// Result `[N, H, W]`, row-major.
    pub fn mask(&self) -> Vec<F> {
        self.fragments.mask()
    }

    /// Checks that the positions have the shape of those that were rasterised.
    #[track_caller]
    pub(crate) fn check(&self, op: &'static str) {
        let [batch, ..] = self.fragments.shape();
        let expected = [batch, self.fragments.faces().vertex_count(), 3];
        let shape = self.projected.shape();
        if shape != expected {
            let message = "the positions are not those that were rasterised";
            let operands =
                [("projected", &shape[..], "N, V, 3"), ("rasterised", &expected, "N, V, 3")];
            self.projected.tape().refuse(op, message, &operands);
        }
    }
}
