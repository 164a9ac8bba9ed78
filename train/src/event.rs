//! What a training tells while it runs.

use std::path::PathBuf;

use super::inherited::Inherited;
use super::system::Metric;

/// What happened, in the order in which it does.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Event {
    /// Everything is ready.
    Started {
        /// Trainable parameter count.
        trainable: usize,
        /// Steps of an epoch.
        steps_per_epoch: u64,
        /// Steps of the whole training.
        total: u64,
        /// Steps that an earlier part of the run took.
        done: u64,
    },
    /// A step is done.
    Step(Step),
    /// The training begins with the weights of another.
    Inherited(Inherited),
    /// A step was left out, because its loss leapt.
    Skipped {
        /// Steps done, this one included.
        step: u64,
        /// Its loss.
        loss: f64,
        /// The moving average of the losses before.
        average: f64,
    },
    /// The model of this moment was scored on what is for validation.
    Evaluated {
        /// Steps done.
        step: u64,
        /// Epochs done.
        epoch: u64,
        /// The scores.
        metrics: Vec<Metric>,
        /// Whether it is the best so far.
        best: bool,
    },
    /// A checkpoint was written.
    Saved {
        /// Steps done.
        step: u64,
        /// The file.
        path: PathBuf,
    },
    /// Something that a user should know, one sentence.
    Warned(String),
}

/// One step of a training.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// Steps done, this one included.
    pub step: u64,
    /// Steps of the whole training.
    pub total: u64,
    /// Epochs finished before it.
    pub epoch: u64,
    /// The loss: the sum of the terms.
    pub loss: f64,
    /// The parts of the loss by name, each already weighted.
    pub terms: Vec<(&'static str, f64)>,
    /// The learning rate.
    pub learning_rate: f64,
    /// Euclidean norm of all gradients, before any limit.
    pub gradient_norm: f64,
    /// How long it took.
    pub seconds: f64,
}
