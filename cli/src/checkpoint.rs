//! The checkpoint that the command line names.

use std::path::Path;

use models::predict::Predictor;
use train::settings;
use train::{Checkpoint, CheckpointPath, Configuration, RunError, RunFolder, System};

use crate::failure::Failure;

/// Finds a checkpoint; where there is none, says how one is had.
pub(crate) fn checkpoint_path<S: Predictor>(
    path: &Path,
    last: bool,
) -> Result<CheckpointPath, Failure> {
    CheckpointPath::find(path, last).map_err(|error| {
        Failure::Input(match error {
            RunError::NoCheckpoint { .. } => format!("{error}; {}", S::TRAINING),
            error => error.to_string(),
        })
    })
}

/// Why a run cannot go on as one of this system: its last checkpoint is of another.
pub(crate) fn of_another_system<S: System>(run: &RunFolder, path: &Path) -> Option<Failure> {
    let file = run.last();
    let checkpoint = Checkpoint::read(&file).ok()?;
    let name = checkpoint.system().ok().filter(|name| *name != S::NAME)?;
    let path = path.display();
    let expected = S::NAME;
    Some(Failure::Input(format!(
        "{path}: a run of {name}, expected one of {expected}: `unsphere train {name} --resume {path}` goes on with it"
    )))
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

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use models::img2mesh::Img2Mesh;

    use super::*;

    #[test]
    fn where_none_is_the_training_is_named() {
        let place = tempfile::tempdir().unwrap();
        let said = || match checkpoint_path::<Img2Mesh>(place.path(), false).unwrap_err() {
            Failure::Input(text) => text,
            other => panic!("{other:?}"),
        };
        assert!(said().contains(Img2Mesh::TRAINING), "{}", said());
        std::fs::write(place.path().join("a.safetensors"), "").unwrap();
        assert!(said().ends_with("one of its files: a.safetensors"), "{}", said());
    }
}
