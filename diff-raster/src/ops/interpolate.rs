//! Attributes at pixels. The rule stands in [`kernels::interpolate`](crate::kernels::interpolate).

use std::sync::Arc;

use autodiff_lite::{Backward, Real, Var};

use crate::kernels::gather::gather;
use crate::kernels::interpolate::{Attributes, Incoming, Layout};
use crate::kernels::interpolate::{interpolate as forward, interpolate_grad};
use crate::{Fragments, Frame, Scratch};

/// Attributes of the vertices at each pixel: zero at background.
///
/// # Shapes
/// `projected [N, V, 3]`, the positions that were rasterised; `attributes [V, C]` or `[N, V, C]`,
/// any `C`. Result `[N, H, W, C]`.
/// # Gradient
/// To attributes, and to positions with visibility held fixed. With
/// [`Settings::perspective`](crate::Settings::perspective) the gradient of positions includes that
/// of depth; without, depth has none, as in DIB-R. Numbers follow `fragments`, not `projected`.
/// # Cost
/// `O(N H W C)`; the gradient goes over the boxes of all faces. One scratch buffer `[N, F, 3, C]`.
/// # Panics
/// If the shapes do not fit what was rasterised.
/// # References
/// Chen et al. 2019, *Learning to Predict 3D Objects with an Interpolation-based Differentiable
/// Renderer*, equations 1 to 4.
#[track_caller]
#[inline(never)]
pub fn interpolate<'t, F: Real>(
    projected: Var<'t, F>,
    attributes: Var<'t, F>,
    fragments: &Arc<Fragments<F>>,
) -> Var<'t, F> {
    Frame::new(projected, Arc::clone(fragments), Scratch::default()).interpolate(attributes)
}

/// [`interpolate`] with attributes of their own for each face corner: texture coordinates across a seam, or one
/// colour per face.
///
/// # Shapes
/// `projected [N, V, 3]`, the positions that were rasterised; `attributes [F, 3, C]`, any `C`,
/// one table for all images → `[N, H, W, C]`.
/// # Panics
/// If the shapes do not fit what was rasterised.
#[track_caller]
#[inline(never)]
pub fn interpolate_corners<'t, F: Real>(
    projected: Var<'t, F>,
    attributes: Var<'t, F>,
    fragments: &Arc<Fragments<F>>,
) -> Var<'t, F> {
    let frame = Frame::new(projected, Arc::clone(fragments), Scratch::default());
    frame.interpolate_corners(attributes)
}

impl<'t, F: Real> Frame<'t, F> {
    /// Attributes of the vertices at each pixel, zero at background; see
    /// [`interpolate`].
    ///
    /// # Shapes
    /// `attributes [V, C]` or `[N, V, C]`. Result `[N, H, W, C]`.
    /// # Panics
    /// If the attributes do not fit the vertices.
    #[track_caller]
    #[inline(never)]
    pub fn interpolate(&self, attributes: Var<'t, F>) -> Var<'t, F> {
        let shape = attributes.shape();
        let [batch, ..] = self.fragments.shape();
        let vertices = self.fragments.faces().vertex_count();
        let layout = match *shape {
            [v, _] if v == vertices => Layout::Shared,
            [n, v, _] if n == batch && v == vertices => Layout::Batched,
            _ => {
                let operands = [
                    ("attributes", &shape[..], "[V, C] or [N, V, C]"),
                    ("projected", &[batch, vertices, 3], "N, V, 3"),
                ];
                let message = "attributes do not fit the vertices";
                self.projected.tape().refuse("interpolate", message, &operands)
            }
        };
        self.interpolated(attributes, layout)
    }

    /// Attributes of the corners of faces at each pixel, zero at background; see
    /// [`interpolate_corners`].
    ///
    /// # Shapes
    /// `attributes [F, 3, C]`. Result `[N, H, W, C]`.
    /// # Panics
    /// If the attributes do not fit the faces.
    #[track_caller]
    #[inline(never)]
    pub fn interpolate_corners(&self, attributes: Var<'t, F>) -> Var<'t, F> {
        let shape = attributes.shape();
        let faces = self.fragments.faces().len();
        if !matches!(*shape, [f, 3, _] if f == faces) {
            let operands = [("attributes", &shape[..], "F, 3, C"), ("faces", &[faces, 3], "F, 3")];
            let message = "attributes do not fit the faces";
            self.projected.tape().refuse("interpolate_corners", message, &operands);
        }
        self.interpolated(attributes, Layout::Corners)
    }

    #[track_caller]
    fn interpolated(&self, attributes: Var<'t, F>, layout: Layout) -> Var<'t, F> {
        self.check("interpolate");
        let Self { projected, fragments, scratch } = self.clone();
        let values = attributes.value();
        let channels = values.shape()[values.ndim() - 1];
        let [n, h, w] = fragments.shape();
        let mut out = projected.tape().array(&[n, h, w, channels]);
        let source = Attributes { data: values.as_slice(), channels, layout };
        forward(&fragments, source, out.as_slice_mut());
        let (tape, inputs) = (projected.tape(), [projected, attributes]);
        tape.record_fn("interpolate", &inputs, out, move |cx: &mut Backward<'_, F>| {
            let (projected, values) = (cx.input(0), cx.input(1));
            let (output, grad) = (cx.output(), cx.grad_out());
            let corners = n * fragments.faces().len() * 3;
            let incoming = Incoming {
                fragments: &fragments,
                projected: projected.as_slice(),
                attributes: Attributes { data: values.as_slice(), channels, layout },
                output: output.as_slice(),
                grad: grad.as_slice(),
            };
            let mut of_attributes = cx.scratch(corners * channels);
            let mut of_positions = cx.needs(0).then(|| cx.scratch(corners * 3));
            interpolate_grad(incoming, &scratch, &mut of_attributes, of_positions.as_deref_mut());
            if let Some(of_positions) = of_positions {
                gather_batch(&fragments, 3, &of_positions, cx.grad_slice_mut(0), false);
            }
            if !cx.needs(1) {
                return;
            }
            let out = cx.grad_slice_mut(1);
            match layout {
                Layout::Shared => gather_batch(&fragments, channels, &of_attributes, out, true),
                Layout::Batched => gather_batch(&fragments, channels, &of_attributes, out, false),
                Layout::Corners => {
                    for image in of_attributes.chunks_exact(out.len().max(1)) {
                        out.iter_mut().zip(image).for_each(|(out, &g)| *out += g);
                    }
                }
            }
        })
    }
}

/// Gathers corner gradients `[N, F, 3, C]` into `[N, V, C]`, or into `[V, C]` if shared.
fn gather_batch<F: Real>(
    fragments: &Fragments<F>,
    channels: usize,
    corners: &[F],
    out: &mut [F],
    shared: bool,
) {
    let faces = fragments.faces();
    let (per_image, vertices) = (3 * faces.len() * channels, faces.vertex_count() * channels);
    if per_image == 0 {
        return;
    }
    for (image, corners) in corners.chunks_exact(per_image).enumerate() {
        let out = if shared { &mut *out } else { &mut out[image * vertices..][..vertices] };
        gather(faces, channels, out, |corner| {
            Some(&corners[corner as usize * channels..][..channels])
        });
    }
}
