//! A run's folder, which says of itself all that made it.
//!
//! | file | what it holds |
//! |---|---|
//! | `config.toml` | every option, as resolved |
//! | `provenance.json` | version, commit, machine, threads, seed, data and its hash, the command |
//! | `metrics.jsonl` | a header, then each step and evaluation, one object a line |
//! | `metrics.csv` | the same as a table |
//! | `tensorboard/` | the same for TensorBoard |
//! | `checkpoints/last.safetensors` | where the run goes on |
//! | `checkpoints/best.safetensors` | where the chosen metric was best |
//! | `samples/` | the model above the truth, epoch by epoch |
//! | `report.html` | curves, scores and the last samples on one page |

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Serialize;

use super::error::{FOLDER, RunError};
use super::log::{Curves, History};
use crate::output::{
    LOCK, Lock, LockError, disk, is_incidental, lock_folder, present, remove_within, sweep,
    write_derived_within, write_within,
};

/// What says that a folder is a run's: the first file of a run, and the last that is removed.
const PROVENANCE: &str = "provenance.json";
const CONFIG: &str = "config.toml";
const LOG: &str = "metrics.jsonl";
const LAST: &str = "checkpoints/last.safetensors";

/// Everything in a run's folder, for those who overwrite one.
const ENTRIES: &[&str] = &[
    CONFIG,
    LOG,
    "metrics.csv",
    "tensorboard",
    "checkpoints",
    "samples",
    "report.html",
    PROVENANCE,
];

/// The folder of a run. That of a run that is made or goes on is locked for its process, until all clones are gone.
#[derive(Clone, Debug)]
pub struct RunFolder {
    path: PathBuf,
    _lock: Option<Arc<Lock>>,
}

/// Where and by what a run was made, as far as the caller knows.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Provenance {
    /// Version of the program.
    pub version: String,
    /// Commit it was built from; empty if unknown.
    pub commit: String,
    /// The processor; empty if unknown.
    pub cpu: String,
    /// Operating system and architecture.
    pub machine: String,
    /// The command as it was typed.
    pub command: String,
    /// Where the data came from.
    pub data: String,
}

impl RunFolder {
    /// Whether a new run may be made at a path; nothing is changed, but that the lock's file of a killed process goes.
    ///
    /// # Errors
    /// If something stands there and `overwrite` is false, what stands there is no run, or another process works in it. A
    /// run that was stopped before its first checkpoint is nothing.
    pub fn examine(path: &Path, overwrite: bool) -> Result<(), RunError> {
        Self::admit(path, overwrite)?;
        // Without its file there is no lock.
        if path.join(LOCK).exists() {
            Self::lock(path)?;
        }
        Ok(())
    }

    /// Whether what stands at a path may be replaced.
    fn admit(path: &Path, overwrite: bool) -> Result<(), RunError> {
        if !path.exists() {
            return Ok(());
        }
        let refused = |text| Err(RunError::io(path)(std::io::Error::other(text)));
        if !path.is_dir() {
            return refused("not a folder; choose another path");
        }
        let run = Self::at(path);
        if run.is_bare()? {
            return Ok(());
        }
        if !overwrite {
            return Err(RunError::Exists { path: path.to_owned() });
        }
        // Names like `samples` are common: they are only removed beside a run's own.
        let known = run.config().exists() || run.is_known();
        // An empty folder may be what a run left that was killed as it began.
        let holds = |name: &&str| {
            let entry = path.join(name);
            let empty = fs::read_dir(&entry).is_ok_and(|mut inside| inside.next().is_none());
            entry.exists() && !empty
        };
        if !known && ENTRIES.iter().any(holds) {
            return refused(
                "it holds files that a run would overwrite and is no run; choose another path",
            );
        }
        Ok(())
    }

    /// Makes a folder for a new run, for this process alone.
    ///
    /// # Errors
    /// As [`examine`](Self::examine), or if it cannot be written or another process works in it. Overwriting removes the
    /// files of a run and leaves others alone.
    pub fn create(path: &Path, overwrite: bool) -> Result<Self, RunError> {
        Self::admit(path, overwrite)?;
        disk::make_folders(path).map_err(RunError::io(path))?;
        let run = Self::locked(path)?;
        // Another may have been quicker.
        Self::admit(path, overwrite)?;
        remove_within(path, ENTRIES).map_err(io)?;
        let checkpoints = run.checkpoints();
        disk::make_folders(&checkpoints).map_err(RunError::io(checkpoints))?;
        Ok(run)
    }

