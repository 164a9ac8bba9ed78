//! Cameras: where the world lands in an image.

use nalgebra::{Matrix3, Vector3};

/// A camera: pose, lens and image size.
///
/// Axes are OpenGL's: x right, y up, looking along -z. A world point `p` is at
/// `rotation * p + translation` in the camera's frame.
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

impl Camera {
    /// The rows X, Y, W of the projection, each applied to `(x, y, z, 1)` of a world point.
    ///
    /// Planar depth is `W`, positive in front. Normalised device coordinates are `(X/W, Y/W)` for
    /// a perspective lens and `(X, Y)` for an orthographic one.
    pub fn projection(&self) -> [[f64; 4]; 3] {
        let (w, h) = (self.width as f64, self.height as f64);
        let camera_row = |k: usize| {
            [
                self.rotation[(k, 0)],
                self.rotation[(k, 1)],
                self.rotation[(k, 2)],
                self.translation[k],
            ]
        };
        let (x, y, z) = (camera_row(0), camera_row(1), camera_row(2));
        let depth = z.map(|v| -v);
        let row = |axis: [f64; 4], gain: f64, offset: f64, perspective: bool| {
            let mut r: [f64; 4] = std::array::from_fn(|k| gain * axis[k]);
            if perspective {
                for k in 0..4 {
                    r[k] += offset * depth[k];
                }
            } else {
                r[3] += offset;
            }
            r
        };
        match self.lens {
            Lens::Perspective { fx, fy, cx, cy } => [
                row(x, 2.0 * fx / w, 2.0 * cx / w - 1.0, true),
                row(y, 2.0 * fy / h, 1.0 - 2.0 * cy / h, true),
                depth,
            ],
            Lens::Orthographic { sx, sy, cx, cy } => [
                row(x, 2.0 * sx / w, 2.0 * cx / w - 1.0, false),
                row(y, 2.0 * sy / h, 1.0 - 2.0 * cy / h, false),
                depth,
            ],
        }
    }
}
