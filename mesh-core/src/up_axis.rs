//! Which way is up: tools and data sets do not agree, and shapes lie on their back where it is not asked.

use std::fmt;
use std::str::FromStr;

use nalgebra::Vector3;

use crate::{Camera, TriMesh};

/// The axis of a world that points up.
///
/// ```
/// use mesh_core::UpAxis;
///
/// assert_eq!("z".parse(), Ok(UpAxis::Z));
/// assert_eq!(UpAxis::Z.upright([1.0, 2.0, 3.0]), [1.0, 3.0, -2.0]); // what was up is +Y
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum UpAxis {
    /// +X.
    X,
    /// -X.
    MinusX,
    /// +Y: glTF, and this crate.
    #[default]
    Y,
    /// -Y: a world that began as an OpenCV camera, as COLMAP's often do.
    MinusY,
    /// +Z: Blender, NeRF, printers.
    Z,
    /// -Z.
    MinusZ,
}

impl UpAxis {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::X, Self::MinusX, Self::Y, Self::MinusY, Self::Z, Self::MinusZ];

    /// `x`, `-x`, `y`, `-y`, `z` or `-z`.
    pub fn name(self) -> &'static str {
        match self {
            Self::X => "x",
            Self::MinusX => "-x",
            Self::Y => "y",
            Self::MinusY => "-y",
            Self::Z => "z",
            Self::MinusZ => "-z",
        }
    }

    /// The axis nearest to what is up in the images of these cameras, on average; [`Y`](Self::Y) where they do not agree.
    ///
    /// People hold cameras upright: what their images' tops have in common is up, from wherever they look.
    pub fn of_cameras<'a>(cameras: impl IntoIterator<Item = &'a Camera>) -> Self {
        /// Of a length of 1 where all agree.
        const LEAST: f64 = 0.2;
        let (sum, count) = cameras.into_iter().fold((Vector3::zeros(), 0.0), |(sum, n), camera| {
            let up: Vector3<f64> = camera.rotation.row(1).transpose();
            (sum + up, n + 1.0)
        });
        let mean = sum / f64::max(count, 1.0);
        // What is not a number is not long enough.
        let agree = mean.norm() >= LEAST;
        if !agree {
            return Self::Y;
        }
        let along = |axis: Self| mean.dot(&axis.vector());
        // Of equals the first that everybody means.
        let order = [Self::Y, Self::Z, Self::MinusY, Self::MinusZ, Self::X, Self::MinusX];
        order
            .into_iter()
            .fold(Self::Y, |best, axis| if along(axis) > along(best) { axis } else { best })
    }

    fn vector(self) -> Vector3<f64> {
        match self {
            Self::X => Vector3::x(),
            Self::MinusX => -Vector3::x(),
            Self::Y => Vector3::y(),
            Self::MinusY => -Vector3::y(),
            Self::Z => Vector3::z(),
            Self::MinusZ => -Vector3::z(),
        }
    }

    /// A point of the world turned so that this axis becomes +Y: exact, no number is rounded.
    pub fn upright(self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        match self {
            Self::X => [-y, x, z],
            Self::MinusX => [y, -x, z],
            Self::Y => [x, y, z],
            Self::MinusY => [x, -y, -z],
            Self::Z => [x, z, -y],
            Self::MinusZ => [x, -z, y],
        }
    }

    /// The way back: a point of a world with +Y up, turned so that this axis is up.
    pub fn laid(self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        match self {
            Self::X => [y, -x, z],
            Self::MinusX => [-y, x, z],
            Self::Y => [x, y, z],
            Self::MinusY => [x, -y, -z],
            Self::Z => [x, -z, y],
            Self::MinusZ => [x, z, -y],
        }
    }

    /// [`upright`](Self::upright) as a matrix, by columns, as glTF has it.
    #[cfg(any(test, feature = "files"))]
    pub(crate) fn columns(self) -> [[f32; 3]; 3] {
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|axis| self.upright(axis))
    }
}

impl TriMesh {
    /// The mesh turned so that this axis becomes +Y.
    #[must_use]
    pub fn upright(self, up: UpAxis) -> Self {
        if up == UpAxis::Y { self } else { self.map_positions(|p| up.upright(p)) }
    }

    /// The mesh of a world with +Y up, turned so that this axis is up: the way back from [`upright`](Self::upright).
    #[must_use]
    pub fn laid(self, up: UpAxis) -> Self {
        if up == UpAxis::Y { self } else { self.map_positions(|p| up.laid(p)) }
    }
}

/// `+Z`, as people write it.
impl fmt::Display for UpAxis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (sign, axis) = match self.name().strip_prefix('-') {
            Some(axis) => ('-', axis),
            None => ('+', self.name()),
        };
        write!(f, "{sign}{}", axis.to_uppercase())
    }
}

/// A text that names no axis.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("found {0:?}, expected x, -x, y, -y, z or -z")]
pub struct UpAxisError(String);

impl FromStr for UpAxis {
    type Err = UpAxisError;

    fn from_str(text: &str) -> Result<Self, UpAxisError> {
        let found = Self::ALL.into_iter().find(|axis| axis.name() == text);
        found.ok_or_else(|| UpAxisError(text.chars().take(20).collect()))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use nalgebra::Matrix3;

    use super::*;

    #[test]
    fn what_is_up_becomes_y_by_a_rotation() {
        for axis in UpAxis::ALL {
            let up = axis.vector();
            let turned = axis.upright([up.x as f32, up.y as f32, up.z as f32]);
            assert_eq!(turned.map(f32::abs), [0.0, 1.0, 0.0], "{axis}");
            assert_eq!(turned[1], 1.0, "{axis}");
            let columns = axis.columns().map(|c| Vector3::from(c).cast::<f64>());
            assert_eq!(Matrix3::from_columns(&columns).determinant(), 1.0, "{axis}");
            assert_eq!(axis.name().parse(), Ok(axis));
            assert_eq!(axis.to_string().to_lowercase().trim_start_matches('+'), axis.name());
            assert_eq!(axis.laid(axis.upright([1.0, 2.0, 3.0])), [1.0, 2.0, 3.0]);
        }
        assert!("up".parse::<UpAxis>().unwrap_err().to_string().contains("-z"));
    }

    #[test]
    fn cameras_say_which_way_is_up() {
        // Around the axis, from below and from far above.
        let around = |axis: UpAxis, elevation: f64| -> Vec<Camera> {
            let up = axis.vector();
            let side = if up.x == 0.0 { Vector3::x() } else { Vector3::y() };
            let other = up.cross(&side);
            let eye = |k: i32| {
                let (sin, cos) = (f64::from(k) * 0.9).sin_cos();
                let (rise, along) = elevation.sin_cos();
                let eye = 3.0 * (along * (side * cos + other * sin) + up * rise);
                Camera::look_at(eye.into(), [0.0; 3], up.into(), 0.7, 8, 8)
            };
            (0..7).map(eye).collect()
        };
        for axis in UpAxis::ALL {
            for elevation in [-0.4, 0.2, 1.2] {
                assert_eq!(UpAxis::of_cameras(&around(axis, elevation)), axis, "{elevation}");
            }
        }
        assert_eq!(UpAxis::of_cameras(&[]), UpAxis::Y);
        // Straight from above the tops of the images point all around.
        assert_eq!(UpAxis::of_cameras(&around(UpAxis::Z, 1.5)), UpAxis::Y);
    }
}
