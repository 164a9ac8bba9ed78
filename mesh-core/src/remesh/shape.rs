//! What a triangle is like, and becomes.

use super::surface::{Surface, next, previous};
use crate::vector::{Vec3, add, angle, area_vector, cross, dot, norm, sub};

/// The smallest angle of a triangle in radians; 0 for one without area.
pub(super) fn smallest_angle(triangle: [Vec3; 3]) -> f64 {
    let [p, q] = around_smallest(triangle);
    angle(p, q)
}

/// The two sides at the smallest angle, away from it.
fn around_smallest([a, b, c]: [Vec3; 3]) -> [Vec3; 2] {
    let sides = [sub(b, a), sub(c, b), sub(a, c)];
    let squares = sides.map(|side| dot(side, side));
    // It is opposite the shortest side.
    let shortest = (1..3).fold(0, |k, j| if squares[j] < squares[k] { j } else { k });
    [sides[(shortest + 1) % 3], sides[(shortest + 2) % 3].map(|x| -x)]
}

/// Whether no angle of a triangle is smaller than the one, below a right one, that has this tangent.
fn is_wide(triangle: [Vec3; 3], tangent: f64) -> bool {
    let [p, q] = around_smallest(triangle);
    // 0 or less where two corners are one.
    let cosine = dot(p, q);
    cosine > 0.0 && norm(cross(p, q)) >= tangent * cosine
}

/// The height of a triangle, in lengths of its longest side, below which it looks to no side: where it does is
/// rounding.
const FLAT: f64 = 1e-5;

/// Whether a triangle is a line or a point, as far as can be told.
fn is_flat([a, b, c]: [Vec3; 3]) -> bool {
    let square = |v: Vec3| dot(v, v);
    let longest = square(sub(b, a)).max(square(sub(c, b))).max(square(sub(a, c)));
    norm(area_vector([a, b, c])) <= FLAT * longest
}

/// What a face must still be when a vertex of it moves.
#[derive(Clone, Copy)]
pub(super) struct Bounds {
    /// Cosine of the most that it may turn.
    pub(super) facing: f64,
    /// Tangent of the smallest angle that it may get.
    pub(super) smallest: f64,
    /// Where its smallest angle is less already, the share of it that must stay.
    pub(super) share: f64,
}

/// Whether the faces around `vertex`, less those that also have `other`, still look to the same side with it at
/// `at`, and become no slivers. Of a face without area the side is that of all faces around the vertex.
pub(super) fn keeps_shape(
    surface: &Surface,
    positions: &[Vec3],
    [vertex, other]: [u32; 2],
    at: Vec3,
    bounds: Bounds,
) -> bool {
    let place = |v: u32| positions[v as usize];
    let side = || {
        surface.fan(vertex).fold([0.0; 3], |sum, corner| {
            let corners = [corner, next(corner), previous(corner)];
            add(sum, area_vector(corners.map(|corner| place(surface.vertex(corner)))))
        })
    };
    surface.fan(vertex).all(|corner| {
        let ends = [next(corner), previous(corner)].map(|corner| surface.vertex(corner));
        if ends.contains(&other) {
            return true;
        }
        let [b, c] = ends.map(place);
        let (old, new) = ([place(vertex), b, c], [at, b, c]);
        let (before, after) = (area_vector(old), area_vector(new));
        let looks_same = if is_flat(old) {
            is_flat(new) || dot(side(), after) >= 0.0
        } else {
            dot(before, after) > bounds.facing * norm(before) * norm(after)
        };
        let keeps_angle = || {
            is_wide(new, bounds.smallest)
                || smallest_angle(new) >= bounds.share * smallest_angle(old)
        };
        looks_same && keeps_angle()
    })
}
