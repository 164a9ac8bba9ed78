//! What the matrices of poses mean: what a layout says, and what somebody knows better.

use mesh_core::Camera;
use mesh_core::nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Axes of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CameraAxes {
    /// x right, y down, looking along +z.
    OpenCv,
    /// x right, y up, looking along -z.
    OpenGl,
}

/// From where to where a pose leads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PoseDirection {
    /// The matrix takes points of the world into the camera's frame.
    WorldToCamera,
    /// The matrix takes points of the camera's frame into the world.
    CameraToWorld,
}

/// Axes and direction of a layout's poses.
pub type Convention = (CameraAxes, PoseDirection);

impl CameraAxes {
    /// The other ones.
    #[must_use]
    pub fn other(self) -> Self {
        match self {
            Self::OpenCv => Self::OpenGl,
            Self::OpenGl => Self::OpenCv,
        }
    }

    /// `opencv` or `opengl`.
    pub fn name(self) -> &'static str {
        match self {
            Self::OpenCv => "opencv",
            Self::OpenGl => "opengl",
        }
    }

    /// What they are, in words.
    pub(crate) fn words(self) -> &'static str {
        match self {
            Self::OpenCv => "x right, y down, looking along +z",
            Self::OpenGl => "x right, y up, looking along -z",
        }
    }

    /// From the axes of [`Camera`], which are OpenGL's, to these, and back.
    fn matrix(self) -> Matrix3<f64> {
        match self {
            Self::OpenCv => Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0)),
            Self::OpenGl => Matrix3::identity(),
        }
    }
}

impl PoseDirection {
    /// The other one.
    #[must_use]
    pub fn other(self) -> Self {
        match self {
            Self::WorldToCamera => Self::CameraToWorld,
            Self::CameraToWorld => Self::WorldToCamera,
        }
    }

    /// `world-to-camera` or `camera-to-world`.
    pub fn name(self) -> &'static str {
        match self {
            Self::WorldToCamera => "world-to-camera",
            Self::CameraToWorld => "camera-to-world",
        }
    }
}

/// The camera whose file has another convention than the one that it was read with.
pub(crate) fn reread(camera: &Camera, read: Convention, meant: Convention) -> Camera {
    let own = (camera.rotation, camera.translation);
    // The matrix as it stands in the file ..
    let in_axes = turned(read.0.matrix(), own);
    let file = match read.1 {
        PoseDirection::WorldToCamera => in_axes,
        PoseDirection::CameraToWorld => inverse(in_axes),
    };
    // .. and what it is.
    let pose = match meant.1 {
        PoseDirection::WorldToCamera => file,
        PoseDirection::CameraToWorld => inverse(file),
    };
    let (rotation, translation) = turned(meant.0.matrix(), pose);
    Camera { rotation, translation, ..camera.clone() }
}

type Pose = (Matrix3<f64>, Vector3<f64>);

fn turned(axes: Matrix3<f64>, (rotation, translation): Pose) -> Pose {
    (axes * rotation, axes * translation)
}

/// Rotations only: what has no inverse was refused.
fn inverse((rotation, translation): Pose) -> Pose {
    let back = rotation.transpose();
    (back, -(back * translation))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use CameraAxes::{OpenCv, OpenGl};
    use PoseDirection::{CameraToWorld, WorldToCamera};

    use super::*;

    fn camera() -> Camera {
        Camera::look_at([1.0, 2.0, 3.0], [0.1, 0.0, -0.2], [0.0, 1.0, 0.0], 0.7, 40, 30)
    }

    fn near(a: &Camera, b: &Camera) {
        assert!((a.rotation - b.rotation).norm() < 1e-12, "{} {}", a.rotation, b.rotation);
        assert!((a.translation - b.translation).norm() < 1e-12);
    }

    /// The same camera written as every convention has it, read as another, and told so.
    #[test]
    fn whatever_was_written_is_read_back() {
        let camera = camera();
        let all = [OpenCv, OpenGl].map(|axes| [WorldToCamera, CameraToWorld].map(|p| (axes, p)));
        for written in all.concat() {
            let own = turned(written.0.matrix(), (camera.rotation, camera.translation));
            let file = if written.1 == WorldToCamera { own } else { inverse(own) };
            for read in all.concat() {
                // What a reader of the other convention makes of the file.
                let pose = if read.1 == WorldToCamera { file } else { inverse(file) };
                let (rotation, translation) = turned(read.0.matrix(), pose);
                let wrong = Camera { rotation, translation, ..camera.clone() };
                near(&reread(&wrong, read, written), &camera);
            }
        }
    }
}
