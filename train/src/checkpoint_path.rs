//! Where a user's checkpoint is: a file, or one of a run's folder.

use std::fs;
use std::path::{Path, PathBuf};

use super::error::RunError;
use super::run::RunFolder;

/// A checkpoint that was found, and the run it belongs to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CheckpointPath {
    /// The file.
    pub file: PathBuf,
    /// The folder of its run; none where the file stands alone.
    pub run: Option<PathBuf>,
}

/// What a run's folder notes about its data.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RunMetadata {
    /// Where the data was; none where the system made its own.
    pub data: Option<PathBuf>,
    /// Its fingerprint, in hexadecimal digits.
    pub data_hash: Option<String>,
    /// The command that began it.
    pub command: Option<String>,
    /// The commit of the program that began it.
    pub commit: Option<String>,
    /// The processor.
    pub cpu: Option<String>,
}

impl CheckpointPath {
    /// Finds the checkpoint at a path: the file itself; or of a run's folder, or of its `checkpoints`, the best, if there is
    /// one and the last is not asked for, else the last.
    ///
    /// # Errors
    /// If there is none.
    pub fn find(path: &Path, last: bool) -> Result<Self, RunError> {
        if path.is_file() {
            return Ok(Self::of(path));
        }
        let none = |found| Err(RunError::NoCheckpoint { path: path.to_owned(), found });
        if !path.is_dir() {
            return none("nothing is there");
        }
        let folder = RunFolder::at(path);
        let choice = if last { vec![folder.last()] } else { vec![folder.best(), folder.last()] };
        if let Some(file) = choice.iter().find(|file| file.is_file()) {
            return Ok(Self { file: file.clone(), run: Some(path.to_owned()) });
        }
        let models = models_in(path);
        let mut names = choice.iter().filter_map(|file| file.file_name());
        let here = names.find_map(|name| models.iter().find(|m| m.file_name() == Some(name)));
        match here {
            Some(file) => Ok(Self::of(file)),
            None if models.is_empty() => none("a folder without one"),
            None => Err(RunError::Models { path: path.to_owned(), models }),
        }
    }

    /// A file, with the run in whose `checkpoints` it lies.
    fn of(file: &Path) -> Self {
        let folder = file.parent().filter(|f| f.file_name().is_some_and(|n| n == "checkpoints"));
        let run = folder.and_then(Path::parent).map(|run| {
            if run.as_os_str().is_empty() { PathBuf::from(".") } else { run.to_owned() }
        });
        Self { file: file.to_owned(), run }
    }
}

/// The models that lie in a folder itself, by their names.
fn models_in(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let paths = entries.filter_map(|entry| Some(entry.ok()?.path()));
    let is_model = |path: &PathBuf| {
        path.extension().is_some_and(|extension| extension == "safetensors") && path.is_file()
    };
    let mut models: Vec<PathBuf> = paths.filter(is_model).collect();
    models.sort();
    models
}

impl RunMetadata {
    /// What a run's folder notes; nothing where it cannot be read.
    pub fn of(run: &Path) -> Self {
        let text = fs::read_to_string(run.join("provenance.json")).unwrap_or_default();
        let facts: serde_json::Value = serde_json::from_str(&text).unwrap_or_default();
        let text = |name: &str| facts[name].as_str().filter(|t| !t.is_empty()).map(str::to_owned);
        Self {
            data: text("data").map(PathBuf::from),
            data_hash: text("data_hash"),
            command: text("command"),
            commit: text("commit"),
            cpu: text("cpu"),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn the_best_is_found_before_the_last() {
        let place = tempfile::tempdir().unwrap();
        let run = place.path().join("run");
        let error = CheckpointPath::find(&run, false).unwrap_err().to_string();
        assert!(error.contains("nothing is there"), "{error}");
        RunFolder::create(&run, false).unwrap();
        assert!(CheckpointPath::find(&run, false).is_err());
        let [best, last] =
            ["best", "last"].map(|k| run.join(format!("checkpoints/{k}.safetensors")));
        fs::write(&last, "").unwrap();
        assert_eq!(CheckpointPath::find(&run, false).unwrap().file, last);
        fs::write(&best, "").unwrap();
        assert_eq!(CheckpointPath::find(&run, false).unwrap().file, best);
        assert_eq!(CheckpointPath::find(&run, true).unwrap().file, last);
        assert_eq!(
            CheckpointPath::find(&best, true).unwrap(),
            CheckpointPath { file: best.clone(), run: Some(run.clone()) }
        );
        let checkpoints = run.join("checkpoints");
        assert_eq!(CheckpointPath::find(&checkpoints, false).unwrap().file, best);
        let found = CheckpointPath::find(&checkpoints, true).unwrap();
        assert_eq!(found, CheckpointPath { file: last, run: Some(run.clone()) });

        let models = place.path().join("models");
        fs::create_dir(&models).unwrap();
        for name in ["b.safetensors", "a.safetensors", "notes.txt"] {
            fs::write(models.join(name), "").unwrap();
        }
        let error = CheckpointPath::find(&models, false).unwrap_err().to_string();
        assert!(error.ends_with("a.safetensors, b.safetensors"), "{error}");

        let alone = place.path().join("model.safetensors");
        fs::write(&alone, "").unwrap();
        assert_eq!(CheckpointPath::find(&alone, false).unwrap().run, None);

        assert_eq!(RunMetadata::of(&run), RunMetadata::default());
        let facts = r#"{"data": "", "data_hash": "0a", "commit": "1e18b24"}"#;
        fs::write(run.join("provenance.json"), facts).unwrap();
        let [data_hash, commit] = ["0a", "1e18b24"].map(|text| Some(text.to_owned()));
        let noted = RunMetadata { data_hash, commit, ..RunMetadata::default() };
        assert_eq!(RunMetadata::of(&run), noted);
    }
}
