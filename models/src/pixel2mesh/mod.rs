//! Pixel2Mesh: one image to a mesh, learned from true surfaces; in stages as published, and in continuous time.
//!
//! ```text
//! image [N, S, S, 3] -> encoder -> maps of 1/4 to 1/32 of its side
//! ellipsoid [N, V, 3] in front of the camera -> where each vertex is seen, features of the maps there
//!   -> graph convolutions -> displacements        three times, from 156 to 2,466 vertices   (`pixel2mesh`)
//!   -> graph convolutions -> velocities           integrated from a random time to 1        (`ode-pixel2mesh`)
//! ```
//!
//! Features are read anew wherever the vertices then are. The losses compare with points of the true surface; see
//! [`paired`](crate::paired) for the data and the frame. In the object's own frame (`frame = "object"`) the ellipsoid lies about the
//! origin, and where a vertex is seen follows from a camera that is told, or estimated from the image by a head of its own
//! ([`viewpoint`](mod@crate::viewpoint)).
//!
//! # References
//! Wang et al. 2018, *Pixel2Mesh: Generating 3D Mesh Models from Single RGB Images*; the paper on neural ODEs for Pixel2Mesh.

mod camera;
mod config;
mod continuous;
mod decay;
mod deformer;
mod framing;
mod mesh_pairs;
#[cfg(test)]
mod object_frame_tests;
mod onnx;
mod predictor;
mod projection;
#[cfg(test)]
mod published_tests;
mod score;
mod single_view;
mod stage_terms;
mod staged;
mod sums;
mod template;
#[cfg(test)]
mod tests;

pub use camera::{Estimate, Seen};
pub use config::{
    CameraSource, DeformationKind, EncoderForm, GraphInit, Method, OdeConfig, SharedConfig,
    StagesConfig,
};
pub use continuous::Continuous;
pub use deformer::{Deformed, Deformer, Run, Stage};
pub use score::Scored;
pub use single_view::SingleView;
pub use staged::Staged;
pub use template::{Level, Template};

/// The deformation in continuous time, and the residual networks that it is compared with.
pub type OdePixel2Mesh = SingleView<Continuous>;
/// Pixel2Mesh in stages.
pub type Pixel2Mesh = SingleView<Staged>;
