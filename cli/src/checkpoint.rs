//! The checkpoint that the command line names.

use std::path::Path;

use models::predict::Predictor;
use train::settings;
use train::{Checkpoint, CheckpointPath, Configuration, System};

use crate::failure::Failure;

/// Finds a checkpoint; where there is none, says how one is had.
pub(crate) fn checkpoint_path<S: Predictor>(
    path: &Path,
    last: bool,
) -> Result<CheckpointPath, Failure> {
    CheckpointPath::find(path, last)
        .map_err(|error| Failure::Input(format!("{error}; {}", S::TRAINING)))
}

/// The configuration of a checkpoint under single settings, checked.
pub(crate) fn configuration<S: System>(
    checkpoint: &Checkpoint<'_>,
    set: &[(String, String)],
    seed: Option<u64>,
) -> Result<Configuration<S::Config>, Failure> {
    let config = checkpoint.config::<S>().map_err(Failure::input)?;
    let text = settings::to_toml(&config);
    let mut config: Configuration<S::Config> =
        settings::read_text(Path::new("the run's configuration"), &text, set)?;
    if let Some(seed) = seed {
        config.train.seed = seed;
    }
    let problems = S::problems(&config);
    if problems.is_empty() { Ok(config) } else { Err(Failure::Usage(problems.join("; "))) }
}
