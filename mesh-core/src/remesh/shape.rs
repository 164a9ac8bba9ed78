//! What a triangle is like.

use crate::vector::{Vec3, angle, sub};

/// What decides how good a triangle is.
pub(super) struct Shape {
    /// Its smallest angle in radians; 0 for a triangle without area.
    pub(super) smallest: f64,
}

impl Shape {
    pub(super) fn of([a, b, c]: [Vec3; 3]) -> Self {
        let (u, v, w) = (sub(b, a), sub(c, b), sub(a, c));
        let turned = |p: Vec3| p.map(|x| -x);
        let smallest = angle(u, turned(w)).min(angle(v, turned(u))).min(angle(w, turned(v)));
        Self { smallest }
    }
}
