//! How the matrices of poses were read, and the options that read them otherwise.

use datasets::{CameraAxes, Convention, Layout, ReadOptions};

use super::reading::Reading;

/// What poses were taken for, and what their layout takes them for.
#[derive(Clone, Copy, Debug)]
pub(super) struct PosesRead {
    taken_for: Convention,
    layout: Convention,
}

impl PosesRead {
    /// Nothing where the layout has no poses that may be read otherwise.
    pub(super) fn of(layout: Layout, options: &ReadOptions) -> Option<Self> {
        let layout = layout.convention()?;
        let taken_for = (options.axes.unwrap_or(layout.0), options.poses.unwrap_or(layout.1));
        Some(Self { taken_for, layout })
    }

    /// The options that read the files so. What is the same but for a turn of the world is as good.
    pub(super) fn remedy(self, reading: Reading) -> Option<String> {
        let (axes, poses) = self.taken_for;
        // An inverse leaves the file's axes on the side of the world, where they do not matter.
        let by_axes = match reading {
            Reading::OpenCvAxes => true,
            Reading::InversePose => axes == CameraAxes::OpenCv,
            Reading::InverseOpenCvPose => axes == CameraAxes::OpenGl,
            _ => return None,
        };
        let by_poses = !matches!(reading, Reading::OpenCvAxes);
        let meant = (
            if by_axes { axes.other() } else { axes },
            if by_poses { poses.other() } else { poses },
        );
        let changed = [
            by_axes.then(|| option("--axes", meant.0.name(), meant.0 == self.layout.0)),
            by_poses.then(|| option("--poses", meant.1.name(), meant.1 == self.layout.1)),
        ];
        Some(changed.into_iter().flatten().collect::<Vec<_>>().join(" "))
    }
}

/// What axes look like, and what was expected.
pub(super) fn of_axes(poses: Option<PosesRead>) -> String {
    let words = |axes| match axes {
        CameraAxes::OpenCv => "OpenCV's (y down, z forward)",
        CameraAxes::OpenGl => "OpenGL's (y up, looking along -z)",
    };
    let expected = poses.map_or(CameraAxes::OpenGl, |poses| poses.taken_for.0);
    let like = expected.other();
    format!(": their axes look like {} where {} were expected", words(like), words(expected))
}

/// An option that reads files so; where it is what their layout has, somebody said otherwise.
fn option(name: &str, value: &str, is_own: bool) -> String {
    if is_own {
        format!("{name} {value}, which is the layout's own: leave {name} away")
    } else {
        format!("{name} {value}")
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use datasets::PoseDirection::WorldToCamera;

    use super::*;

    #[test]
    fn remedies_are_relative_to_what_was_given() {
        let read = |axes, poses| {
            let options = ReadOptions { axes, poses, ..ReadOptions::default() };
            PosesRead::of(Layout::Transforms, &options).unwrap()
        };
        let remedy = |axes, poses, reading| read(axes, poses).remedy(reading).unwrap();
        let (opencv, inverse) = (Some(CameraAxes::OpenCv), Some(WorldToCamera));
        assert_eq!(remedy(None, None, Reading::OpenCvAxes), "--axes opencv");
        assert_eq!(remedy(None, None, Reading::InversePose), "--poses world-to-camera");
        let both = remedy(None, None, Reading::InverseOpenCvPose);
        assert_eq!(both, "--axes opencv --poses world-to-camera");
        let back = remedy(opencv, None, Reading::OpenCvAxes);
        assert_eq!(back, "--axes opengl, which is the layout's own: leave --axes away");
        let back = remedy(None, inverse, Reading::InversePose);
        assert_eq!(back, "--poses camera-to-world, which is the layout's own: leave --poses away");
        assert_eq!(read(None, None).remedy(Reading::FlippedX), None);
        assert!(PosesRead::of(Layout::R2n2, &ReadOptions::default()).is_none());
    }

    #[test]
    fn axes_are_called_by_what_was_expected() {
        let read = |layout, axes| {
            let options = ReadOptions { axes, ..ReadOptions::default() };
            of_axes(PosesRead::of(layout, &options))
        };
        for (layout, axes) in
            [(Layout::Transforms, Some(CameraAxes::OpenCv)), (Layout::Colmap, None)]
        {
            assert!(read(layout, axes).starts_with(": their axes look like OpenGL's"));
        }
        assert!(read(Layout::Transforms, None).starts_with(": their axes look like OpenCV's"));
        assert_eq!(of_axes(None), read(Layout::Transforms, None));
    }
}
