//! The soft silhouette. The rule stands in
//! [`kernels::silhouette`](crate::kernels::silhouette).

use std::sync::{Arc, Mutex};

use autodiff_lite::{Backward, CONTIGUOUS, Op, Real, Var};

use crate::Fragments;
use crate::kernels::silhouette::{State, soft_silhouette as forward, soft_silhouette_grad};
use crate::ops::check_projected;

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
/// [`antialiased_silhouette`](crate::antialiased_silhouette).
/// # Cost
/// `O(F + H W)` plus the pixels of the enlarged boxes that hold background. No list per pixel.
/// # Panics
/// If the shape does not fit what was rasterised.
/// # References
/// Chen et al. 2019, *Learning to Predict 3D Objects with an Interpolation-based Differentiable
/// Renderer*, equation 5.
#[track_caller]
pub fn soft_silhouette<'t, F: Real>(
    projected: Var<'t, F>,
    fragments: &Arc<Fragments<F>>,
) -> Var<'t, F> {
    check_projected("soft_silhouette", projected, fragments);
    let tape = projected.tape();
    let positions = projected.value();
    let mut out = tape.array(&fragments.shape());
    let mut state = fragments.silhouettes.take();
    forward(
        fragments,
        positions.as_slice().expect(CONTIGUOUS),
        &mut state,
        out.as_slice_mut().expect(CONTIGUOUS),
    );
    let op = SoftSilhouette { fragments: Arc::clone(fragments), state: Mutex::new(Some(state)) };
    tape.record(&[projected], out, op)
}

struct SoftSilhouette<F: Real> {
    fragments: Arc<Fragments<F>>,
    /// There until drop, which gives it back to the fragments.
    state: Mutex<Option<State<F>>>,
}

impl<F: Real> Op<F> for SoftSilhouette<F> {
    fn name(&self) -> &'static str {
        "soft_silhouette"
    }

    fn pullback(&self, cx: &mut Backward<'_, F>) {
        let grad = cx.grad_out();
        let grad = grad.as_slice().expect(CONTIGUOUS);
        let mut state = self.state.lock().expect("no rule panics while it holds the state");
        let state = state.as_mut().expect("there until drop");
        soft_silhouette_grad(&self.fragments, state, grad, cx.grad_slice_mut(0));
    }
}

impl<F: Real> Drop for SoftSilhouette<F> {
    fn drop(&mut self) {
        if let Ok(state) = self.state.get_mut()
            && let Some(state) = state.take()
        {
            self.fragments.silhouettes.give(state);
        }
    }
}
