//! kaolin's synthetic views: row vectors times a 4x4, and a lens in millimetres.

use nalgebra::{Matrix3, Vector3};

use super::{Camera, CameraError, Lens};

/// `camera_properties` of a kaolin view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KaolinCamera {
    /// World to camera for row vectors: `[x y z 1] M`, the translation in the last row.
    pub tf_mat: [[f64; 4]; 4],
    /// Width of the sensor, in the unit of the focal length (kaolin's App: millimetres).
    pub horizontal_aperture: f64,
    /// Focal length.
    pub focal_length: f64,
}

impl Camera {
    /// From the `camera_properties` of a kaolin view.
    ///
    /// `tf_mat` takes row vectors from the world to OpenGL camera axes, its translation in the
    /// last row. The horizontal angle of view is `2 atan(aperture / (2 focal))`; pixels are
    /// square and the lens is centred.
    pub fn from_kaolin(
        tf_mat: [[f64; 4]; 4],
        horizontal_aperture: f64,
        focal_length: f64,
        width: usize,
        height: usize,
    ) -> Self {
        let (w, h) = (width as f64, height as f64);
        let f = w * focal_length / horizontal_aperture;
        Self {
            rotation: Matrix3::from_fn(|i, j| tf_mat[j][i]),
            translation: Vector3::from_fn(|i, _| tf_mat[3][i]),
            lens: Lens::Perspective { fx: f, fy: f, cx: w / 2.0, cy: h / 2.0 },
            width,
            height,
        }
    }

    /// From kaolin's transform and the full vertical angle of view, in radians.
    ///
    /// This is `generate_perspective_projection(fov_y, width / height)` of kaolin's library.
    pub fn from_kaolin_fov_y(
        tf_mat: [[f64; 4]; 4],
        fov_y: f64,
        width: usize,
        height: usize,
    ) -> Self {
        let aspect = width as f64 / height as f64;
        Self::from_kaolin(tf_mat, 2.0 * aspect * (fov_y / 2.0).tan(), 1.0, width, height)
    }

    /// The same camera as kaolin's metadata, for a sensor of the given width.
    ///
    /// # Errors
    /// `NotRepresentable` for parallel rays, pixels that are not square or a lens off the centre:
    /// the metadata has no field for them.
    pub fn to_kaolin(&self, horizontal_aperture: f64) -> Result<KaolinCamera, CameraError> {
        let refuse = |what| Err(CameraError::NotRepresentable { convention: "kaolin", what });
        let [fx, fy, cx, cy] = self.pinhole("kaolin")?;
        let (w, h) = (self.width as f64, self.height as f64);
        if (fx - fy).abs() > 1e-6 * fx.abs() {
            return refuse("pixels that are not square (fx differs from fy)");
        }
        if (cx - w / 2.0).abs() > 1e-6 * w || (cy - h / 2.0).abs() > 1e-6 * h {
            return refuse("a principal point off the centre of the image");
        }
        let mut tf_mat = [[0.0; 4]; 4];
        for i in 0..3 {
            for j in 0..3 {
                tf_mat[j][i] = self.rotation[(i, j)];
            }
            tf_mat[3][i] = self.translation[i];
        }
        tf_mat[3][3] = 1.0;
        Ok(KaolinCamera { tf_mat, horizontal_aperture, focal_length: fx * horizontal_aperture / w })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::super::tests::{assert_same, off_center};
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn round_trips_where_the_metadata_can_say_it() {
        let mut c = off_center();
        assert!(matches!(c.to_kaolin(20.0), Err(CameraError::NotRepresentable { .. })));
        c.lens = Lens::Perspective { fx: 50.0, fy: 50.0, cx: 32.0, cy: 24.0 };
        let k = c.to_kaolin(20.955).unwrap();
        assert_same(
            &c,
            &Camera::from_kaolin(
                k.tf_mat,
                k.horizontal_aperture,
                k.focal_length,
                c.width,
                c.height,
            ),
        );
    }

    #[test]
    fn a_view_of_the_clock_projects_as_kaolin_does() {
        // Row vectors: x' = v M; then ndc = (x'/(-z') / tan(fov/2)) at aspect one.
        let tf_mat = [
            [0.188_143_086_524_794_53, 0.888_322_016_283_629_4, 0.418_910_699_766_325_83, 0.0],
            [0.0, 0.426_527_791_398_532_25, -0.904_474_456_889_021_3, 0.0],
            [-0.982_141_628_785_240_7, 0.170_170_616_001_933_13, 0.080_248_255_162_321_42, 0.0],
            [0.0, 0.0, -208.122_970_581_054_7, 1.0],
        ];
        let c = Camera::from_kaolin(tf_mat, 20.955, 24.0, 256, 256);
        c.validate().unwrap();
        let v = [10.0, -20.0, 30.0];
        let q: [f64; 3] = std::array::from_fn(|j| {
            (0..3).map(|i| v[i] * tf_mat[i][j]).sum::<f64>() + tf_mat[3][j]
        });
        let gain = 2.0 * 24.0 / 20.955;
        let p = c.project(v);
        assert_relative_eq!(p.column, 128.0 * (1.0 + gain * q[0] / -q[2]), epsilon = 1e-9);
        assert_relative_eq!(p.row, 128.0 * (1.0 - gain * q[1] / -q[2]), epsilon = 1e-9);
        assert_relative_eq!(p.depth, -q[2], epsilon = 1e-9);
        let fov = 2.0 * (20.955_f64 / 48.0).atan();
        assert_same(&c, &Camera::from_kaolin_fov_y(tf_mat, fov, 256, 256));
    }

    #[test]
    fn a_vertical_angle_is_vertical_on_a_wide_image() {
        let tf_mat = [
            [1.0, 0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0, 0.0],
            [0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, -2.0, 1.0],
        ];
        let c = Camera::from_kaolin_fov_y(tf_mat, std::f64::consts::FRAC_PI_2, 40, 20);
        assert_relative_eq!(c.project([0.0, 2.0, 0.0]).row, 0.0, epsilon = 1e-12);
        assert_relative_eq!(c.project([2.0, 0.0, 0.0]).column, 30.0, epsilon = 1e-12);
    }
}
