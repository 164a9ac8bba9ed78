//! Depth as a differentiable image: the positions' own depth, interpolated.

use std::sync::Arc;

use autodiff_lite::{Backward, Real, Tensor, Var};

use crate::faces::NONE;
use crate::kernels::gather::gather;
use crate::kernels::interpolate::{Attributes, Incoming, Layout, interpolate_grad};
use crate::{Fragments, Frame, Scratch};

/// Planar depth at each pixel, and `background` where nothing is seen.
///
/// In [`Fragments::depth`] the background is `+∞`, which no loss survives: choose a number that
/// suits the loss, and mask it there.
///
/// # Shapes
/// `projected [N, V, 3]`, the positions that were rasterised. Result `[N, H, W]`.
/// # Gradient
/// To screen positions and depths, with visibility held fixed; perspective if the settings are.
/// # Cost
/// `O(N H W)`.
/// # Panics
/// If the shape does not fit what was rasterised.
#[track_caller]
#[inline(never)]
pub fn depth<'t, F: Real>(
    projected: Var<'t, F>,
    fragments: &Arc<Fragments<F>>,
    background: F,
) -> Var<'t, F> {
    Frame::new(projected, Arc::clone(fragments), Scratch::default()).depth(background)
}

impl<'t, F: Real> Frame<'t, F> {
    /// Planar depth, and `background` where nothing is seen; see [`depth`].
    ///
    /// # Shapes
    /// Result `[N, H, W]`.
    #[track_caller]
    #[inline(never)]
    pub fn depth(&self, background: F) -> Var<'t, F> {
        self.check("depth");
        let (tape, fragments) = (self.projected.tape(), Arc::clone(&self.fragments));
        let scratch = self.scratch.clone();
        let mut out = tape.array(&fragments.shape());
        let pixels = fragments.depth.iter().zip(&fragments.face);
        for (out, (&z, &face)) in out.as_slice_mut().iter_mut().zip(pixels) {
            *out = if face == NONE { background } else { z };
        }
        // Depth is an attribute that happens to be the third coordinate: its own gradient joins that of positions.
        tape.record_fn("depth", &[self.projected], out, move |cx: &mut Backward<'_, F>| {
            let (projected, output, grad) = (cx.input(0), cx.output(), cx.grad_out());
            let [projected, output, grad] = [&projected, &output, &grad].map(Tensor::as_slice);
            let mut depths = cx.scratch(projected.len() / 3);
            depths.iter_mut().zip(projected.as_chunks().0).for_each(|(z, &[_, _, p])| *z = p);
            let attributes = Attributes { data: &depths, channels: 1, layout: Layout::Batched };
            let incoming = Incoming { fragments: &fragments, projected, attributes, output, grad };
            let faces = fragments.faces();
            let corners = 3 * faces.len();
            let mut of_depths = cx.scratch(fragments.shape()[0] * corners);
            let mut of_positions = cx.scratch(3 * of_depths.len());
            interpolate_grad(incoming, &scratch, &mut of_depths, Some(&mut of_positions));
            for (position, &own) in of_positions.chunks_exact_mut(3).zip(&*of_depths) {
                position[2] += own;
            }
            if corners == 0 {
                return;
            }
            let out = cx.grad_slice_mut(0).chunks_exact_mut(3 * faces.vertex_count());
            for (out, image) in out.zip(of_positions.chunks_exact(3 * corners)) {
                gather(faces, 3, out, |corner| Some(&image[3 * corner as usize..][..3]));
            }
        })
    }
}
