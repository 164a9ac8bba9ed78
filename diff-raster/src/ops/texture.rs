//! UV textures. The rule stands in [`kernels::texture`](crate::kernels::texture).

use std::sync::Arc;

use autodiff_lite::{Backward, Real, Tensor, Var};

use crate::kernels::texture::{Texture, texture as forward, texture_grad_texels, texture_grad_uv};
use crate::{Fragments, Frame, Scratch};

/// Colours of a texture at each pixel, bilinear; zero at background.
///
/// # Shapes
/// `uv [N, H, W, 2]`, interpolated texture coordinates, `v` up, clamped to `[0, 1]`;
/// `image [Ht, Wt, C]`, the same for all images of the batch. Result `[N, H, W, C]`.
/// # Gradient
/// To coordinates (with kinks between texels) and texels.
/// # Cost
/// `O(N H W C)`; the gradient of texels sorts the pixels by row of texels.
/// # Panics
/// If `uv` does not have the size of what was rasterised.
#[track_caller]
#[inline(never)]
pub fn texture<'t, F: Real>(
    uv: Var<'t, F>,
    image: Var<'t, F>,
    fragments: &Arc<Fragments<F>>,
) -> Var<'t, F> {
    lookup(uv, image, fragments, &Scratch::default())
}

impl<'t, F: Real> Frame<'t, F> {
    /// Colours of a texture, zero at background; see [`texture`].
    ///
    /// # Shapes
    /// `uv [N, H, W, 2]`, [interpolated](Self::interpolate_corners); `image [Ht, Wt, C]`. Result
    /// `[N, H, W, C]`.
    /// # Panics
    /// If `uv` does not have the size of this frame.
    #[track_caller]
    #[inline(never)]
    pub fn texture(&self, uv: Var<'t, F>, image: Var<'t, F>) -> Var<'t, F> {
        lookup(uv, image, &self.fragments, &self.scratch)
    }
}

#[track_caller]
fn lookup<'t, F: Real>(
    uv: Var<'t, F>,
    image: Var<'t, F>,
    fragments: &Arc<Fragments<F>>,
    scratch: &Scratch<F>,
) -> Var<'t, F> {
    let [n, h, w] = fragments.shape();
    let (coordinates, texels) = (uv.value(), image.value());
    if coordinates.shape() != [n, h, w, 2] || texels.ndim() != 3 {
        let operands = [
            ("uv", coordinates.shape(), "N, H, W, 2"),
            ("image", texels.shape(), "Ht, Wt, C"),
            ("rasterised", &[n, h, w], "N, H, W"),
        ];
        let message = "texture coordinates for each pixel and an image expected";
        uv.tape().refuse("texture", message, &operands);
    }
    let source = texture_of(texels.shape(), texels.as_slice());
    let mut out = uv.tape().array(&[n, h, w, source.channels]);
    forward(source, coordinates.as_slice(), &fragments.face, out.as_slice_mut());
    let (fragments, scratch) = (Arc::clone(fragments), scratch.clone());
    uv.tape().record_fn("texture", &[uv, image], out, move |cx: &mut Backward<'_, F>| {
        let (coordinates, texels, grad) = (cx.input(0), cx.input(1), cx.grad_out());
        let source = texture_of(texels.shape(), texels.as_slice());
        let [uv, grad] = [&coordinates, &grad].map(Tensor::as_slice);
        let face = &fragments.face;
        if cx.needs(0) {
            texture_grad_uv(source, uv, face, grad, cx.grad_slice_mut(0));
        }
        if cx.needs(1) {
            scratch.sorted.with(|sorted| {
                texture_grad_texels(source, uv, face, grad, sorted, cx.grad_slice_mut(1));
            });
        }
    })
}

fn texture_of<'a, F: Real>(shape: &[usize], data: &'a [F]) -> Texture<'a, F> {
    Texture { data, height: shape[0], width: shape[1], channels: shape[2] }
}
