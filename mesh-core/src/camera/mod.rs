//! Cameras: where the world lands in an image, and how other tools write the same thing down.
//!
//! One file per convention; every constructor has an inverse, and the tests hold both against
//! projections worked out by hand, at a width unlike the height and with the principal point off
//! the centre.

mod colmap;
mod distortion;
mod error;
mod kaolin;
mod opencv;
mod opengl;
mod project;
mod projection_matrix;
mod pytorch3d;
mod r2n2;
mod ray;
mod volume;
mod weak_perspective;

pub use colmap::ColmapCamera;
pub use distortion::Distortion;
pub use error::CameraError;
pub use kaolin::KaolinCamera;
pub use opencv::OpenCvCamera;
pub use project::Projected;
pub use pytorch3d::{Pytorch3dCamera, SphericalView, look_at_view_transform};
pub use r2n2::R2n2View;
pub use ray::Ray;
pub use volume::CameraVolume;
pub use weak_perspective::WeakPerspective;

use nalgebra::{Matrix3, Vector3};

/// A camera: pose, lens and image size.
///
/// Axes are OpenGL's: x right, y up, looking along -z. A world point `p` is at
/// `rotation * p + translation` in the camera's frame. Constructors take what other tools write, and
/// each has an inverse, `to_..`; [`Camera::validate`] says what is wrong with a camera from outside.
///
/// | tool | camera axes: x, y, view | pose | constructor |
/// |---|---|---|---|
/// | this crate | right, up, -z | world to camera, `R p + t` | [`Camera::look_at`] |
/// | OpenGL, Blender, NeRF, nerfstudio | right, up, -z | camera to world | [`Camera::from_opengl`] |
/// | OpenCV, BOP | right, down, +z | world to camera, `R p + t` | [`Camera::from_opencv`] |
/// | COLMAP | right, down, +z | world to camera, quaternion (w, x, y, z) | [`Camera::from_colmap`] |
/// | PyTorch3D, CO3D | left, up, +z | world to camera, rows: `p R + T` | [`Camera::from_pytorch3d_ndc`], [`_screen`](Camera::from_pytorch3d_screen) |
/// | kaolin | right, up, -z | world to camera, rows: `[p 1] M` | [`Camera::from_kaolin`] |
/// | 3D-R2N2 renderings | right, up, -z | azimuth, elevation, distance | [`Camera::from_r2n2`] |
/// | Middlebury, NeuS, any `P` | right, down, +z | three rows, world to pixel | [`Camera::from_projection_matrix`] |
/// | CMR, MCMR | right, down, +z | weak perspective and quaternion | [`Camera::from_weak_perspective`] |
///
/// ```
/// use mesh_core::Camera;
///
/// let camera = Camera::look_at([0.0, 0.0, 5.0], [0.0; 3], [0.0, 1.0, 0.0], 0.8, 640, 480);
/// let seen = camera.project([0.0, 1.0, 0.0]);
/// assert!(seen.column == 320.0 && seen.row < 240.0 && seen.depth == 5.0);
/// let cv = camera.to_opencv()?;
/// assert_eq!(cv.intrinsics[0][2], 320.0);
/// # Ok::<(), mesh_core::CameraError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Rotation from the world to the camera.
    pub rotation: Matrix3<f64>,
    /// Translation from the world to the camera, after the rotation.
    pub translation: Vector3<f64>,
    /// How camera points become pixels.
    pub lens: Lens,
    /// Image width in pixels.
    pub width: usize,
    /// Image height in pixels.
    pub height: usize,
}

/// How points in the camera's frame become pixels.
///
/// Pixel coordinates have their origin at the top-left corner of the image, x right and y down,
/// so that pixel (row i, column j) has its centre at `(j + 0.5, i + 0.5)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lens {
    /// A pinhole: focal lengths and principal point, all in pixels.
    Perspective {
        /// Focal length along x.
        fx: f64,
        /// Focal length along y.
        fy: f64,
        /// Principal point, x.
        cx: f64,
        /// Principal point, y.
        cy: f64,
    },
    /// Parallel rays: pixels per world unit and the pixel of the camera's axis.
    Orthographic {
        /// Pixels per unit along x.
        sx: f64,
        /// Pixels per unit along y.
        sy: f64,
        /// Pixel of the axis, x.
        cx: f64,
        /// Pixel of the axis, y.
        cy: f64,
    },
}

