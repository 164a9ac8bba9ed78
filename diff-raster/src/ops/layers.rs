//! What layers of faces show, with gradients.

use std::sync::Arc;

use autodiff_lite::{Backward, Real, Tensor, Var};

use crate::kernels::layers::{Pull, measure, parts, pull, scatter};
use crate::kernels::setup::corner_positions;
use crate::{LayeredFragments, Layers, NONE};

impl<'t, F: Real> Layers<'t, F> {
    /// Planar depths, -1 where there is no face: PyTorch3D's `zbuf`.
    ///
    /// # Shapes
    /// Result `[N, H, W, K]`.
    /// # Gradient
    /// To screen positions and depths.
    /// # Cost
    /// `O(N H W K)`; backward measures each face at its pixels again.
    #[inline(never)]
    pub fn depth(&self) -> Var<'t, F> {
        let values = &self.fragments.depth;
        self.values("layer_depth", values, &[], |g| Pull { depth: g[0], ..Pull::default() })
    }

    /// **Squared** distances from the borders of the faces in NDC, negative inside, -1 where there is no face: PyTorch3D's
    /// `dists`.
    ///
    /// # Shapes
    /// Result `[N, H, W, K]`.
    /// # Gradient
    /// To screen positions; kinks where another edge is nearer.
    /// # Cost
    /// As [`depth`](Self::depth).
    #[inline(never)]
    pub fn distance(&self) -> Var<'t, F> {
        let values = &self.fragments.distance;
        self.values("layer_distance", values, &[], |g| Pull { signed: g[0], ..Pull::default() })
    }

    /// Barycentric coordinates, -1 where there is no face: PyTorch3D's `bary_coords`.
    ///
    /// # Shapes
    /// Result `[N, H, W, K, 3]`.
    /// # Gradient
    /// To screen positions, and to depths with perspective.
    /// # Cost
    /// As [`depth`](Self::depth).
    #[inline(never)]
    pub fn barycentric(&self) -> Var<'t, F> {
        let values = &self.fragments.barycentric;
        self.values("layer_barycentric", values, &[3], |g| Pull {
            shown: [g[0], g[1], g[2]],
            ..Pull::default()
        })
    }

    /// Attributes of vertices at the faces of each pixel, 0 where there is none: PyTorch3D's
    /// `interpolate_face_attributes`, of vertices.
    ///
    /// # Shapes
    /// `attributes [V, C]`, shared by all images, or `[N, V, C]` → `[N, H, W, K, C]`.
    /// # Gradient
    /// To attributes and positions.
    /// # Cost
    /// `O(N H W K C)`.
    /// # Panics
    /// If the shape does not fit the faces.
    #[track_caller]
    #[inline(never)]
    pub fn interpolate(&self, attributes: Var<'t, F>) -> Var<'t, F> {
        let (fragments, name) = (Arc::clone(&self.fragments), "layer_interpolate");
        let (tape, shape) = (attributes.tape(), attributes.shape());
        let (batch, vertices) = (fragments.shape()[0], fragments.faces.vertex_count());
        let (shared, channels) = match shape[..] {
            [v, c] if v == vertices => (true, c),
            [n, v, c] if (n, v) == (batch, vertices) => (false, c),
            _ => {
                let message =
                    format!("attributes of {vertices} vertices in {batch} images expected");
                tape.refuse(name, message, &[("attributes", &shape, "N, V, C")])
            }
        };
        let weights = self.barycentric();
        let mut out = tape.array(&extended(&fragments, &[channels]));
        let places = Places { fragments, shared, channels };
        let (w, a) = (weights.value(), attributes.value());
        let (w, a) = (w.as_slice(), a.as_slice());
        out.as_slice_mut().fill(F::zero());
        let numbers = out.as_slice_mut();
        places.each(|slot, corners| {
            for (k, from) in corners.into_iter().enumerate() {
                let weight = w[3 * slot + k];
                for c in 0..channels {
                    numbers[slot * channels + c] += weight * a[from + c];
                }
            }
        });
        tape.record_fn(name, &[weights, attributes], out, move |cx: &mut Backward<'_, F>| {
            let (w, a, g) = (cx.input(0), cx.input(1), cx.grad_out());
            let [w, a, g] = [&w, &a, &g].map(Tensor::as_slice);
            if cx.needs(0) {
                let out = cx.grad_slice_mut(0);
                places.each(|slot, corners| {
                    for (k, from) in corners.into_iter().enumerate() {
                        let pairs = a[from..from + channels].iter().zip(&g[slot * channels..]);
                        out[3 * slot + k] += pairs.map(|(&a, &g)| a * g).sum::<F>();
                    }
                });
            }
            if cx.needs(1) {
                let out = cx.grad_slice_mut(1);
                places.each(|slot, corners| {
                    for (k, to) in corners.into_iter().enumerate() {
                        let weight = w[3 * slot + k];
                        for c in 0..channels {
                            out[to + c] += weight * g[slot * channels + c];
                        }
                    }
                });
            }
        })
    }

    /// Plain values with the gradient that `pull_of` makes of theirs.
    fn values(
        &self,
        name: &'static str,
        values: &[F],
        axes: &[usize],
        pull_of: impl Fn(&[F]) -> Pull<F> + Send + Sync + 'static,
    ) -> Var<'t, F> {
        let (tape, fragments) = (self.projected.tape(), Arc::clone(&self.fragments));
        let mut out = tape.array(&extended(&fragments, axes));
        out.as_slice_mut().copy_from_slice(values);
        let width: usize = axes.iter().product();
        tape.record_fn(name, &[self.projected], out, move |cx: &mut Backward<'_, F>| {
            let (projected, grad) = (cx.input(0), cx.grad_out());
            let (projected, grad) = (projected.as_slice(), grad.as_slice());
            let stride = 3 * fragments.faces.vertex_count();
            let [batch, height, columns, k] = fragments.shape();
            let slots = height * columns * k;
            let mut working = cx.scratch(parts(stride));
            let out = cx.grad_slice_mut(0);
            for n in (0..batch).filter(|_| stride > 0) {
                let own = &projected[stride * n..stride * (n + 1)];
                let of = |slot: usize, corners: [u32; 3]| {
                    let slot = n * slots + slot;
                    let (p, corners) = (fragments.center(slot / k), corner_positions(own, corners));
                    let layer = measure(p, &corners, &fragments.settings);
                    let pulled = pull_of(&grad[slot * width..(slot + 1) * width]);
                    pull(&layer, p, &corners, &fragments.settings, pulled)
                };
                let (corners, face) = (fragments.faces.corners(), &fragments.face);
                let out = &mut out[stride * n..stride * (n + 1)];
                scatter(corners, &face[n * slots..(n + 1) * slots], of, &mut working, out);
            }
        })
    }
}

fn extended<F: Real>(fragments: &LayeredFragments<F>, axes: &[usize]) -> Vec<usize> {
    fragments.shape().into_iter().chain(axes.iter().copied()).collect()
}

/// Where the attributes of the faces of each pixel stand.
struct Places<F: Real> {
    fragments: Arc<LayeredFragments<F>>,
    shared: bool,
    channels: usize,
}

impl<F: Real> Places<F> {
    /// Calls `f(slot, offsets of the corners' attributes)` wherever there is a face.
    fn each(&self, mut f: impl FnMut(usize, [usize; 3])) {
        let [_, height, width, k] = self.fragments.shape();
        let (slots, faces) = (height * width * k, &self.fragments.faces);
        for (slot, &face) in self.fragments.face.iter().enumerate() {
            if face != NONE {
                let image = if self.shared { 0 } else { slot / slots * faces.vertex_count() };
                let corners = faces.corners()[face as usize];
                f(slot, corners.map(|v| (image + v as usize) * self.channels));
            }
        }
    }
}
