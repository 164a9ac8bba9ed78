//! OpenGL poses: camera-to-world matrices, as Blender, NeRF and nerfstudio write them.

use nalgebra::{Matrix3, Vector3};

use super::{Camera, Lens};

impl Camera {
    /// A camera at `eye` that looks at `target`, with square pixels and a centred lens.
    ///
    /// `fov_y` is the full vertical angle of view, in radians. Where `up` is parallel to the line
    /// of sight, another axis takes its place, so that views from the pole are not a special case.
    pub fn look_at(
        eye: [f64; 3],
        target: [f64; 3],
        up: [f64; 3],
        fov_y: f64,
        width: usize,
        height: usize,
    ) -> Self {
        let eye = Vector3::from(eye);
        let z = (eye - Vector3::from(target)).try_normalize(0.0).unwrap_or_else(Vector3::z);
        let sideways = |up: Vector3<f64>| {
            // Relative to |up|, so that its length does not matter.
            up.try_normalize(0.0).and_then(|up| up.cross(&z).try_normalize(1e-9))
        };
        let x = [Vector3::from(up), -Vector3::z(), Vector3::x()]
            .into_iter()
            .find_map(sideways)
            .unwrap_or_else(Vector3::x);
        let y = z.cross(&x);
        let rotation = Matrix3::from_rows(&[x.transpose(), y.transpose(), z.transpose()]);
        let (w, h) = (width as f64, height as f64);
        let f = h / (2.0 * (fov_y / 2.0).tan());
        let lens = Lens::Perspective { fx: f, fy: f, cx: w / 2.0, cy: h / 2.0 };
        Self { rotation, translation: -(rotation * eye), lens, width, height }
    }

    /// From a camera-to-world matrix in OpenGL axes, by rows: NeRF's `transform_matrix`.
    ///
    /// Focal lengths and principal point are in pixels, with the origin at the top-left corner of
    /// the image. The last row is not read. A matrix without an inverse gives a camera that
    /// [`Camera::validate`] refuses.
    pub fn from_opengl(
        camera_to_world: [[f64; 4]; 4],
        fx: f64,
        fy: f64,
        cx: f64,
        cy: f64,
        width: usize,
        height: usize,
    ) -> Self {
        let m = Matrix3::from_fn(|i, k| camera_to_world[i][k]);
        let center = Vector3::from_fn(|i, _| camera_to_world[i][3]);
        // The transpose of a singular matrix is singular too: it says so when validated.
        let rotation = m.try_inverse().unwrap_or_else(|| m.transpose());
        Self {
            rotation,
            translation: -(rotation * center),
            lens: Lens::Perspective { fx, fy, cx, cy },
            width,
            height,
        }
    }

    /// From NeRF-synthetic's `camera_angle_x`: the full horizontal angle of view, in radians.
    pub fn from_opengl_fov_x(
        camera_to_world: [[f64; 4]; 4],
        fov_x: f64,
        width: usize,
        height: usize,
    ) -> Self {
        let (w, h) = (width as f64, height as f64);
        let f = w / (2.0 * (fov_x / 2.0).tan());
        Self::from_opengl(camera_to_world, f, f, w / 2.0, h / 2.0, width, height)
    }

    /// The camera-to-world matrix in OpenGL axes, by rows.
    pub fn to_opengl(&self) -> [[f64; 4]; 4] {
        let (r, c) = (self.rotation.transpose(), self.center());
        let mut m = [[0.0, 0.0, 0.0, 1.0]; 4];
        for i in 0..3 {
            m[i] = [r[(i, 0)], r[(i, 1)], r[(i, 2)], c[i]];
        }
        m
    }

    /// The full horizontal and vertical angles of view, in radians; `None` for parallel rays.
    ///
    /// They are angles of the image's half width and half height seen at the focal length,
    /// wherever the principal point lies.
    pub fn fov(&self) -> Option<[f64; 2]> {
        let Lens::Perspective { fx, fy, .. } = self.lens else { return None };
        let angle = |size: usize, f: f64| 2.0 * (size as f64 / (2.0 * f)).atan();
        Some([angle(self.width, fx), angle(self.height, fy)])
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::super::tests::{assert_same, off_center};
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn known_points_land_where_geometry_says() {
        // At (0, 0, 5) looking at the origin with 90 degrees over 20 rows: f = 10 pixels.
        let c = Camera::look_at(
            [0.0, 0.0, 5.0],
            [0.0; 3],
            [0.0, 1.0, 0.0],
            std::f64::consts::FRAC_PI_2,
            40,
            20,
        );
        let p = c.project([1.0, 2.0, 0.0]);
        assert_relative_eq!(p.column, 20.0 + 10.0 / 5.0, epsilon = 1e-12);
        assert_relative_eq!(p.row, 10.0 - 20.0 / 5.0, epsilon = 1e-12);
        assert_relative_eq!(p.depth, 5.0, epsilon = 1e-12);
        assert_relative_eq!(c.fov().unwrap()[1], std::f64::consts::FRAC_PI_2, epsilon = 1e-12);
    }

    #[test]
    fn looking_along_up_is_still_a_camera() {
        for eye in [[0.0, 3.0, 0.0], [0.0, -3.0, 0.0], [0.0; 3]] {
            let c = Camera::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 0.7, 8, 8);
            c.validate().unwrap();
        }
    }

    #[test]
    fn camera_to_world_round_trips() {
        let c = off_center();
        let Lens::Perspective { fx, fy, cx, cy } = c.lens else { unreachable!() };
        assert_same(&c, &Camera::from_opengl(c.to_opengl(), fx, fy, cx, cy, c.width, c.height));
    }

    #[test]
    fn a_nerf_frame_projects_as_nerf_does() {
        // A camera at (1, 2, 3), turned so that it looks along +x with z up.
        let c2w = [
            [0.0, 0.0, -1.0, 1.0],
            [-1.0, 0.0, 0.0, 2.0],
            [0.0, 1.0, 0.0, 3.0],
            [0.0, 0.0, 0.0, 1.0],
        ];
        let c = Camera::from_opengl_fov_x(c2w, std::f64::consts::FRAC_PI_2, 20, 10);
        c.validate().unwrap();
        // Two ahead (x), one to the right (-y), half up (z): f = 10 px.
        let p = c.project([3.0, 1.0, 3.5]);
        assert_relative_eq!(p.column, 10.0 + 10.0 * 1.0 / 2.0, epsilon = 1e-12);
        assert_relative_eq!(p.row, 5.0 - 10.0 * 0.5 / 2.0, epsilon = 1e-12);
        assert_relative_eq!(p.depth, 2.0, epsilon = 1e-12);
    }

    #[test]
    fn a_singular_matrix_is_refused() {
        let c = Camera::from_opengl([[0.0; 4]; 4], 1.0, 1.0, 0.0, 0.0, 4, 4);
        assert!(c.validate().is_err());
    }
}
