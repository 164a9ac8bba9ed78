//! PyTorch3D cameras: row vectors, x to the left, and intrinsics in NDC or in pixels.

use nalgebra::{Matrix3, Vector3};

use super::{Camera, CameraError, Lens};

/// A `PerspectiveCameras` of PyTorch3D, one of its batch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pytorch3dCamera {
    /// `R`, by rows; it multiplies row vectors from the right: `X_cam = X R + T`.
    pub rotation: [[f64; 3]; 3],
    /// `T`.
    pub translation: [f64; 3],
    /// `focal_length`, x and y.
    pub focal: [f64; 2],
    /// `principal_point`, x and y.
    pub principal: [f64; 2],
}

/// PyTorch3D's camera axes (x left, z forward) in OpenGL's, and the reverse.
fn flip_x_z() -> Matrix3<f64> {
    Matrix3::from_diagonal(&Vector3::new(-1.0, 1.0, -1.0))
}

/// Where a camera stands on a sphere around what it looks at, as PyTorch3D counts it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SphericalView {
    /// From the object to the camera.
    pub distance: f64,
    /// Above the horizontal plane, in degrees.
    pub elevation: f64,
    /// Around the vertical axis from +z towards +x, in degrees.
    pub azimuth: f64,
    /// What it looks at.
    pub at: [f64; 3],
    /// Which way is up.
    pub up: [f64; 3],
}

impl SphericalView {
    /// Looks at the origin, +y being up.
    pub fn new(distance: f64, elevation: f64, azimuth: f64) -> Self {
        Self { distance, elevation, azimuth, at: [0.0; 3], up: [0.0, 1.0, 0.0] }
    }

    /// Where the camera stands: PyTorch3D's `camera_position_from_spherical_angles`, about [`at`](Self::at).
    pub fn eye(&self) -> [f64; 3] {
        let (elevation, azimuth) = (self.elevation.to_radians(), self.azimuth.to_radians());
        let direction =
            [elevation.cos() * azimuth.sin(), elevation.sin(), elevation.cos() * azimuth.cos()];
        [0, 1, 2].map(|k| self.at[k] + self.distance * direction[k])
    }
}

/// `R` by rows and `T` of PyTorch3D's `look_at_view_transform(dist, elev, azim, at=.., up=..)`: for row vectors,
/// `X_cam = X R + T`, x left, y up, z forward.
///
/// ```
/// use mesh_core::{Camera, SphericalView, look_at_view_transform};
///
/// let (r, t) = look_at_view_transform(&SphericalView::new(2.7, 0.0, 180.0));
/// assert!((r[0][0] - 1.0).abs() < 1e-12 && (t[2] - 2.7).abs() < 1e-12);
/// // FoVPerspectiveCameras(fov=60): a focal length of 1 / tan(30°) in NDC.
/// let focal = 1.0 / 30_f64.to_radians().tan();
/// let camera = Camera::from_pytorch3d_ndc(r, t, [focal; 2], [0.0; 2], 256, 256);
/// assert!((camera.project([0.0; 3]).depth - 2.7).abs() < 1e-12);
/// ```
///
/// Where the line of sight is along `up`, another axis takes its place, as in [`Camera::look_at`]; PyTorch3D gives a
/// matrix without an inverse there.
///
/// # References
/// `pytorch3d.renderer.look_at_view_transform`.
pub fn look_at_view_transform(view: &SphericalView) -> ([[f64; 3]; 3], [f64; 3]) {
    let camera = Camera::look_at(view.eye(), view.at, view.up, 1.0, 1, 1);
    let r = flip_x_z() * camera.rotation;
    let rows = std::array::from_fn(|i| std::array::from_fn(|j| r[(j, i)]));
    (rows, (flip_x_z() * camera.translation).into())
}

impl Camera {
    /// From a PyTorch3D camera with intrinsics in pixels (`in_ndc=False`).
    ///
    /// `rotation` is `R` by rows, for row vectors: `X_cam = X R + T`. The principal point counts
    /// pixels from the top-left corner of the image, x right and y down.
    pub fn from_pytorch3d_screen(
        rotation: [[f64; 3]; 3],
        translation: [f64; 3],
        [fx, fy]: [f64; 2],
        [cx, cy]: [f64; 2],
        width: usize,
        height: usize,
    ) -> Self {
        Self {
            rotation: flip_x_z() * Matrix3::from_fn(|i, j| rotation[j][i]),
            translation: flip_x_z() * Vector3::from(translation),
            lens: Lens::Perspective { fx, fy, cx, cy },
            width,
            height,
        }
    }

