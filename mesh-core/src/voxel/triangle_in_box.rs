//! Whether a triangle meets a cell.

use crate::vector::{Vec3, area_vector, cross, dot, sub};

/// The separating-axis test between a triangle and cubes of side 1.
pub(super) struct TriangleInBox {
    corners: [Vec3; 3],
    normal: Vec3,
    /// Products of the triangle's sides and the cube's.
    axes: [Vec3; 9],
}

impl TriangleInBox {
    pub(super) fn new(corners: [Vec3; 3]) -> Self {
        let [a, b, c] = corners;
        let sides = [sub(b, a), sub(c, b), sub(a, c)];
        let axes = std::array::from_fn(|i| {
            let mut unit = [0.0; 3];
            unit[i % 3] = 1.0;
            cross(unit, sides[i / 3])
        });
        Self { corners, normal: area_vector(corners), axes }
    }

    /// Whether the triangle meets the closed cube around `center`.
    pub(super) fn touches(&self, center: Vec3) -> bool {
        let corners = self.corners.map(|p| sub(p, center));
        let apart = |axis: Vec3| {
            let radius = 0.5 * (axis[0].abs() + axis[1].abs() + axis[2].abs());
            let on = corners.map(|p| dot(axis, p));
            let low = on.into_iter().fold(f64::INFINITY, f64::min);
            let high = on.into_iter().fold(f64::NEG_INFINITY, f64::max);
            // A little slack against rounding: rather a cell too many than one too few.
            let slack = 1e-9 * radius;
            low > radius + slack || high < -radius - slack
        };
        let cube = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        !cube.into_iter().chain(self.axes).chain([self.normal]).any(apart)
    }
}
