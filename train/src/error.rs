//! Why a training ends without its result.

use std::error::Error;
use std::io;
use std::path::PathBuf;
use std::sync::Arc;

use autodiff_lite::state::{LoadError, SaveError};

use super::not_finite::NotFinite;

/// What a run lacks that is not there at all.
pub(crate) const FOLDER: &str = "the folder";

/// What stopped a training.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrainError {
    /// The configuration has a value out of its range.
    #[error("configuration: {}", .0.join("; "))]
    Config(Vec<String>),
    /// The data cannot be read.
    #[error(transparent)]
    Data(#[from] DataError),
    /// A loss or gradient became NaN or infinite.
    #[error(transparent)]
    NotFinite(#[from] Box<NotFinite>),
    /// A loss has no value.
    #[error(
        "step {step} (epoch {epoch}): the loss of {samples} has no value: {error}; the last checkpoint is whole: resuming \
         comes to the same step, a run that begins `--from` it with other settings or without that sample goes on"
    )]
    Loss {
        /// Steps taken before.
        step: u64,
        /// Epochs finished before.
        epoch: u64,
        /// The sample, or all of a batch if none alone shows it.
        samples: String,
        /// Why.
        error: LossError,
    },
    /// The run's folder cannot be used.
    #[error(transparent)]
    Run(#[from] RunError),
    /// A checkpoint cannot be used.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// `best` names no metric of the system.
    #[error("`best` is \"{name}\", expected one of {}", metrics.join(", "))]
    NoSuchMetric {
        /// The name asked for.
        name: String,
        /// The names there are.
        metrics: Vec<String>,
    },
    /// Another process of the training failed.
    #[error("process {rank}: {message}")]
    Elsewhere {
        /// Its rank.
        rank: usize,
        /// What its error says.
        message: String,
    },
    /// Two processes of the training have not the same.
    #[error(
        "process {rank} has other {what} than process 0: all must run the same program, with the same options, on the same data \
         and run folder; the last checkpoint is whole"
    )]
    Apart {
        /// What differs.
        what: &'static str,
        /// The first process that has another.
        rank: usize,
    },
}

/// Why data cannot be had.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DataError {
    /// A file is missing or damaged: the reader's own error, which names it.
    #[error(transparent)]
    Read(Box<dyn Error + Send + Sync>),
    /// The data is sound and does not serve.
    #[error("{0}")]
    Unfit(String),
}

impl DataError {
    /// A reader's error, whichever reader it is: the loop knows none.
    pub fn read(error: impl Error + Send + Sync + 'static) -> Self {
        Self::Read(Box::new(error))
    }

    /// Why it does not serve, said by another error.
    pub fn unfit(why: impl std::fmt::Display) -> Self {
        Self::Unfit(why.to_string())
    }
}

/// Why a loss has no value.
#[derive(Clone, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LossError {
    /// A differential equation could not be solved.
    #[error(transparent)]
    Solve(Arc<dyn Error + Send + Sync>),
    /// None of the terms counts: there is nothing to be minimised.
    #[error("no term with a weight other than 0, of [{}]", terms.join(", "))]
    Weightless {
        /// The names of the terms.
        terms: Vec<&'static str>,
    },
}

impl LossError {
    /// A solver's error, whichever solver it is: the loop knows none.
    pub fn solve(error: impl Error + Send + Sync + 'static) -> Self {
        Self::Solve(Arc::new(error))
    }
}

/// Why a system cannot be applied to an input.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PredictError {
    /// There is nothing to predict from.
    #[error("no view: a mesh is made from at least one image")]
    NoView,
    /// The input lacks what the system needs.
    #[error("no {what}: {remedy}")]
    Missing {
        /// What it lacks.
        what: &'static str,
        /// Where it comes from.
        remedy: &'static str,
    },
    /// The input cannot be read, or has what the system cannot take.
    #[error(transparent)]
    Data(#[from] DataError),
    /// A differential equation could not be solved.
    #[error(transparent)]
    Solve(Arc<dyn Error + Send + Sync>),
}

impl PredictError {
    /// A solver's error, whichever solver it is.
    pub fn solve(error: impl Error + Send + Sync + 'static) -> Self {
        Self::Solve(Arc::new(error))
    }
}

