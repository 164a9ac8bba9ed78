//! What a triangle is like, and becomes.

use super::surface::{Surface, next, previous};
use crate::vector::{Vec3, angle, area_vector, dot, norm, sub};

/// The smallest angle of a triangle in radians; 0 for one without area.
pub(super) fn smallest_angle([a, b, c]: [Vec3; 3]) -> f64 {
    let (u, v, w) = (sub(b, a), sub(c, b), sub(a, c));
    let turned = |p: Vec3| p.map(|x| -x);
    angle(u, turned(w)).min(angle(v, turned(u))).min(angle(w, turned(v)))
}

/// Whether the faces around `vertex`, less those that also have `other`, still look to the same side
/// (by the cosine `facing` at least) with it at `at`, and become no slivers: their angles stay above
/// `smallest` radians, or what they were.
pub(super) fn keeps_shape(
    surface: &Surface,
    positions: &[Vec3],
    [vertex, other]: [u32; 2],
    at: Vec3,
    [facing, smallest]: [f64; 2],
) -> bool {
    surface.fan(vertex).all(|corner| {
        let ends = [next(corner), previous(corner)].map(|corner| surface.vertex(corner));
        if ends.contains(&other) {
            return true;
        }
        let [b, c] = ends.map(|v| positions[v as usize]);
        let (old, new) = ([positions[vertex as usize], b, c], [at, b, c]);
        let (before, after) = (area_vector(old), area_vector(new));
        dot(before, after) > facing * norm(before) * norm(after)
            && smallest_angle(new) >= smallest_angle(old).min(smallest)
    })
}
