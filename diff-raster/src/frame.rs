//! Images of meshes on a tape.

use std::sync::Arc;

use autodiff_lite::{Real, Var};

use crate::{Fragments, Scratch, ops};

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
    projected: Var<'t, F>,
    fragments: Arc<Fragments<F>>,
    scratch: Scratch<F>,
}

impl<'t, F: Real> Frame<'t, F> {
    /// A frame of visibility that is known already: of the same meshes, from [`rasterize`](crate::rasterize)
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

    /// Attributes of the vertices at each pixel, zero at background; see
    /// [`interpolate`](crate::interpolate).
    ///
    /// # Shapes
    /// `attributes [V, C]` or `[N, V, C]`. Result `[N, H, W, C]`.
    /// # Panics
    /// If the attributes do not fit the vertices.
    #[track_caller]
    pub fn interpolate(&self, attributes: Var<'t, F>) -> Var<'t, F> {
        let Self { projected, fragments, scratch } = self;
        ops::interpolate_vertices(*projected, attributes, fragments, scratch)
    }

    /// Attributes of the corners of faces at each pixel, zero at background; see
    /// [`interpolate_corners`](crate::interpolate_corners).
    ///
    /// # Shapes
    /// `attributes [F, 3, C]`. Result `[N, H, W, C]`.
    /// # Panics
    /// If the attributes do not fit the faces.
    #[track_caller]
    pub fn interpolate_corners(&self, attributes: Var<'t, F>) -> Var<'t, F> {
        let Self { projected, fragments, scratch } = self;
        ops::interpolate_faces(*projected, attributes, fragments, scratch)
    }

    /// DIB-R's soft silhouette; see [`soft_silhouette`](crate::soft_silhouette).
    ///
    /// # Shapes
    /// Result `[N, H, W]` in `[0, 1]`.
    #[track_caller]
    pub fn soft_silhouette(&self) -> Var<'t, F> {
        ops::draw_soft(self.projected, &self.fragments, &self.scratch)
    }

    /// Coverage with the sub-pixel position of the silhouette; see
    /// [`antialiased_silhouette`](crate::antialiased_silhouette).
    ///
    /// # Shapes
    /// Result `[N, H, W]` in `[0, 1]`.
    #[track_caller]
    pub fn antialiased_silhouette(&self) -> Var<'t, F> {
        ops::draw_antialiased(self.projected, &self.fragments, &self.scratch)
    }

    /// Planar depth, and `background` where nothing is seen; see [`depth`](crate::depth).
    ///
    /// # Shapes
    /// Result `[N, H, W]`.
    #[track_caller]
    pub fn depth(&self, background: F) -> Var<'t, F> {
        ops::draw_depth(self.projected, &self.fragments, background, &self.scratch)
    }

    /// Colours of a texture, zero at background; see [`texture`](crate::texture).
    ///
    /// # Shapes
    /// `uv [N, H, W, 2]`, [interpolated](Self::interpolate_corners); `image [Ht, Wt, C]`. Result
    /// `[N, H, W, C]`.
    /// # Panics
    /// If `uv` does not have the size of this frame.
    #[track_caller]
    pub fn texture(&self, uv: Var<'t, F>, image: Var<'t, F>) -> Var<'t, F> {
        ops::draw_texture(uv, image, &self.fragments, &self.scratch)
    }
}
