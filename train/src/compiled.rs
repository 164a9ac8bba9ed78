//! The generic functions of a system, which its own crate compiles, once for all others.
//!
//! Rust compiles a generic function in each crate that names it with a type of its own: every program that trains a system would
//! compile the whole loop and the tape for it anew. So they are called through [pointers](Compiled) that the system's crate makes.

use std::fmt;

use crate::checkpoint::{Checkpoint, load};
use crate::communicator::{Communicator, Solo};
use crate::config::Configuration;
use crate::error::{CheckpointError, TrainError};
use crate::progress::Watch;
use crate::system::System;
use crate::trainer::{Job, Outcome, run};

type Train<S> =
    fn(&Job<'_, S>, &dyn Communicator, &mut Watch<'_>) -> Result<Outcome<S>, TrainError>;
type Load<S> =
    fn(&Checkpoint<'_>, &Configuration<<S as System>::Config>) -> Result<S, CheckpointError>;

/// The loop and the reader of checkpoints of one system.
pub struct Compiled<S: System> {
    train: Train<S>,
    load: Load<S>,
}

impl<S: System> Compiled<S> {
    /// Compiled in the crate that calls it from a function that is not generic.
    pub fn here() -> Self {
        Self { train: run::<S>, load: load::<S> }
    }
}

impl<S: System> fmt::Debug for Compiled<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Compiled({})", S::NAME)
    }
}

/// A system that can be trained and loaded: `impl Compile for Mine {}`.
pub trait Compile: System {
    /// The loop for this system. A library repeats this line in a function that is not generic and `#[inline(never)]`: the loop is
    /// then compiled with the system, and not again by every program that trains it.
    fn compiled() -> Compiled<Self> {
        Compiled::here()
    }
}

/// Trains a system, or goes on training it, and keeps everything in the run's folder.
///
/// `watch` hears of every step; once it is [cancelled](crate::progress::Cancel), a checkpoint is written after the step or the scoring that
/// goes on, and the function returns. The same configuration and data give the same parameters bit by bit, for any
/// number of threads, and whether or not the run was cancelled on the way.
///
/// # Errors
/// If an option is out of range, a file cannot be read or written, or a number becomes infinite or
/// NaN; the last checkpoint is then untouched. Where it is the scores that fail, the steps before them are saved.
pub fn train<S: Compile>(
    job: &Job<'_, S>,
    watch: &mut Watch<'_>,
) -> Result<Outcome<S>, TrainError> {
    train_among(job, &Solo, watch)
}

/// [`train`](fn@train) in several processes, which share the shards of every batch. All of them call it with the same job; the
/// bits are those of one process with as many shards, and a run goes on with any number of processes.
///
/// The first process alone writes, scores and has an [`Outcome`] with scores; the others read the folder of a run that goes on,
/// so that they must see the same files, and need no lock of it ([`RunFolder::at`](crate::RunFolder::at)). Each tells its own `watch` of the steps;
/// whichever is cancelled ends all of them after the same step.
///
/// # Errors
/// As [`train`](fn@train), wherever it happens: all processes return an error, those that did not fail
/// [`TrainError::Elsewhere`]. Also if there are more processes than shards, or two of them have not the same.
pub fn train_among<S: Compile>(
    job: &Job<'_, S>,
    communicator: &dyn Communicator,
    watch: &mut Watch<'_>,
) -> Result<Outcome<S>, TrainError> {
    (S::compiled().train)(job, communicator, watch)
}

impl Checkpoint<'_> {
    /// The trained system with its configuration, ready to predict.
    ///
    /// # Errors
    /// If it is of another system or does not fit it.
    pub fn load<S: Compile>(&self) -> Result<(S, Configuration<S::Config>), CheckpointError> {
        let config = self.config::<S>()?;
        Ok((self.load_as(&config)?, config))
    }

    /// The trained system under other options than those of the run, as long as they leave the
    /// parameters' names and shapes as they are.
    ///
    /// # Errors
    /// If it is of another system; or all parameters that are missing, left over or of another shape.
    pub fn load_as<S: Compile>(
        &self,
        config: &Configuration<S::Config>,
    ) -> Result<S, CheckpointError> {
        (S::compiled().load)(self, config)
    }
}
