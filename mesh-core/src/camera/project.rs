//! From the world to pixels and back.

use nalgebra::{SimilarityMatrix3, Vector3};

use super::ray::Ray;
use super::{Camera, Lens};

/// Where a world point lands.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Projected {
    /// Pixels from the left edge of the image; pixel `j` has its centre at `j + 0.5`.
    pub column: f64,
    /// Pixels from the top edge of the image; pixel `i` has its centre at `i + 0.5`.
    pub row: f64,
    /// Planar depth, above zero in front of the camera.
    pub depth: f64,
}

impl Camera {
    /// Whether the lens is a pinhole.
    pub fn is_perspective(&self) -> bool {
        matches!(self.lens, Lens::Perspective { .. })
    }

    /// The camera's position in the world.
    pub fn center(&self) -> Vector3<f64> {
        -(self.rotation.transpose() * self.translation)
    }

    /// The unit direction along which the camera looks, in the world.
    pub fn forward(&self) -> Vector3<f64> {
        -self.rotation.row(2).transpose()
    }

    /// Projects a world point; where `depth` is not above zero, the pixel has no meaning.
    pub fn project(&self, point: [f64; 3]) -> Projected {
        let p = self.rotation * Vector3::from(point) + self.translation;
        let depth = -p.z;
        match self.lens {
            Lens::Perspective { fx, fy, cx, cy } => {
                Projected { column: cx + fx * p.x / depth, row: cy - fy * p.y / depth, depth }
            }
            Lens::Orthographic { sx, sy, cx, cy } => {
                Projected { column: cx + sx * p.x, row: cy - sy * p.y, depth }
            }
        }
    }

    /// The world point at a pixel position and planar depth: the inverse of [`Camera::project`].
    pub fn unproject(&self, column: f64, row: f64, depth: f64) -> [f64; 3] {
        let p = match self.lens {
            Lens::Perspective { fx, fy, cx, cy } => {
                Vector3::new((column - cx) / fx * depth, (cy - row) / fy * depth, -depth)
            }
            Lens::Orthographic { sx, sy, cx, cy } => {
                Vector3::new((column - cx) / sx, (cy - row) / sy, -depth)
            }
        };
        (self.rotation.transpose() * (p - self.translation)).into()
    }

    /// The ray that ends in a pixel position; orthographic rays start in the plane of depth zero.
    pub fn ray(&self, column: f64, row: f64) -> Ray {
        let near = Vector3::from(self.unproject(column, row, 0.0));
        let far = Vector3::from(self.unproject(column, row, 1.0));
        Ray { origin: near.into(), direction: (far - near).normalize().into() }
    }

    /// The same camera for the whole image resampled to another size.
    #[must_use]
    pub fn resized(&self, width: usize, height: usize) -> Self {
        let (x, y) = (width as f64 / self.width as f64, height as f64 / self.height as f64);
        let [sx, sy, cx, cy] = self.lens.numbers();
        let lens = self.lens.with([sx * x, sy * y, cx * x, cy * y]);
        Self { lens, width, height, ..self.clone() }
    }

    /// The same camera for the part of the image that starts at column `x`, row `y`.
    #[must_use]
    pub fn cropped(&self, x: usize, y: usize, width: usize, height: usize) -> Self {
        let (x, y) = (x as f64, y as f64);
        let [sx, sy, cx, cy] = self.lens.numbers();
        let lens = self.lens.with([sx, sy, cx - x, cy - y]);
        Self { lens, width, height, ..self.clone() }
    }

