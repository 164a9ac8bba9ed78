//! Attributes at pixels. The rule stands in [`kernels::interpolate`](crate::kernels::interpolate).

use std::sync::Arc;

use autodiff_lite::{Backward, Op, Real, ShapeError, Var};

use crate::kernels::gather::gather;
use crate::kernels::interpolate::{Attributes, Incoming, Layout};
use crate::kernels::interpolate::{interpolate as forward, interpolate_grad};
use crate::ops::check_projected;
use crate::{Fragments, Scratch};

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
pub fn interpolate<'t, F: Real>(
    projected: Var<'t, F>,
    attributes: Var<'t, F>,
    fragments: &Arc<Fragments<F>>,
) -> Var<'t, F> {
    interpolate_vertices(projected, attributes, fragments, &Scratch::default())
}

#[track_caller]
pub(crate) fn interpolate_vertices<'t, F: Real>(
    projected: Var<'t, F>,
    attributes: Var<'t, F>,
    fragments: &Arc<Fragments<F>>,
    scratch: &Scratch<F>,
) -> Var<'t, F> {
    let shape = attributes.shape();
    let [batch, ..] = fragments.shape();
    let vertices = fragments.faces().vertex_count();
    let layout = match *shape {
        [v, _] if v == vertices => Layout::Shared,
        [n, v, _] if n == batch && v == vertices => Layout::Batched,
        _ => ShapeError::new("interpolate", "attributes do not fit the vertices")
            .operand("attributes", &shape, "[V, C] or [N, V, C]")
            .operand("projected", &[batch, vertices, 3], "N, V, 3")
            .at(projected.tape().path())
            .panic(),
    };
    record(projected, attributes, layout, fragments, scratch)
}

/// [`interpolate`] with attributes of their own for each face corner, `[F, 3, C]`: texture
/// coordinates across a seam, or one colour per face.
///
/// # Panics
/// If the shapes do not fit what was rasterised.
#[track_caller]
pub fn interpolate_corners<'t, F: Real>(
    projected: Var<'t, F>,
    attributes: Var<'t, F>,
    fragments: &Arc<Fragments<F>>,
) -> Var<'t, F> {
    interpolate_faces(projected, attributes, fragments, &Scratch::default())
}

#[track_caller]
pub(crate) fn interpolate_faces<'t, F: Real>(
    projected: Var<'t, F>,
    attributes: Var<'t, F>,
    fragments: &Arc<Fragments<F>>,
    scratch: &Scratch<F>,
) -> Var<'t, F> {
    let shape = attributes.shape();
    let faces = fragments.faces().len();
    if !matches!(*shape, [f, 3, _] if f == faces) {
        ShapeError::new("interpolate_corners", "attributes do not fit the faces")
            .operand("attributes", &shape, "F, 3, C")
            .operand("faces", &[faces, 3], "F, 3")
            .at(projected.tape().path())
            .panic();
    }
    record(projected, attributes, Layout::Corners, fragments, scratch)
}

#[track_caller]
fn record<'t, F: Real>(
    projected: Var<'t, F>,
    attributes: Var<'t, F>,
    layout: Layout,
    fragments: &Arc<Fragments<F>>,
    scratch: &Scratch<F>,
) -> Var<'t, F> {
    check_projected("interpolate", projected, fragments);
    let values = attributes.value();
    let channels = values.shape()[values.ndim() - 1];
    let [n, h, w] = fragments.shape();
    let mut out = projected.tape().array(&[n, h, w, channels]);
    let data = values.as_slice();
    let source = Attributes { data, channels, layout };
    forward(fragments, source, out.as_slice_mut());
    let (fragments, scratch) = (Arc::clone(fragments), scratch.clone());
    let op = Interpolate { fragments, scratch, channels, layout };
    projected.tape().record(&[projected, attributes], out, op)
}

struct Interpolate<F: Real> {
    fragments: Arc<Fragments<F>>,
    scratch: Scratch<F>,
    channels: usize,
    layout: Layout,
}

impl<F: Real> Op<F> for Interpolate<F> {
    fn name(&self) -> &'static str {
        "interpolate"
    }

    fn pullback(&self, cx: &mut Backward<'_, F>) {
        let Self { fragments, scratch, channels, layout } = self;
        let (projected, values) = (cx.input(0), cx.input(1));
        let (output, grad) = (cx.output(), cx.grad_out());
        let faces = fragments.faces();
        let [batch, ..] = fragments.shape();
        let incoming = Incoming {
            fragments,
            projected: projected.as_slice(),
            attributes: Attributes {
                data: values.as_slice(),
                channels: *channels,
                layout: *layout,
            },
            output: output.as_slice(),
            grad: grad.as_slice(),
        };
        let mut of_attributes = cx.scratch(batch * faces.len() * 3 * channels);
        let mut of_positions = cx.needs(0).then(|| cx.scratch(batch * faces.len() * 9));
        interpolate_grad(incoming, scratch, &mut of_attributes, of_positions.as_deref_mut());
        if let Some(of_positions) = of_positions {
            gather_batch(fragments, 3, &of_positions, cx.grad_slice_mut(0), false);
        }
        if !cx.needs(1) {
            return;
        }
        let out = cx.grad_slice_mut(1);
        match layout {
            Layout::Shared => gather_batch(fragments, *channels, &of_attributes, out, true),
            Layout::Batched => gather_batch(fragments, *channels, &of_attributes, out, false),
            Layout::Corners => {
                for image in of_attributes.chunks_exact(out.len().max(1)) {
                    out.iter_mut().zip(image).for_each(|(out, &g)| *out += g);
                }
            }
        }
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
