//! From gradients of face corners to gradients of vertices: each vertex sums its own corners.

use autodiff_lite::Real;
use autodiff_lite::kernels::parallel::{InParts, Parts};

use crate::Faces;

/// Vertices per parallel task.
const CHUNK: usize = 512;

/// Adds to each vertex `[V, C]` the gradients of the face corners that touch it, in their order.
///
/// `of_corner` gives the `C` numbers of corner `3 face + k`, or none where they are zero.
pub fn gather<'a, F: Real>(
    faces: &Faces,
    channels: usize,
    out: &mut [F],
    of_corner: impl Fn(u32) -> Option<&'a [F]> + Sync,
) {
    if channels == 0 {
        return;
    }
    out.par_chunks_mut(channels * CHUNK).enumerate().for_each(|(chunk, out)| {
        for (vertex, out) in out.chunks_exact_mut(channels).enumerate() {
            for &corner in faces.corners_of(CHUNK * chunk + vertex) {
                if let Some(gradient) = of_corner(corner) {
                    out.iter_mut().zip(gradient).for_each(|(out, &g)| *out += g);
                }
            }
        }
    });
}