/// Why a run's folder cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// There is something at the path already.
    #[error("{} exists already; go on with --resume, choose another folder, or allow overwriting (--force)", path.display())]
    Exists {
        /// The folder.
        path: PathBuf,
    },
    /// Another process works in the folder.
    #[error("{} is in use by {holder}; wait until it ends, or choose another folder", path.display())]
    Busy {
        /// The folder.
        path: PathBuf,
        /// Process, machine and since when, as the other noted it.
        holder: String,
    },
    /// The folder is no run, or its run wrote no checkpoint yet.
    #[error("{}: {}", path.display(), no_run(missing))]
    NoRun {
        /// The folder.
        path: PathBuf,
        /// The file that a run has, or the folder itself.
        missing: &'static str,
    },
    /// A run that is beyond its beginning lacks a file: it could only begin anew.
    #[error(
        "{}: {missing} is missing, though the run has taken steps: it cannot go on without it; put the file back from a \
         copy, or train into another folder, or into this one with --force, which removes what is left of the run",
        path.display()
    )]
    Lost {
        /// The folder.
        path: PathBuf,
        /// The file that is not there.
        missing: &'static str,
    },
    /// The data are not those that the run began with.
    #[error(
        "{}: the data are not those that the run began with: its scores would be of two sets; if they are, say again how \
         they were read (--max-size, --mask, ..); to go on from its weights with other \
         data, begin a run with --from {} and another folder",
        path.display(),
        path.display()
    )]
    OtherData {
        /// The run's folder.
        path: PathBuf,
    },
    /// The path leads to no checkpoint.
    #[error("{}: {found}, expected a run's folder with a checkpoint, or a .safetensors file", path.display())]
    NoCheckpoint {
        /// The path.
        path: PathBuf,
        /// What is there.
        found: &'static str,
    },
    /// The path leads to a folder of models that is no run's.
    #[error("{}: a folder of models and no run's, expected one of its files: {}", path.display(), listed(models))]
    Models {
        /// The path.
        path: PathBuf,
        /// The models, by their names.
        models: Vec<PathBuf>,
    },
    /// The file system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A line of the log is not one.
    #[error("{}: line {line}: {problem}", path.display())]
    Log {
        /// The file.
        path: PathBuf,
        /// Counted from 1.
        line: usize,
        /// What is wrong with it.
        problem: String,
    },
}

/// Why a folder is no run.
fn no_run(missing: &str) -> String {
    if missing == FOLDER {
        return "there is no such folder, expected that of a run".to_owned();
    }
    format!("{missing} is missing: not a run that can go on")
}

impl RunError {
    /// What the file system says of a path.
    pub(crate) fn io(path: impl Into<PathBuf>) -> impl FnOnce(io::Error) -> Self {
        let path = path.into();
        |source| Self::Io { path, source }
    }
}

/// Why a checkpoint cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CheckpointError {
    /// The file cannot be read, is damaged, or is of another model.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// The file cannot be written.
    #[error("{error}: {}", error.source)]
    Save {
        /// File and reason.
        #[from]
        error: SaveError,
    },
    /// Its bytes are not those that were written.
    #[error(
        "{}: its checksum is {found}, expected {expected}: the file was damaged after it was written; take another \
         checkpoint of the run, or a copy",
        path.display()
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The checksum of its bytes.
        found: String,
        /// The checksum that it carries.
        expected: String,
    },
    /// Its metadata lacks something or says what cannot be.
    #[error("{}: metadata `{field}` is {found}, expected {expected}", path.display())]
    Metadata {
        /// The file.
        path: PathBuf,
        /// The entry.
        field: &'static str,
        /// What it says.
        found: String,
        /// What it might say.
        expected: String,
    },
}

/// The names of files; of very many the first.
fn listed(files: &[PathBuf]) -> String {
    const MOST: usize = 12;
    let names = files.iter().take(MOST).filter_map(|file| file.file_name());
    let names: Vec<_> = names.map(|name| name.to_string_lossy()).collect();
    let more = if files.len() > MOST { ", .." } else { "" };
    format!("{}{more}", names.join(", "))
}
