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
    use super::super::tests::{assert_same, off_centre};
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn both_kinds_of_intrinsics_round_trip() {
        let c = off_centre();
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
