//! COLMAP cameras: OpenCV's axes, a Hamilton quaternion, and a model with its parameters.

use nalgebra::{Quaternion, UnitQuaternion};

use super::{Camera, CameraError, Distortion, OpenCvCamera};

/// A pose and a `PINHOLE` model as COLMAP's text files hold them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColmapCamera {
    /// `QW QX QY QZ`, world to camera; `QW` is not negative.
    pub quaternion: [f64; 4],
    /// `TX TY TZ`, world to camera.
    pub translation: [f64; 3],
    /// `fx fy cx cy` of the model `PINHOLE`.
    pub params: [f64; 4],
}

/// The rotation matrix of a quaternion (w, x, y, z) of any length; zeros for a zero quaternion,
/// which validation then refuses.
pub(super) fn rotation_of([w, x, y, z]: [f64; 4]) -> [[f64; 3]; 3] {
    let q = Quaternion::new(w, x, y, z);
    match UnitQuaternion::try_new(q, 0.0) {
        Some(unit) => {
            let m = unit.to_rotation_matrix();
            std::array::from_fn(|i| std::array::from_fn(|j| m[(i, j)]))
        }
        None => [[0.0; 3]; 3],
    }
}

/// The quaternion (w, x, y, z), w not negative, of a rotation matrix by rows.
pub(super) fn quaternion_of(rotation: [[f64; 3]; 3]) -> [f64; 4] {
    let m = nalgebra::Matrix3::from_fn(|i, j| rotation[i][j]);
    let rotation = nalgebra::Rotation3::from_matrix_unchecked(m);
    let q = UnitQuaternion::from_rotation_matrix(&rotation);
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    [q.w, q.i, q.j, q.k].map(|v| sign * v)
}

impl Camera {
    /// From a line of COLMAP's `images.txt` and one of `cameras.txt`, without distortion.
    ///
    /// `quaternion` is (w, x, y, z), world to camera. `model` is the name of the camera model:
    /// `SIMPLE_PINHOLE` (f, cx, cy), `PINHOLE` (fx, fy, cx, cy), or another one whose coefficients
    /// are all zero. For one that bends rays see [`Distortion::from_colmap`].
    ///
    /// # Errors
    /// `Model` for an unknown model, `Distorted` for one that bends rays, `ParameterCount` for too few or
    /// too many numbers, `NotFinite` for a number that is none.
    pub fn from_colmap(
        quaternion: [f64; 4],
        translation: [f64; 3],
        model: &str,
        params: &[f64],
        width: usize,
        height: usize,
    ) -> Result<Self, CameraError> {
        match Self::from_colmap_distorted(quaternion, translation, model, params, width, height)? {
            (camera, None) => Ok(camera),
            (_, Some(_)) => Err(CameraError::Distorted { model: model.to_owned() }),
        }
    }

    /// The same, and how its lens bends rays where it does: the camera is the pinhole in whose
    /// pixels [`Distortion`] is stated.
    ///
    /// # Errors
    /// As [`Distortion::from_colmap`].
    pub fn from_colmap_distorted(
        quaternion: [f64; 4],
        translation: [f64; 3],
        model: &str,
        params: &[f64],
        width: usize,
        height: usize,
    ) -> Result<(Self, Option<Distortion>), CameraError> {
        let ([fx, fy, cx, cy], distortion) = Distortion::from_colmap(model, params)?;
        let k = [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]];
        let camera = Self::from_opencv(rotation_of(quaternion), translation, k, width, height)?;
        Ok((camera, distortion))
    }

    /// The same camera as COLMAP's quaternion, translation and `PINHOLE` parameters.
    ///
    /// # Errors
    /// `NotRepresentable` for parallel rays.
    pub fn to_colmap(&self) -> Result<ColmapCamera, CameraError> {
        let params = self.pinhole("COLMAP")?;
        let OpenCvCamera { rotation, translation, .. } = self.to_opencv()?;
        Ok(ColmapCamera { quaternion: quaternion_of(rotation), translation, params })
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
        let c = off_center();
        let m = c.to_colmap().unwrap();
        let back = Camera::from_colmap(
            m.quaternion,
            m.translation,
            "PINHOLE",
            &m.params,
            c.width,
            c.height,
        );
        assert_same(&c, &back.unwrap());
    }

    #[test]
    fn a_known_quaternion_turns_as_hamilton_wrote() {
        // 90 degrees about y takes z to x and x to -z; the quaternion need not be of unit length.
        let c = Camera::from_colmap(
            [2.0, 0.0, 2.0, 0.0],
            [0.0, 0.0, 3.0],
            "SIMPLE_PINHOLE",
            &[10.0, 8.5, 6.5],
            16,
            12,
        )
        .unwrap();
        c.validate().unwrap();
        // (-1, 1, 2) -> (2, 1, 1) + t = (2, 1, 4); x right, y down.
        let p = c.project([-1.0, 1.0, 2.0]);
        assert_relative_eq!(p.column, 8.5 + 10.0 * 2.0 / 4.0, epsilon = 1e-12);
        assert_relative_eq!(p.row, 6.5 + 10.0 * 1.0 / 4.0, epsilon = 1e-12);
        assert_relative_eq!(p.depth, 4.0, epsilon = 1e-12);
    }

    #[test]
    fn distortion_and_wrong_counts_are_refused() {
        let q = [1.0, 0.0, 0.0, 0.0];
        let e = |model, params: &[f64]| {
            Camera::from_colmap(q, [0.0; 3], model, params, 4, 4).unwrap_err().to_string()
        };
        assert!(e("OPENCV", &[1.0; 8]).contains("OPENCV"));
        assert!(e("PINHOLE", &[1.0; 3]).contains("found 3"));
        let zero = Camera::from_colmap([0.0; 4], [0.0; 3], "PINHOLE", &[1.0; 4], 4, 4).unwrap();
        assert!(zero.validate().is_err());
    }
}
