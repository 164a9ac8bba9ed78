//! The one training loop, for every system.
//!
//! A [`System`] says what its model, data and losses are; [`train`](fn@train) does everything else:
//! order, shards, clipping, schedules, checkpoints, scores of validation, samples, logs and the report, all in a
//! [`RunFolder`] that says of itself how it was made.
//!
//! What is random follows from the seed and the place where it is used ([`Draw`]), never from what
//! was drawn before. So a run that was killed and resumed from its last checkpoint is, bit by bit, the
//! run that was not; and a step may be computed again, alone, to find out where a number became NaN
//! ([`NotFinite`]).
//!
//! ```
//! use train::{TrainConfig, settings};
//!
//! // The defaults, under one setting, as a command line would have it.
//! let config: TrainConfig = settings::read(None, &[("epochs".to_owned(), "3".to_owned())])?;
//! assert_eq!((config.epochs, config.seed), (3, 0));
//! assert!(config.check().is_empty());
//! # Ok::<(), settings::SettingsError>(())
//! ```
//!
//! # Adding a system
//!
//! 1. A configuration ([`options!`]) beside the model it configures: each option once, with default, range and
//!    meaning; none named like one of [`TrainConfig`]'s.
//! 2. `impl System` and `impl Compile`, whose scores are of a [`Subset`] of the data, by objects that are in no other; presets `tiny`, `small` and `paper` beside it, each published value with its source.
//! 3. `impl Predictor` (`models::predict`): from a user's files to a mesh.
//! 4. One line: `Registry::register` (`models::register`, or a program of its own, as
//!    `cli/examples/ellipsoid.rs`). Commands, help, `check --options` and `docs/options.md` follow.
//!
//! # Invariants
//!
//! - The loop prints nothing; [`progress`] says how it tells what it does, and how it is ended early, with a checkpoint.
//! - The sum of shards is taken in their order; their number is an option, never that of threads.
//! - Files appear whole or not at all, but for logs, which lose at most their last line; a checkpoint and the log up to it
//!   outlast a power cut. The table and the page are made again if it took them; sheets of samples and TensorBoard's
//!   file are not.
//! - There is a checkpoint from before the first step on, and one process at a time in a run's folder.

mod average;
mod checkpoint;
mod checkpoint_path;
mod communicator;
mod compiled;
mod config;
mod draw;
mod error;
mod fingerprint;
mod inherited;
mod log;
mod message;
mod non_finite;
mod not_finite;
mod optimizer;
pub mod output;
mod page;
pub mod path_text;
pub mod progress;
mod ranks;
mod record;
mod reduction;
pub mod report;
mod run;
pub mod settings;
mod shard;
mod share;
mod step;
mod step_info;
mod subset;
mod system;
mod tensorboard;
#[cfg(test)]
mod tests;
mod trainer;

pub use checkpoint::Checkpoint;
pub use checkpoint_path::{CheckpointPath, RunMetadata};
pub use communicator::{Communicator, Solo, first_failure};
pub use compiled::{Compile, Compiled, train, train_among};
pub use config::{CHANGEABLE, Configuration, OptimizerKind, ScheduleKind, TrainConfig};
pub use draw::Draw;
pub use error::{CheckpointError, DataError, LossError, PredictError, RunError, TrainError};
pub use fingerprint::Fingerprint;
pub use inherited::Inherited;
pub use log::Curves;
pub use not_finite::{NotFinite, Tensor};
pub use optimizer::OptimizerState;
pub use run::{Provenance, RunFolder};
pub use shard::{Shard, ShardError};
pub use step_info::StepInfo;
pub use subset::{DataSummary, Subset};
pub use system::{Better, Metric, Shown, Source, Summary, System, Term, Terms};
pub use trainer::{Job, Outcome};
