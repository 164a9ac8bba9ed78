//! Weak perspective: a scale, a shift and a quaternion, as CMR and its descendants predict.

use nalgebra::{Matrix3, Vector3};

use super::colmap::{quaternion_of, rotation_of};
use super::opencv::flip_y_z;
use super::{Camera, CameraError, Lens};

/// A weak-perspective camera: `x = s (R X)_x + tx`, `y = s (R X)_y + ty`, y down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WeakPerspective {
    /// Half images per world unit.
    pub scale: f64,
    /// Shift in half images, x right and y down.
    pub shift: [f64; 2],
    /// Rotation, (w, x, y, z), w not negative.
    pub quaternion: [f64; 4],
}

/// How far CMR's renderer puts the object, in its scaled units.
const OFFSET_Z: f64 = 5.0;

impl Camera {
    /// From CMR's `[s, tx, ty, qw, qx, qy, qz]`: parallel rays, image coordinates in `[-1, 1]`.
    ///
    /// A point lands at `s (R X)_{xy} + t`, x right and y down, `[-1, 1]` over the whole image on
    /// each axis. Depth is that of CMR's renderer, `s z + 5`, in world units: `z + 5 / s`.
    pub fn from_weak_perspective(
        scale: f64,
        tx: f64,
        ty: f64,
        quaternion: [f64; 4],
        width: usize,
        height: usize,
    ) -> Self {
        let rotation = rotation_of(quaternion);
        let half = [width as f64 / 2.0, height as f64 / 2.0];
        Self {
            rotation: flip_y_z() * Matrix3::from_fn(|i, j| rotation[i][j]),
            translation: Vector3::new(0.0, 0.0, -OFFSET_Z / scale),
            lens: Lens::Orthographic {
                sx: scale * half[0],
                sy: scale * half[1],
                cx: (tx + 1.0) * half[0],
                cy: (ty + 1.0) * half[1],
            },
            width,
            height,
        }
    }

    /// The same camera as CMR's scale, shift and quaternion; its distance is not kept.
    ///
    /// # Errors
    /// `NotRepresentable` for a pinhole, or where one world unit is not the same share of the
    /// width as of the height.
    pub fn to_weak_perspective(&self) -> Result<WeakPerspective, CameraError> {
        let refuse =
            |what| Err(CameraError::NotRepresentable { convention: "weak-perspective", what });
        let Lens::Orthographic { sx, sy, cx, cy } = self.lens else {
            return refuse("a perspective lens");
        };
        let half = [self.width as f64 / 2.0, self.height as f64 / 2.0];
        let scale = sx / half[0];
        if (scale - sy / half[1]).abs() > 1e-9 * scale.abs() {
            return refuse("different scales over the width and over the height");
        }
        let r = flip_y_z() * self.rotation;
        Ok(WeakPerspective {
            scale,
            shift: [
                cx / half[0] - 1.0 + scale * self.translation.x,
                cy / half[1] - 1.0 - scale * self.translation.y,
            ],
            quaternion: quaternion_of(std::array::from_fn(|i| std::array::from_fn(|j| r[(i, j)]))),
        })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::super::tests::{assert_same, off_center};
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn round_trips() {
        let q = quaternion_of([[0.0, -1.0, 0.0], [0.6, 0.0, -0.8], [0.8, 0.0, 0.6]]);
        let c = Camera::from_weak_perspective(0.7, 0.1, -0.3, q, 64, 48);
        c.validate().unwrap();
        let w = c.to_weak_perspective().unwrap();
        assert_same(
            &c,
            &Camera::from_weak_perspective(w.scale, w.shift[0], w.shift[1], w.quaternion, 64, 48),
        );
        assert!(off_center().to_weak_perspective().is_err());
        assert!(c.to_opencv().is_err());
    }

    #[test]
    fn projects_by_the_formula() {
        // 180 degrees about x: (x, y, z) -> (x, -y, -z).
        let c = Camera::from_weak_perspective(0.5, 0.2, -0.1, [0.0, 1.0, 0.0, 0.0], 100, 60);
        let p = c.project([0.4, 0.6, 0.2]);
        assert_relative_eq!(p.column, (0.5 * 0.4 + 0.2 + 1.0) * 50.0, epsilon = 1e-12);
        assert_relative_eq!(p.row, (0.5 * -0.6 - 0.1 + 1.0) * 30.0, epsilon = 1e-12);
        assert_relative_eq!(p.depth * 0.5, 0.5 * -0.2 + 5.0, epsilon = 1e-12);
    }

    #[test]
    fn a_shifted_camera_says_so_in_its_shift() {
        let mut c = Camera::from_weak_perspective(0.5, 0.0, 0.0, [1.0, 0.0, 0.0, 0.0], 10, 10);
        c.translation += Vector3::new(0.4, 0.6, 0.0);
        let w = c.to_weak_perspective().unwrap();
        assert_relative_eq!(w.shift[0], 0.2, epsilon = 1e-12);
        assert_relative_eq!(w.shift[1], -0.3, epsilon = 1e-12);
    }
}
