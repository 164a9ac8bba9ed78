//! What the matrices of poses mean: what a layout says, and what somebody knows better.

use mesh_core::nalgebra::{Matrix3, Vector3};
use mesh_core::{Camera, Lens};
use serde::{Deserialize, Serialize};

use crate::options::ReadOptions;
use crate::view::Layout;

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

impl Layout {
    /// What the layout's poses are; nothing where it has angles, or matrices that are no poses.
    pub fn convention(self) -> Option<Convention> {
        use CameraAxes::{OpenCv, OpenGl};
        use PoseDirection::{CameraToWorld, WorldToCamera};
        match self {
            Self::Transforms => Some((OpenGl, CameraToWorld)),
            Self::KaolinFolder | Self::KaolinZip | Self::Photos => Some((OpenGl, WorldToCamera)),
            Self::Colmap | Self::Bop | Self::Middlebury => Some((OpenCv, WorldToCamera)),
            _ => None,
        }
    }
}

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

/// The camera as the options say that it is meant, where it was read as the layout has it.
pub(crate) fn meant(camera: Camera, layout: Layout, options: &ReadOptions) -> Camera {
    let mut camera = camera;
    if let (Some(factor), Lens::Perspective { fx, fy, .. }) =
        (options.focal_scale, &mut camera.lens)
    {
        *fx *= factor;
        *fy *= factor;
    }
    match layout.convention() {
        Some(said) => {
            let known = (options.axes.unwrap_or(said.0), options.poses.unwrap_or(said.1));
            if known == said { camera } else { reread(&camera, said, known) }
        }
        None => camera,
    }
}

/// The camera whose file has another convention than the one that it was read with.
fn reread(camera: &Camera, read: Convention, meant: Convention) -> Camera {
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

    #[test]
    fn options_say_what_the_layout_does_not() {
        let plain = ReadOptions::default();
        near(&meant(camera(), Layout::Colmap, &plain), &camera());
        let said = ReadOptions { axes: Some(OpenCv), focal_scale: Some(2.0), ..plain.clone() };
        let found = meant(camera(), Layout::Transforms, &said);
        // NeRF's axes are OpenGL's: told otherwise the camera looks the other way.
        assert_eq!(
            found.project([0.1, 0.0, -0.2]).depth,
            -camera().project([0.1, 0.0, -0.2]).depth
        );
        let (Lens::Perspective { fx, .. }, Lens::Perspective { fx: twice, .. }) =
            (camera().lens, found.lens)
        else {
            panic!("a perspective");
        };
        assert_eq!(twice, 2.0 * fx);
        near(
            &meant(camera(), Layout::Colmap, &ReadOptions { axes: Some(OpenCv), ..plain }),
            &camera(),
        );
    }
}