    /// The camera that sees in a world moved by this similarity what this one sees in its own: pixels are the same, depths are
    /// scaled with the world.
    #[must_use]
    pub fn transformed(&self, by: &SimilarityMatrix3<f64>) -> Self {
        // With w = s Q x + b, s (R x + t) = R Qᵀ (w - b) + s t.
        let rotation = self.rotation * by.isometry.rotation.matrix().transpose();
        let moved = by.scaling() * self.translation - rotation * by.isometry.translation.vector;
        let [sx, sy, cx, cy] = self.lens.numbers();
        let lens = match self.lens {
            Lens::Perspective { .. } => self.lens,
            Lens::Orthographic { .. } => {
                self.lens.with([sx / by.scaling(), sy / by.scaling(), cx, cy])
            }
        };
        Self { rotation, translation: moved, lens, ..self.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vector::affine;
    use approx::assert_relative_eq;
    use proptest::prelude::*;

    fn camera(perspective: bool) -> Camera {
        let mut c = Camera::look_at([3.0, 2.0, 4.0], [0.3, 0.1, 0.0], [0.0, 1.0, 0.0], 0.7, 64, 48);
        c.lens = if perspective {
            Lens::Perspective { fx: 70.0, fy: 65.0, cx: 30.5, cy: 27.25 }
        } else {
            Lens::Orthographic { sx: 12.0, sy: 11.0, cx: 30.5, cy: 27.25 }
        };
        c
    }

    #[test]
    fn a_point_on_the_axis_lands_on_the_principal_point() {
        let eye = Vector3::new(3.0, 2.0, 4.0);
        for perspective in [true, false] {
            let p = camera(perspective).project([0.3, 0.1, 0.0]);
            assert_relative_eq!(p.column, 30.5, epsilon = 1e-12);
            assert_relative_eq!(p.row, 27.25, epsilon = 1e-12);
            assert_relative_eq!(p.depth, (eye - Vector3::new(0.3, 0.1, 0.0)).norm());
            assert_relative_eq!(camera(perspective).center(), eye, epsilon = 1e-12);
        }
    }

    #[test]
    fn forward_and_ray_agree_on_the_axis() {
        let c = camera(true);
        let ray = c.ray(30.5, 27.25);
        assert_relative_eq!(Vector3::from(ray.direction), c.forward(), epsilon = 1e-12);
        assert_relative_eq!(Vector3::from(ray.origin), c.center(), epsilon = 1e-12);
    }

    proptest! {
        #[test]
        fn unproject_inverts_project(
            p in prop::array::uniform3(-1.0..1.0_f64), perspective in any::<bool>()
        ) {
            let c = camera(perspective);
            let q = c.project(p);
            let back = c.unproject(q.column, q.row, q.depth);
            for k in 0..3 {
                prop_assert!((p[k] - back[k]).abs() < 1e-10);
            }
        }

        #[test]
        fn the_projection_matrix_says_the_same(
            p in prop::array::uniform3(-1.0..1.0_f64), perspective in any::<bool>()
        ) {
            let c = camera(perspective);
            let [x, y, w] = affine(&c.projection(), p);
            let over = if perspective { w } else { 1.0 };
            let q = c.project(p);
            prop_assert!((w - q.depth).abs() < 1e-12);
            prop_assert!(((1.0 + x / over) * 32.0 - q.column).abs() < 1e-10);
            prop_assert!(((1.0 - y / over) * 24.0 - q.row).abs() < 1e-10);
            let [column, row, _] = affine(&c.pixel_projection(), p);
            prop_assert!((column / over - q.column).abs() < 1e-10);
            prop_assert!((row / over - q.row).abs() < 1e-10);
        }

        #[test]
        fn crop_and_resize_move_pixels_as_images_do(
            p in prop::array::uniform3(-1.0..1.0_f64), perspective in any::<bool>()
        ) {
            let c = camera(perspective);
            let q = c.project(p);
            let r = c.resized(128, 24).project(p);
            prop_assert!((r.column - 2.0 * q.column).abs() < 1e-9);
            prop_assert!((r.row - 0.5 * q.row).abs() < 1e-9);
            let r = c.cropped(7, 11, 20, 20).project(p);
            prop_assert!((r.column - (q.column - 7.0)).abs() < 1e-9);
            prop_assert!((r.row - (q.row - 11.0)).abs() < 1e-9);
        }

        #[test]
        fn a_moved_world_is_seen_as_before(
            p in prop::array::uniform3(-1.0..1.0_f64),
            turn in prop::array::uniform3(-3.0..3.0_f64),
            shift in prop::array::uniform3(-9.0..9.0_f64),
            scale in 0.01..100.0_f64,
            perspective in any::<bool>(),
        ) {
            let by = SimilarityMatrix3::new(shift.into(), turn.into(), scale);
            let c = camera(perspective);
            let moved = by.transform_point(&p.into());
            let (before, after) = (c.project(p), c.transformed(&by).project(moved.coords.into()));
            prop_assert!((before.column - after.column).abs() < 1e-8);
            prop_assert!((before.row - after.row).abs() < 1e-8);
            prop_assert!((scale * before.depth - after.depth).abs() < 1e-8 * (1.0 + scale));
        }
    }
}