    /// The folder of a run that can go on, for this process alone.
    ///
    /// # Errors
    /// If it is none, it has lost a file without which it cannot go on, or another process works in it.
    pub fn resume(path: &Path) -> Result<Self, RunError> {
        if !path.is_dir() {
            return Err(RunError::NoRun { path: path.to_owned(), missing: FOLDER });
        }
        let run = Self::at(path);
        let last = run.checkpoint()?.is_some();
        let begun = last || run.has_begun()?;
        for (name, file) in [(LOG, run.log()), (CONFIG, run.config())] {
            if !file.is_file() {
                let (path, missing) = (path.to_owned(), name);
                return Err(if begun {
                    RunError::Lost { path, missing }
                } else {
                    RunError::NoRun { path, missing }
                });
            }
        }
        // One that was killed before its first checkpoint goes on from its beginning.
        if !last && !run.is_known() {
            return Err(RunError::NoRun { path: path.to_owned(), missing: LAST });
        }
        Self::locked(path)
    }

    /// The folder at a path, whatever is in it.
    pub fn at(path: &Path) -> Self {
        Self { path: path.to_owned(), _lock: None }
    }

    /// The folder at a path, for this process alone, without what killed ones left unfinished.
    fn locked(path: &Path) -> Result<Self, RunError> {
        let lock = Self::lock(path)?;
        let run = Self::at(path);
        let within = [run.path.clone(), run.checkpoints(), run.path.join("samples")];
        sweep(&lock, within.iter().map(PathBuf::as_path));
        if lock.is_held() {
            run.sweep_temporaries();
        }
        Ok(Self { _lock: Some(Arc::new(lock)), ..run })
    }

    /// Takes the folder at a path for this process alone, if no other has it.
    fn lock(path: &Path) -> Result<Lock, RunError> {
        let path = path.to_owned();
        lock_folder(&path).map_err(|error| match error {
            LockError::Busy(holder) => RunError::Busy { path, holder },
            LockError::Io(source) => RunError::Io { path, source },
        })
    }

    /// Removes what earlier versions left in the folder of checkpoints, under names that were drawn.
    fn sweep_temporaries(&self) {
        for entry in fs::read_dir(self.checkpoints()).into_iter().flatten().flatten() {
            let name = entry.file_name();
            let drawn = name.to_str().and_then(|name| name.strip_prefix(".tmp"));
            let plain = |drawn: &str| drawn.bytes().all(|b| b.is_ascii_alphanumeric());
            if drawn.is_some_and(|drawn| drawn.len() == 6 && plain(drawn)) {
                // One that resists is in nobody's way.
                let _ = fs::remove_file(entry.path());
            }
        }
    }

    /// Whether its provenance is that of a run.
    fn is_known(&self) -> bool {
        let text = fs::read(self.path.join(PROVENANCE)).unwrap_or_default();
        let facts: serde_json::Value = serde_json::from_slice(&text).unwrap_or_default();
        facts["kind"] == "run"
    }

    /// Whether there is nothing, or nothing but what a run has before its first checkpoint and step.
    fn is_bare(&self) -> Result<bool, RunError> {
        let mut empty = true;
        for entry in fs::read_dir(&self.path).map_err(RunError::io(&self.path))? {
            let name = entry.map_err(RunError::io(&self.path))?.file_name();
            if is_incidental(&name) {
                continue;
            }
            if !ENTRIES.iter().any(|entry| name == *entry) {
                return Ok(false);
            }
            empty = false;
        }
        Ok(empty || (self.is_beginning() && !self.has_begun()?))
    }

    /// The checkpoint that the run goes on from; none if it stands at its beginning.
    ///
    /// # Errors
    /// If the run is beyond its beginning and has none, or the folder cannot be read.
    pub(super) fn checkpoint(&self) -> Result<Option<PathBuf>, RunError> {
        let last = self.last();
        if last.is_file() {
            return Ok(Some(last));
        }
        if self.has_begun()? {
            return Err(RunError::Lost { path: self.path.clone(), missing: LAST });
        }
        Ok(None)
    }

