//! Why a training ends without its result.

use std::io;
use std::path::PathBuf;

use autodiff_lite::state::{LoadError, SaveError};

use super::blame::NotFinite;
use super::system::DataError;

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
    /// The folder is no run, or its run wrote no checkpoint yet.
    #[error("{}: {missing} is missing: not a run that can go on", path.display())]
    NoRun {
        /// The folder.
        path: PathBuf,
        /// The file that a run has.
        missing: &'static str,
    },
    /// The path leads to no checkpoint.
    #[error("{}: {found}, expected a run's folder with a checkpoint, or a .safetensors file", path.display())]
    NoCheckpoint {
        /// The path.
        path: PathBuf,
        /// What is there.
        found: &'static str,
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
