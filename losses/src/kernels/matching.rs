//! Nearest neighbours for either precision.

use autodiff_lite::Real;
use mesh_core::kernels::nearest::{Nearest, NearestScratch, nearest_both_into};

use super::vec3::{dot, points, sub};

/// Memory that [`nearest_indices`] works in, kept between calls.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    lanes: NearestScratch,
    found: [Vec<Nearest>; 2],
}

/// Appends to `indices`, for every point of each of two sets, the index of the nearest of the other set; both are `[.., 3]` slices.
///
/// The lowest index wins ties. `f32` runs on the vector kernels of mesh-core, `f64` (for gradient checks) in
/// a plain loop. Nothing is appended where a set is empty.
pub fn nearest_indices<F: Real>(
    [x, y]: [&[F]; 2],
    scratch: &mut Scratch,
    indices: [&mut Vec<u32>; 2],
) {
    if x.is_empty() || y.is_empty() {
        return;
    }
    let [x_to_y, y_to_x] = indices;
    if let (Some(x), Some(y)) = (F::as_f32(x), F::as_f32(y)) {
        let [xs, ys] = &mut scratch.found;
        nearest_both_into(points(x), points(y), &mut scratch.lanes, xs, ys);
        x_to_y.extend(xs.iter().map(|n| n.index));
        y_to_x.extend(ys.iter().map(|n| n.index));
    } else {
        let (x, y) = (points(x), points(y));
        x_to_y.extend(x.iter().map(|&p| nearest_plain(p, y)));
        y_to_x.extend(y.iter().map(|&p| nearest_plain(p, x)));
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
