//! What can be wrong with a camera.

use super::{Camera, Lens};

/// Why a camera cannot be used or written in a convention.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CameraError {
    /// A field holds a number that is not finite.
    #[error("camera {field}: expected finite numbers, found {found}")]
    NotFinite {
        /// The field.
        field: &'static str,
        /// The first such number.
        found: f64,
    },
    /// A field that must be above zero is not.
    #[error("camera {field}: expected a number above 0, found {found}")]
    NotPositive {
        /// The field.
        field: &'static str,
        /// Its value.
        found: f64,
    },
    /// The rotation has no inverse.
    #[error("camera rotation: singular (determinant {determinant:e}), expected a rotation matrix")]
    Singular {
        /// Its determinant.
        determinant: f64,
    },
    /// The rotation scales or shears.
    #[error(
        "camera rotation: not orthonormal, R R^T differs from the identity by {deviation:.3e} \
         (at most {tolerance:.0e} is allowed)"
    )]
    NotOrthonormal {
        /// Largest absolute entry of `R R^T - I`.
        deviation: f64,
        /// What is allowed.
        tolerance: f64,
    },
    /// The rotation mirrors the world.
    #[error("camera rotation: determinant {determinant:.3}, a mirror; expected +1")]
    Mirrored {
        /// Its determinant.
        determinant: f64,
    },
    /// A camera model that is not known.
    #[error(
        "camera model: found {found:?}, expected one of SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, \
         FULL_OPENCV, SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE, OPENCV_FISHEYE, FOV, \
         THIN_PRISM_FISHEYE; undistort the images of others (COLMAP: `image_undistorter`)"
    )]
    Model {
        /// The model's name.
        found: String,
    },
    /// A lens that bends rays, where a pinhole is needed.
    #[error("camera model: {model} bends rays here, expected a pinhole; undistort the image")]
    Distorted {
        /// The model's name.
        model: String,
    },
    /// A model with the wrong number of parameters.
    #[error("camera params: found {found} numbers, {model} has {expected}")]
    ParameterCount {
        /// The model's name.
        model: &'static str,
        /// How many it has.
        expected: usize,
        /// How many were given.
        found: usize,
    },
    /// Intrinsics that a plain pinhole cannot express.
    #[error("camera intrinsics: {what}")]
    Intrinsics {
        /// What is wrong.
        what: String,
    },
    /// A convention that has no way to say what this camera does.
    #[error("camera cannot be written in the {convention} convention: {what}")]
    NotRepresentable {
        /// The convention.
        convention: &'static str,
        /// What it cannot express.
        what: &'static str,
    },
}

/// How far `R R^T` may be from the identity: files keep six digits, f32 matrices seven.
const ORTHONORMAL: f64 = 1e-3;
/// Below this determinant a rotation has lost a direction.
const SINGULAR: f64 = 1e-6;

impl Camera {
    /// The numbers of a perspective lens, for conventions that know no other.
    pub(super) fn pinhole(&self, convention: &'static str) -> Result<[f64; 4], CameraError> {
        match self.lens {
            Lens::Perspective { fx, fy, cx, cy } => Ok([fx, fy, cx, cy]),
            Lens::Orthographic { .. } => {
                let what = "an orthographic lens";
                Err(CameraError::NotRepresentable { convention, what })
            }
        }
    }

    /// Checks that the camera can be used: finite numbers, a real rotation, an image, a lens.
    ///
    /// # Errors
    /// The first field that is wrong, in the order size, lens, rotation, translation.
    pub fn validate(&self) -> Result<(), CameraError> {
        for (field, size) in [("width", self.width), ("height", self.height)] {
            if size == 0 {
                return Err(CameraError::NotPositive { field, found: 0.0 });
            }
        }
        let names = if self.is_perspective() { ["fx", "fy"] } else { ["sx", "sy"] };
        let [sx, sy, cx, cy] = self.lens.numbers();
        let scales = [(names[0], sx), (names[1], sy)];
        for (field, found) in scales.into_iter().chain([("cx", cx), ("cy", cy)]) {
            finite(field, [found])?;
        }
        for (field, found) in scales {
            if found <= 0.0 {
                return Err(CameraError::NotPositive { field, found });
            }
        }
        finite("rotation", self.rotation.iter().copied())?;
        let determinant = self.rotation.determinant();
        if determinant.abs() < SINGULAR {
            return Err(CameraError::Singular { determinant });
        }
        let deviation =
            (self.rotation * self.rotation.transpose() - nalgebra::Matrix3::identity()).abs().max();
        if deviation > ORTHONORMAL {
            return Err(CameraError::NotOrthonormal { deviation, tolerance: ORTHONORMAL });
        }
        if determinant < 0.0 {
            return Err(CameraError::Mirrored { determinant });
        }
        finite("translation", self.translation.iter().copied())
    }
}

fn finite(field: &'static str, values: impl IntoIterator<Item = f64>) -> Result<(), CameraError> {
    match values.into_iter().find(|v| !v.is_finite()) {
        Some(found) => Err(CameraError::NotFinite { field, found }),
        None => Ok(()),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera::look_at([3.0, 2.0, 1.0], [0.0; 3], [0.0, 1.0, 0.0], 0.8, 40, 30)
    }

    #[test]
    fn a_good_camera_passes() {
        assert_eq!(camera().validate(), Ok(()));
    }

    #[test]
    fn each_fault_is_named() {
        let fault = |change: &dyn Fn(&mut Camera)| {
            let mut c = camera();
            change(&mut c);
            c.validate().unwrap_err().to_string()
        };
        assert!(fault(&|c| c.width = 0).contains("width"));
        assert!(fault(&|c| c.translation[1] = f64::NAN).contains("translation"));
        assert!(fault(&|c| c.rotation[(1, 1)] = f64::INFINITY).contains("rotation"));
        assert!(fault(&|c| c.rotation.fill(0.0)).contains("singular"));
        assert!(fault(&|c| c.rotation *= 1.01).contains("orthonormal"));
        assert!(fault(&|c| c.rotation *= -1.0).contains("mirror"));
        let lens = |fx, cy| Lens::Perspective { fx, fy: 1.0, cx: 0.0, cy };
        assert!(fault(&|c| c.lens = lens(-1.0, 0.0)).contains("fx"));
        assert!(fault(&|c| c.lens = lens(1.0, f64::NAN)).contains("cy"));
    }
}