    /// Whether it is beyond its beginning: something is logged behind the header, or there is a checkpoint of any name.
    fn has_begun(&self) -> Result<bool, RunError> {
        let log = self.log();
        let text = present(fs::read(&log)).map_err(RunError::io(log))?;
        let logged = text.is_some_and(|text| text.split(|&byte| byte == b'\n').nth(2).is_some());
        let folder = self.checkpoints();
        let entries = present(fs::read_dir(&folder)).map_err(RunError::io(&folder))?;
        for entry in entries.into_iter().flatten() {
            if !is_incidental(&entry.map_err(RunError::io(&folder))?.file_name()) {
                return Ok(true);
            }
        }
        Ok(logged)
    }

    /// Whether what stands where provenance should is that of a run, or was about to be.
    fn is_beginning(&self) -> bool {
        let others = ENTRIES.iter().filter(|&&name| name != "checkpoints");
        self.is_known() || others.map(|name| self.path.join(name)).all(|path| !path.exists())
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// `config.toml`.
    pub fn config(&self) -> PathBuf {
        self.path.join(CONFIG)
    }

    /// `metrics.jsonl`.
    pub fn log(&self) -> PathBuf {
        self.path.join(LOG)
    }

    /// `checkpoints/last.safetensors`.
    pub fn last(&self) -> PathBuf {
        self.path.join(LAST)
    }

    /// `checkpoints/best.safetensors`.
    pub fn best(&self) -> PathBuf {
        self.checkpoints().join("best.safetensors")
    }

    /// Seconds of computing in the steps so far, of all parts of the run.
    ///
    /// # Errors
    /// If the log cannot be read.
    pub fn seconds(&self) -> Result<f64, RunError> {
        Ok(History::read(&self.log())?.seconds())
    }

    /// Losses and scores so far.
    ///
    /// # Errors
    /// If the log cannot be read.
    pub fn curves(&self) -> Result<Curves, RunError> {
        Ok(History::read(&self.log())?.curves())
    }

    fn checkpoints(&self) -> PathBuf {
        self.path.join("checkpoints")
    }

    /// Writes a file, whole or not at all, with the folders above it.
    pub(super) fn write(&self, name: &str, bytes: &[u8]) -> Result<(), RunError> {
        write_within(&self.path, name, bytes).map_err(io)
    }

    /// Writes a file that can be made again, or be done without: a power cut may take it.
    pub(super) fn write_derived(&self, name: &str, bytes: &[u8]) -> Result<(), RunError> {
        write_derived_within(&self.path, name, bytes).map_err(io)
    }
}

/// What the file system refused, and where.
fn io((path, source): (PathBuf, std::io::Error)) -> RunError {
    RunError::Io { path, source }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn runs_are_not_overwritten_by_accident() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("deep/run");
        let run = RunFolder::create(&path, false).unwrap();
        run.write("config.toml", b"").unwrap();
        fs::write(path.join("notes.txt"), "mine").unwrap();
        let busy = RunFolder::create(&path, true).unwrap_err().to_string();
        assert!(busy.contains(&format!("process {}", std::process::id())), "{busy}");
        drop(run.clone());
        assert!(matches!(RunFolder::create(&path, true), Err(RunError::Busy { .. })));
        drop(run);
        assert!(matches!(RunFolder::create(&path, false), Err(RunError::Exists { .. })));
        let error = RunFolder::resume(&path).unwrap_err().to_string();
        assert!(error.contains("metrics.jsonl"), "{error}");
        for name in ["nope", "deep/run/notes.txt"] {
            let error = RunFolder::resume(&place.path().join(name)).unwrap_err().to_string();
            assert!(error.ends_with("there is no such folder, expected that of a run"), "{error}");
            assert!(error.contains(name), "{error}");
        }
        let run = RunFolder::create(&path, true).unwrap();
        assert!(!run.config().exists() && path.join("notes.txt").exists());
        fs::write(place.path().join("file"), "").unwrap();
        assert!(RunFolder::create(&place.path().join("file"), true).is_err());
    }
}
