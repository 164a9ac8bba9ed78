//! Silhouettes: DIB-R's soft one and the antialiased one. The rules stand in
//! [`kernels::silhouette`](crate::kernels::silhouette) and
//! [`kernels::antialias`](crate::kernels::antialias).

use std::cell::RefCell;
use std::sync::Arc;

use autodiff_lite::{Backward, Real, Var};

use crate::kernels::{antialias, silhouette};
use crate::{Fragments, Frame, Scratch};

/// DIB-R's soft silhouette: 1 where a face is seen, and around it the probability that any face
/// reaches the pixel.
///
/// ```text
/// s(p) = 1 - Π_f (1 - exp(-sigma_inv d²(p, f)))      over the faces whose enlarged box holds p
/// ```
///
/// # Shapes
/// `projected [N, V, 3]`, the positions that were rasterised. Result `[N, H, W]` in `[0, 1]`.
/// # Gradient
/// To the screen positions; none to depth, and none from pixels that show a face: a silhouette
/// that is too large shrinks only where other losses see it, or by
/// [`antialiased_silhouette`].
/// # Cost
/// `O(F + H W)` plus the pixels of the enlarged boxes that hold background. No list per pixel.
/// # Panics
/// If the shape does not fit what was rasterised.
/// # References
/// Chen et al. 2019, *Learning to Predict 3D Objects with an Interpolation-based Differentiable
/// Renderer*, equation 5.
#[track_caller]
#[inline(never)]
pub fn soft_silhouette<'t, F: Real>(
    projected: Var<'t, F>,
    fragments: &Arc<Fragments<F>>,
) -> Var<'t, F> {
    Frame::new(projected, Arc::clone(fragments), Scratch::default()).soft_silhouette()
}

/// Coverage of each pixel with the sub-pixel position of the silhouette: hard inside and outside,
/// exact on straight borders.
///
/// Coverage is 1/2 where the silhouette passes a pixel centre and changes linearly with its
/// position, so that thresholding at 1/2 gives the hard mask of the same mesh. Unlike
/// [`soft_silhouette`] it is not larger than the object, and pixels just inside pull as those just
/// outside do; but gradients reach only silhouettes within a pixel of where they should be.
///
/// # Shapes
/// `projected [N, V, 3]`, the positions that were rasterised. Result `[N, H, W]` in `[0, 1]`.
/// # Gradient
/// To the screen positions of silhouette edges; none to depth. Exact for the coverage as computed,
/// with kinks where an edge passes a vertex, a pixel centre or a diagonal direction.
/// # Cost
/// `O(H W)` to find the border, then a walk over a few faces per border pixel.
/// # Panics
/// If the shape does not fit what was rasterised.
/// # References
/// After Laine et al. 2020, *Modular Primitives for High-Performance Differentiable Rendering*,
/// section 3.4.
#[track_caller]
#[inline(never)]
pub fn antialiased_silhouette<'t, F: Real>(
    projected: Var<'t, F>,
    fragments: &Arc<Fragments<F>>,
) -> Var<'t, F> {
    Frame::new(projected, Arc::clone(fragments), Scratch::default()).antialiased_silhouette()
}

impl<'t, F: Real> Frame<'t, F> {
    /// DIB-R's soft silhouette; see [`soft_silhouette`].
    ///
    /// # Shapes
    /// Result `[N, H, W]` in `[0, 1]`.
    #[track_caller]
    #[inline(never)]
    pub fn soft_silhouette(&self) -> Var<'t, F> {
        self.check("soft_silhouette");
        let Self { projected, fragments, scratch } = self;
        let (tape, positions) = (projected.tape(), projected.value());
        let mut out = tape.array(&fragments.shape());
        let mut state = scratch.silhouettes.lend();
        silhouette::soft_silhouette(
            fragments,
            positions.as_slice(),
            &mut state,
            out.as_slice_mut(),
        );
        let (fragments, state) = (Arc::clone(fragments), RefCell::new(state));
        tape.record_fn("soft_silhouette", &[*projected], out, move |cx: &mut Backward<'_, F>| {
            let (grad, state) = (cx.grad_out(), &mut *state.borrow_mut());
            let (grad, out) = (grad.as_slice(), cx.grad_slice_mut(0));
            silhouette::soft_silhouette_grad(&fragments, state, grad, out);
        })
    }

    /// Coverage with the sub-pixel position of the silhouette; see
    /// [`antialiased_silhouette`].
    ///
    /// # Shapes
    /// Result `[N, H, W]` in `[0, 1]`.
    #[track_caller]
    #[inline(never)]
    pub fn antialiased_silhouette(&self) -> Var<'t, F> {
        self.check("antialiased_silhouette");
        let Self { projected, fragments, scratch } = self;
        let (tape, positions) = (projected.tape(), projected.value());
        let mut out = tape.array(&fragments.shape());
        let mut state = scratch.borders.lend();
        antialias::antialiased_silhouette(
            fragments,
            positions.as_slice(),
            &mut state,
            out.as_slice_mut(),
        );
        let (name, fragments) = ("antialiased_silhouette", Arc::clone(fragments));
        tape.record_fn(name, &[*projected], out, move |cx: &mut Backward<'_, F>| {
            let grad = cx.grad_out();
            let (grad, out) = (grad.as_slice(), cx.grad_slice_mut(0));
            antialias::antialiased_silhouette_grad(&fragments, &state, grad, out);
        })
    }
}
