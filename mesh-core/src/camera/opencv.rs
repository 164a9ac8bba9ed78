//! OpenCV cameras: x right, y down, z forward; BOP and most calibrations.

use nalgebra::{Matrix3, Vector3};

use super::{Camera, CameraError, Lens};

/// A pose and intrinsics in OpenCV's convention.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OpenCvCamera {
    /// Rotation from the world to the camera, by rows.
    pub rotation: [[f64; 3]; 3],
    /// Translation from the world to the camera.
    pub translation: [f64; 3],
    /// `[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]`, in pixels.
    pub intrinsics: [[f64; 3]; 3],
}

/// OpenCV's camera axes in OpenGL's, and the reverse: the y and z axes turn round.
pub(super) fn flip_y_z() -> Matrix3<f64> {
    Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0))
}

impl Camera {
    /// From a world-to-camera rotation (by rows) and translation in OpenCV's axes.
    ///
    /// `intrinsics` counts pixels from the top-left *corner* of the image, so that the centre of
    /// the first pixel is (0.5, 0.5), as COLMAP does. Where a calibration calls that centre
    /// (0, 0), as OpenCV's own does, add 0.5 to `cx` and `cy` first.
    ///
    /// # Errors
    /// `Intrinsics` where the matrix has skew or a last row other than (0, 0, 1).
    pub fn from_opencv(
        rotation: [[f64; 3]; 3],
        translation: [f64; 3],
        intrinsics: [[f64; 3]; 3],
        width: usize,
        height: usize,
    ) -> Result<Self, CameraError> {
        let k = intrinsics;
        if k[0][1] != 0.0 || k[1][0] != 0.0 || k[2] != [0.0, 0.0, 1.0] {
            return Err(CameraError::Intrinsics {
                what: format!(
                    "expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], found {k:?} (no skew is known)"
                ),
            });
        }
        Ok(Self {
            rotation: flip_y_z() * Matrix3::from_fn(|i, j| rotation[i][j]),
            translation: flip_y_z() * Vector3::from(translation),
            lens: Lens::Perspective { fx: k[0][0], fy: k[1][1], cx: k[0][2], cy: k[1][2] },
            width,
            height,
        })
    }

    /// The same camera in OpenCV's convention.
    ///
    /// # Errors
    /// `NotRepresentable` for parallel rays.
    pub fn to_opencv(&self) -> Result<OpenCvCamera, CameraError> {
        let [fx, fy, cx, cy] = self.pinhole("OpenCV")?;
        let r = flip_y_z() * self.rotation;
        Ok(OpenCvCamera {
            rotation: std::array::from_fn(|i| std::array::from_fn(|j| r[(i, j)])),
            translation: (flip_y_z() * self.translation).into(),
            intrinsics: [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]],
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
        let c = off_center();
        let o = c.to_opencv().unwrap();
        let back = Camera::from_opencv(o.rotation, o.translation, o.intrinsics, c.width, c.height);
        assert_same(&c, &back.unwrap());
    }

    #[test]
    fn projects_by_the_textbook() {
        // x = K (R X + t) with R a quarter turn about z and t = (0.5, -0.25, 4).
        let r = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
        let k = [[50.0, 0.0, 21.0], [0.0, 60.0, 13.0], [0.0, 0.0, 1.0]];
        let c = Camera::from_opencv(r, [0.5, -0.25, 4.0], k, 40, 30).unwrap();
        c.validate().unwrap();
        // R (1, 2, 1) = (-2, 1, 1); plus t: (-1.5, 0.75, 5).
        let p = c.project([1.0, 2.0, 1.0]);
        assert_relative_eq!(p.column, 50.0 * -1.5 / 5.0 + 21.0, epsilon = 1e-12);
        assert_relative_eq!(p.row, 60.0 * 0.75 / 5.0 + 13.0, epsilon = 1e-12);
        assert_relative_eq!(p.depth, 5.0, epsilon = 1e-12);
    }

    #[test]
    fn skew_is_refused() {
        let identity = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let mut k = identity;
        k[0][1] = 0.1;
        let e = Camera::from_opencv(identity, [0.0; 3], k, 4, 4).unwrap_err();
        assert!(matches!(e, CameraError::Intrinsics { .. }));
    }
}