    /// From a PyTorch3D camera with intrinsics in NDC (`in_ndc=True`, its default).
    ///
    /// One NDC unit is half the shorter side of the image, and x goes to the left.
    pub fn from_pytorch3d_ndc(
        rotation: [[f64; 3]; 3],
        translation: [f64; 3],
        focal: [f64; 2],
        principal: [f64; 2],
        width: usize,
        height: usize,
    ) -> Self {
        let unit = width.min(height) as f64 / 2.0;
        let half = [width as f64 / 2.0, height as f64 / 2.0];
        Self::from_pytorch3d_screen(
            rotation,
            translation,
            focal.map(|f| f * unit),
            [half[0] - principal[0] * unit, half[1] - principal[1] * unit],
            width,
            height,
        )
    }

    /// The same camera with PyTorch3D's intrinsics in pixels.
    ///
    /// # Errors
    /// `NotRepresentable` for parallel rays.
    pub fn to_pytorch3d_screen(&self) -> Result<Pytorch3dCamera, CameraError> {
        let [fx, fy, cx, cy] = self.pinhole("PyTorch3D PerspectiveCameras")?;
        let r = flip_x_z() * self.rotation;
        Ok(Pytorch3dCamera {
            rotation: std::array::from_fn(|i| std::array::from_fn(|j| r[(j, i)])),
            translation: (flip_x_z() * self.translation).into(),
            focal: [fx, fy],
            principal: [cx, cy],
        })
    }

    /// The same camera with PyTorch3D's intrinsics in NDC.
    ///
    /// # Errors
    /// `NotRepresentable` for parallel rays.
    pub fn to_pytorch3d_ndc(&self) -> Result<Pytorch3dCamera, CameraError> {
        let screen = self.to_pytorch3d_screen()?;
        let unit = self.width.min(self.height) as f64 / 2.0;
        let half = [self.width as f64 / 2.0, self.height as f64 / 2.0];
        Ok(Pytorch3dCamera {
            focal: screen.focal.map(|f| f / unit),
            principal: std::array::from_fn(|k| (half[k] - screen.principal[k]) / unit),
            ..screen
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
    fn a_view_from_the_pole_has_a_rotation() {
        for elevation in [90.0, -90.0, 30.0] {
            let (r, t) = look_at_view_transform(&SphericalView::new(2.0, elevation, 20.0));
            let r = Matrix3::from_fn(|i, j| r[i][j]);
            assert_relative_eq!(r * r.transpose(), Matrix3::identity(), epsilon = 1e-9);
            assert_relative_eq!(r.determinant(), 1.0, epsilon = 1e-9);
            assert_relative_eq!(t[2], 2.0, epsilon = 1e-9);
        }
    }

    #[test]
    fn both_kinds_of_intrinsics_round_trip() {
        let c = off_center();
        let s = c.to_pytorch3d_screen().unwrap();
        assert_same(
            &c,
            &Camera::from_pytorch3d_screen(
                s.rotation,
                s.translation,
                s.focal,
                s.principal,
                c.width,
                c.height,
            ),
        );
        let n = c.to_pytorch3d_ndc().unwrap();
        assert_same(
            &c,
            &Camera::from_pytorch3d_ndc(
                n.rotation,
                n.translation,
                n.focal,
                n.principal,
                c.width,
                c.height,
            ),
        );
    }

    #[test]
    fn projects_by_the_documented_formulas() {
        // X R + T with a quarter turn: (1, 2, 3) R = (2, -1, 3); T = (0.5, 0, 2): (2.5, -1, 5).
        let r = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
        let (w, h) = (40, 20);
        let c = Camera::from_pytorch3d_ndc(r, [0.5, 0.0, 2.0], [1.5, 1.2], [0.1, -0.2], w, h);
        c.validate().unwrap();
        let ndc = [1.5 * 2.5 / 5.0 + 0.1, -1.2 / 5.0 - 0.2];
        // NDC to screen: x = W/2 - s x_ndc with s = min(W, H) / 2.
        let p = c.project([1.0, 2.0, 3.0]);
        assert_relative_eq!(p.column, 20.0 - 10.0 * ndc[0], epsilon = 1e-12);
        assert_relative_eq!(p.row, 10.0 - 10.0 * ndc[1], epsilon = 1e-12);
        assert_relative_eq!(p.depth, 5.0, epsilon = 1e-12);
    }
}
