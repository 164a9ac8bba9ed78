//! How cameras or masks may be meant otherwise than they are read.

/// A supposition about how the cameras or masks of a set of views are to be read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Reading {
    /// As they are.
    AsGiven,
    /// The images are upside down.
    FlippedY,
    /// The images are mirrored.
    FlippedX,
    /// The images are turned by half.
    Turned,
    /// The cameras' axes are y down, z forward.
    OpenCvAxes,
    /// The poses go from the camera to the world.
    InversePose,
    /// Both.
    InverseOpenCvPose,
    /// The focal length is so many times what is given.
    Focal(f64),
}
