//! What a fit tells while it runs.

use super::placement::Placement;

/// What happened, in the order in which it does.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Event {
    /// Views are measured and the sphere is placed.
    Started {
        /// Views that the mesh is fitted to.
        train: usize,
        /// Views that are held out.
        held_out: usize,
        /// The most steps that will be taken.
        total: usize,
        /// Where the sphere is.
        placement: Placement,
    },
    /// A stage begins.
    Stage {
        /// Its name: `level 3` and so on, `polish`, `color`.
        name: String,
        /// Vertices of the mesh.
        vertices: usize,
        /// Faces of the mesh.
        faces: usize,
    },
    /// A step is done.
    Step(Step),
    /// The mesh of this moment was scored on the held-out views (on all where none is held out).
    Evaluated {
        /// Steps done.
        step: usize,
        /// Mean mask IoU.
        mask_iou: f64,
    },
    /// Something that a user should know, one sentence.
    Warned(String),
}

/// One step of a fit.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// Steps done, this one included.
    pub step: usize,
    /// The most steps that will be taken.
    pub total: usize,
    /// The losses by name, each already weighted.
    pub terms: Vec<(&'static str, f64)>,
}