impl Lens {
    /// The scales of the axes, then the principal point.
    pub fn numbers(self) -> [f64; 4] {
        match self {
            Self::Perspective { fx, fy, cx, cy } => [fx, fy, cx, cy],
            Self::Orthographic { sx, sy, cx, cy } => [sx, sy, cx, cy],
        }
    }

    /// The same kind of lens with other [`numbers`](Self::numbers).
    #[must_use]
    pub fn with(self, [sx, sy, cx, cy]: [f64; 4]) -> Self {
        match self {
            Self::Perspective { .. } => Self::Perspective { fx: sx, fy: sy, cx, cy },
            Self::Orthographic { .. } => Self::Orthographic { sx, sy, cx, cy },
        }
    }
}

impl Camera {
    /// The rows X, Y, W of the projection, each applied to `(x, y, z, 1)` of a world point.
    ///
    /// Planar depth is `W`, positive in front. Normalised device coordinates are `(X/W, Y/W)` for
    /// a perspective lens and `(X, Y)` for an orthographic one.
    pub fn projection(&self) -> [[f64; 4]; 3] {
        let (w, h) = (self.width as f64, self.height as f64);
        let [x, y, z] = [0, 1, 2].map(|k| {
            let row = self.rotation.row(k);
            [row[0], row[1], row[2], self.translation[k]]
        });
        let depth = z.map(|v| -v);
        let row = |axis: [f64; 4], gain: f64, offset: f64| {
            let mut r: [f64; 4] = std::array::from_fn(|k| gain * axis[k]);
            if self.is_perspective() {
                for k in 0..4 {
                    r[k] += offset * depth[k];
                }
            } else {
                r[3] += offset;
            }
            r
        };
        let [sx, sy, cx, cy] = self.lens.numbers();
        [row(x, 2.0 * sx / w, 2.0 * cx / w - 1.0), row(y, 2.0 * sy / h, 1.0 - 2.0 * cy / h), depth]
    }

    /// [`projection`](Self::projection) to pixels: column and row are `(X/W, Y/W)` for a perspective lens and `(X, Y)` for an
    /// orthographic one, 0 at the image's left and upper border.
    pub fn pixel_projection(&self) -> [[f64; 4]; 3] {
        let [x, y, depth] = self.projection();
        // column = (x + 1) W / 2, row = (1 - y) H / 2
        let (w, h) = (self.width as f64 / 2.0, self.height as f64 / 2.0);
        let one = if self.is_perspective() { depth } else { [0.0, 0.0, 0.0, 1.0] };
        [
            std::array::from_fn(|k| (x[k] + one[k]) * w),
            std::array::from_fn(|k| (one[k] - y[k]) * h),
            depth,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    /// A camera with nothing special about it: W != H, fx != fy, principal point off the centre.
    pub(super) fn off_center() -> Camera {
        let mut c =
            Camera::look_at([2.0, -1.0, 3.5], [0.2, 0.4, -0.1], [0.1, 1.0, 0.3], 0.9, 64, 48);
        c.lens = Lens::Perspective { fx: 71.0, fy: 66.5, cx: 29.25, cy: 26.0 };
        c
    }

    pub(super) fn assert_same(a: &Camera, b: &Camera) {
        assert_eq!((a.width, a.height), (b.width, b.height));
        assert_relative_eq!(a.rotation, b.rotation, epsilon = 1e-12);
        assert_relative_eq!(a.translation, b.translation, epsilon = 1e-10);
        let values = |lens: Lens| match lens {
            Lens::Perspective { fx, fy, cx, cy } => (true, [fx, fy, cx, cy]),
            Lens::Orthographic { sx, sy, cx, cy } => (false, [sx, sy, cx, cy]),
        };
        let ((p, a), (q, b)) = (values(a.lens), values(b.lens));
        assert_eq!(p, q);
        for (a, b) in a.into_iter().zip(b) {
            assert_relative_eq!(a, b, epsilon = 1e-10);
        }
    }
}
