//! The checkpoint that the command line names.

use std::path::{Path, PathBuf};

use models::predict::Predictor;
use train::settings;
use train::{Checkpoint, CheckpointPath, Configuration, RunFolder, System};

use crate::failure::Failure;

/// Finds a checkpoint; where there is none, says how one is had.
pub(crate) fn checkpoint_path<S: Predictor>(
    path: &Path,
    last: bool,
) -> Result<CheckpointPath, Failure> {
    CheckpointPath::find(path, last).or_else(|error| {
        let models = models_in(path);
        let chosen = if last { &["last"][..] } else { &["best", "last"] };
        let is = |model: &&PathBuf, name: &str| model.file_stem().is_some_and(|stem| stem == name);
        let found = chosen.iter().find_map(|name| models.iter().find(|model| is(model, name)));
        if let Some(file) = found.and_then(|file| CheckpointPath::find(file, last).ok()) {
            return Ok(file);
        }
        Err(Failure::Input(match models.as_slice() {
            [] => format!("{error}; {}", S::TRAINING),
            models => named(path, models),
        }))
    })
}

/// The models that lie in a folder itself, as in a run's `checkpoints`, by their names.
fn models_in(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let paths = entries.filter_map(|entry| Some(entry.ok()?.path()));
    let is_model = |path: &PathBuf| {
        path.extension().is_some_and(|extension| extension == "safetensors") && path.is_file()
    };
    let mut models: Vec<PathBuf> = paths.filter(is_model).collect();
    models.sort();
    models
}

/// What is said of a folder of models, none of which is a run's best or last.
fn named(folder: &Path, models: &[PathBuf]) -> String {
    /// Names listed; more are not read.
    const MOST: usize = 12;
    let names = models.iter().take(MOST).filter_map(|model| model.file_name());
    let names: Vec<_> = names.map(|name| name.to_string_lossy()).collect();
    let more = if models.len() > MOST { ", .." } else { "" };
    format!(
        "{}: a folder of models and no run's, expected one of its files: {}{more}",
        folder.display(),
        names.join(", ")
    )
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
    fn a_folder_of_checkpoints_is_as_good_as_its_run() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("run/checkpoints");
        std::fs::create_dir_all(&folder).unwrap();
        let find = |last| checkpoint_path::<Img2Mesh>(&folder, last);
        let said = |last| match find(last).unwrap_err() {
            Failure::Input(text) => text,
            other => panic!("{other:?}"),
        };
        assert!(said(false).contains(Img2Mesh::TRAINING), "{}", said(false));
        for name in ["b.safetensors", "a.safetensors", "notes.txt"] {
            std::fs::write(folder.join(name), "").unwrap();
        }
        assert!(said(false).ends_with("a.safetensors, b.safetensors"), "{}", said(false));
        let [best, last] = ["best", "last"].map(|k| folder.join(format!("{k}.safetensors")));
        std::fs::write(&last, "").unwrap();
        assert_eq!(find(false).unwrap().file, last);
        std::fs::write(&best, "").unwrap();
        assert_eq!(find(false).unwrap().file, best);
        let found = find(true).unwrap();
        assert_eq!((found.file, found.run), (last, Some(place.path().join("run"))));
    }
}
