//! Nearest neighbours for either precision.

use autodiff_lite::Real;
use mesh_core::kernels::nearest::{Nearest, NearestScratch, nearest_into};

use super::vec3::{dot, points, sub};

/// Memory that [`nearest_indices`] works in, kept between calls.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    lanes: NearestScratch,
    found: Vec<Nearest>,
}

/// Appends the index of the nearest of `targets` to `indices` for every query; both are `[.., 3]` slices.
///
/// The lowest index wins ties. `f32` runs on the vector kernel of mesh-core, `f64` (for gradient checks) in
/// a plain loop. Nothing is appended when there are no targets.
pub fn nearest_indices<F: Real>(
    queries: &[F],
    targets: &[F],
    scratch: &mut Scratch,
    indices: &mut Vec<u32>,
) {
    if targets.is_empty() {
        return;
    }
    if let (Some(queries), Some(targets)) = (F::as_f32(queries), F::as_f32(targets)) {
        nearest_into(points(queries), points(targets), &mut scratch.lanes, &mut scratch.found);
        indices.extend(scratch.found.iter().map(|n| n.index));
    } else {
        indices.extend(points(queries).iter().map(|&q| nearest_plain(q, points(targets))));
    }
}

fn nearest_plain<F: Real>(query: [F; 3], targets: &[[F; 3]]) -> u32 {
    let mut best = (0, F::infinity());
    for (i, &p) in targets.iter().enumerate() {
        let d = sub(query, p);
        let squared = dot(d, d);
        if squared < best.1 {
            best = (i, squared);
        }
    }
    best.0 as u32
}
