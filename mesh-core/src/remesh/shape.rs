//! What a triangle is like.

use crate::vector::{Vec3, angle, sub};

/// The smallest angle of a triangle in radians; 0 for one without area.
pub(super) fn smallest_angle([a, b, c]: [Vec3; 3]) -> f64 {
    let (u, v, w) = (sub(b, a), sub(c, b), sub(a, c));
    let turned = |p: Vec3| p.map(|x| -x);
    angle(u, turned(w)).min(angle(v, turned(u))).min(angle(w, turned(v)))
}
