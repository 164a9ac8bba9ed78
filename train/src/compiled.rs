//! The generic functions of a system that its own crate compiles, once for all others.

use std::fmt;

use crate::checkpoint::{Checkpoint, load_as};
use crate::communicator::Communicator;
use crate::config::Configuration;
use crate::error::{CheckpointError, TrainError};
use crate::progress::Watch;
use crate::system::System;
use crate::trainer::{Job, Outcome, run};

type Train<S> =
    fn(&Job<'_, S>, &dyn Communicator, &mut Watch<'_>) -> Result<Outcome<S>, TrainError>;
type Load<S> =
    fn(&Checkpoint<'_>, &Configuration<<S as System>::Config>) -> Result<S, CheckpointError>;

/// The trainer and the reader of checkpoints of one system, as pointers.
///
/// Rust compiles a generic function in each crate that names it with a type of its own: without these, every program that
/// trains a system would compile the whole loop and the tape for it anew. See [`System::compiled`].
pub struct Compiled<S: System> {
    pub(crate) train: Train<S>,
    pub(crate) load: Load<S>,
}

impl<S: System> Compiled<S> {
    /// Compiled in the crate that calls it from a function that is not generic.
    pub fn here() -> Self {
        Self { train: run::<S>, load: load_as::<S> }
    }
}

impl<S: System> fmt::Debug for Compiled<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Compiled({})", S::NAME)
    }
}
