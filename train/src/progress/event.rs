//! What a long job tells while it runs.

use std::path::PathBuf;

use serde::{Serialize, Serializer};

use super::{Communication, Ended, Facts};
use crate::inherited::Inherited;
use crate::system::Metric;

/// What happened, in the order in which it does.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "event", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Event {
    /// Everything is ready.
    Started {
        /// What is done: `fit`, `train`, `generate`, `reproduce`.
        job: &'static str,
        /// Steps, views or jobs of all of it; of a fit the most that there can be.
        total: u64,
        /// Those that were done before.
        done: u64,
        /// What else there is to say: of a fit `views`, `held_out`, `center_x`, `center_y`, `center_z` and `radius` of the place where
        /// the object is sought; of a training `trainable` (numbers) and `steps_per_epoch`; of a dataset `objects`.
        facts: Facts,
    },
    /// A stage begins.
    Stage {
        /// Its name: of a fit `level 3` and so on, `color`, `texture`.
        name: String,
        /// What there is to say of it: of a fit's mesh `vertices` and `faces`.
        facts: Facts,
    },
    /// So much of the work is done, where no loss is stepped down.
    Progress {
        /// How much.
        done: u64,
        /// Of how much.
        total: u64,
        /// What is going on; may be empty.
        text: String,
    },
    /// A step is done.
    Step(Step),
    /// A training begins with the weights of another.
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
    /// What there is by now was scored: a model on what is for validation, a mesh on the views that are held out (on all where none is).
    Evaluated {
        /// Steps done.
        step: u64,
        /// Epochs done, where there are any.
        #[serde(skip_serializing_if = "Option::is_none")]
        epoch: Option<u64>,
        /// The scores.
        #[serde(serialize_with = "values")]
        metrics: Vec<Metric>,
        /// Whether it is the best so far, where the best is kept.
        #[serde(skip_serializing_if = "Option::is_none")]
        best: Option<bool>,
    },
    /// A checkpoint was written.
    Saved {
        /// Steps done.
        step: u64,
        /// The file.
        #[serde(serialize_with = "crate::path_text::serialize")]
        path: PathBuf,
    },
    /// Something that a user should know.
    Warned {
        /// One sentence.
        text: String,
    },
    /// What a job told that is a part of this one: of a study, of a list of objects.
    Within {
        /// Its name.
        job: String,
        /// Its seed, where it has one of its own.
        #[serde(skip_serializing_if = "Option::is_none")]
        seed: Option<u64>,
        /// What it told.
        told: Box<Event>,
    },
    /// The end, if nothing failed.
    Finished {
        /// Whether all is done.
        ended: Ended,
        /// Steps, views or jobs done, those before included.
        done: u64,
        /// How long it took.
        seconds: f64,
    },
}

/// One step of what steps a loss down.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Step {
    /// Steps done, this one included.
    pub step: u64,
    /// Steps of the whole, or the most that will be taken.
    pub total: u64,
    /// The loss: the sum of the terms.
    pub loss: f64,
    /// The parts of the loss by name, each already weighted.
    #[serde(serialize_with = "terms")]
    pub terms: Vec<(&'static str, f64)>,
    /// What a step of a training has besides.
    #[serde(flatten)]
    pub training: Option<TrainingStep>,
}

impl Step {
    /// A step whose loss is the sum of its terms.
    pub fn of(step: u64, total: u64, terms: Vec<(&'static str, f64)>) -> Self {
        let loss = terms.iter().map(|(_, value)| value).sum();
        Self { step, total, loss, terms, training: None }
    }
}

/// What a step of a training has besides its loss.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TrainingStep {
    /// Epochs finished before it.
    pub epoch: u64,
    /// The learning rate.
    pub learning_rate: f64,
    /// Euclidean norm of all gradients, before any limit.
    pub gradient_norm: f64,
    /// How long it took.
    pub seconds: f64,
    /// What it cost to be several processes, where they are.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub communication: Option<Communication>,
}

/// Terms by name.
fn terms<S: Serializer>(terms: &[(&'static str, f64)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(terms.iter().map(|(name, value)| (name, value)))
}

/// Scores by name; those of single objects stay in memory.
fn values<S: Serializer>(metrics: &[Metric], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(metrics.iter().map(|metric| (&metric.name, metric.value)))
}

#[cfg(test)]
mod tests;
