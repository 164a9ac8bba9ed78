//! Projection matrices: three rows that take points to pixels, of unknown scale.

use nalgebra::{Matrix3, Vector3};

use super::{Camera, CameraError, Distortion};

/// Up to which share of the focal length an angle of the pixels' axes is taken for a real camera's.
const SKEW: f64 = 0.05;
/// Up to which ratio focal lengths along both axes are taken for a real camera's.
const ASPECT: f64 = 1.5;

impl Camera {
    /// From a matrix `P` of three rows: a pixel is `(u / w, v / w)` of `(u, v, w) = P (x, y, z, 1)`,
    /// from the image's corner on, x right and y down. Its scale and sign do not matter.
    ///
    /// `P = K [R | t]` by Gram and Schmidt from the last row up (Hartley and Zisserman, *Multiple View
    /// Geometry*, section 6.2.4). Where the pixels' axes are not quite at right angles, what this does
    /// to rays comes along: see [`Distortion::Skew`].
    ///
    /// # Errors
    /// `NotFinite`; `Singular` for a camera at infinity; `Intrinsics` where the angle of the axes, or
    /// their lengths, are no camera's: such a matrix is stated in a projective frame, which has
    /// neither lengths nor angles.
    ///
    /// ```
    /// use mesh_core::Camera;
    ///
    /// // Focal length 100, the middle of a 64 x 48 image, 5 in front of the origin.
    /// let p = [[100.0, 0.0, 32.0, 160.0], [0.0, 100.0, 24.0, 120.0], [0.0, 0.0, 1.0, 5.0]];
    /// let (camera, skew) = Camera::from_projection_matrix(p.map(|row| row.map(|x| -2.0 * x)), 64, 48)?;
    /// let seen = camera.project([0.5, 0.25, 0.0]);
    /// assert!((seen.column - 42.0).abs() < 1e-9 && (seen.row - 29.0).abs() < 1e-9 && skew.is_none());
    /// # Ok::<(), mesh_core::CameraError>(())
    /// ```
    pub fn from_projection_matrix(
        p: [[f64; 4]; 3],
        width: usize,
        height: usize,
    ) -> Result<(Self, Option<Distortion>), CameraError> {
        if let Some(&found) = p.iter().flatten().find(|x| !x.is_finite()) {
            return Err(CameraError::NotFinite { field: "projection matrix", found });
        }
        let [m1, m2, m3] = p.map(|[x, y, z, _]| Vector3::new(x, y, z));
        let determinant = Matrix3::from_rows(&[m1, m2, m3].map(|m| m.transpose())).determinant();
        // The last row of a camera's matrix has the length 1; one that mirrors has the wrong sign.
        let scale = determinant.signum() / m3.norm();
        let volume = determinant.abs() / (m1.norm() * m2.norm() * m3.norm());
        if !scale.is_finite() || volume.is_nan() || volume < 1e-12 {
            return Err(CameraError::Singular { determinant });
        }
        let [m1, m2, r3] = [m1, m2, m3].map(|m| m * scale);
        let cy = m2.dot(&r3);
        let along_y = m2 - r3 * cy;
        let fy = along_y.norm();
        let r2 = along_y / fy;
        let (cx, skew) = (m1.dot(&r3), m1.dot(&r2));
        let along_x = m1 - r3 * cx - r2 * skew;
        let fx = along_x.norm();
        let r1 = along_x / fx;
        let shear = skew / fx;
        if shear.abs() > SKEW || !(1.0 / ASPECT..ASPECT).contains(&(fx / fy)) {
            let what = format!(
                "axes of pixels with a skew of {shear:.3} and lengths {fx:.4e} and {fy:.4e}: these matrices are of a \
                 projective frame, without lengths and angles, expected metric ones (skew below {SKEW}, lengths \
                 alike)"
            );
            return Err(CameraError::Intrinsics { what });
        }
        let t3 = scale * p[2][3];
        let t2 = (scale * p[1][3] - cy * t3) / fy;
        let t1 = (scale * p[0][3] - skew * t2 - cx * t3) / fx;
        let rotation = [r1, r2, r3].map(|r| [r.x, r.y, r.z]);
        let intrinsics = [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]];
        let camera = Self::from_opencv(rotation, [t1, t2, t3], intrinsics, width, height)?;
        // What is left of rounding in a file is no skew.
        let skew = (shear.abs() > 1e-6).then_some(Distortion::Skew { shear });
        Ok((camera, skew))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::super::tests::{assert_same, off_center};
    use super::*;

    /// `K [R | t]`, times a scale.
    fn matrix(camera: &Camera, skew: f64, scale: f64) -> [[f64; 4]; 3] {
        let cv = camera.to_opencv().unwrap();
        let mut k = cv.intrinsics;
        k[0][1] = skew;
        let pose = |j: usize, c: usize| if c < 3 { cv.rotation[j][c] } else { cv.translation[j] };
        std::array::from_fn(|i| {
            std::array::from_fn(|c| scale * (0..3).map(|j| k[i][j] * pose(j, c)).sum::<f64>())
        })
    }

    #[test]
    fn a_matrix_of_any_scale_is_taken_apart() {
        let camera = off_center();
        for scale in [1.0, -1.0, 1e-6, -3e7] {
            let p = matrix(&camera, 0.0, scale);
            let (found, skew) =
                Camera::from_projection_matrix(p, camera.width, camera.height).unwrap();
            assert_same(&camera, &found);
            assert_eq!(skew, None);
        }
    }

    #[test]
    fn a_small_skew_is_a_distortion_and_a_large_one_is_no_camera() {
        let camera = off_center();
        let fx = camera.to_opencv().unwrap().intrinsics[0][0];
        let read = |skew| {
            Camera::from_projection_matrix(matrix(&camera, skew, 2.0), camera.width, camera.height)
        };
        let (found, skew) = read(0.01 * fx).unwrap();
        assert_same(&camera, &found);
        let bent = skew.unwrap().distort([0.3, 0.2]);
        assert!((bent[0] - 0.302).abs() < 1e-9 && bent[1] == 0.2, "{bent:?}");
        assert!(read(0.2 * fx).unwrap_err().to_string().contains("projective frame"));
        let none = Camera::from_projection_matrix([[0.0; 4]; 3], 4, 4).unwrap_err();
        assert!(none.to_string().contains("singular"), "{none}");
        let nan = Camera::from_projection_matrix([[f64::NAN; 4]; 3], 4, 4).unwrap_err();
        assert!(nan.to_string().contains("projection matrix"), "{nan}");
    }
}
