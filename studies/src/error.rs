//! Why a table is not made.

use std::path::PathBuf;

use train::{CheckpointError, DataError, RunError, TrainError};

/// Why a job gives no rows.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StudyError {
    /// It was cancelled; what it has is kept in its folder.
    #[error("cancelled")]
    Cancelled,
    /// The training failed.
    #[error(transparent)]
    Train(Box<TrainError>),
    /// The data cannot be had.
    #[error(transparent)]
    Data(Box<DataError>),
    /// The folder of its training cannot be used.
    #[error(transparent)]
    Run(#[from] RunError),
    /// Its checkpoint cannot be used.
    #[error(transparent)]
    Checkpoint(Box<CheckpointError>),
    /// Anything else, in one sentence.
    #[error("{0}")]
    Other(String),
}

impl From<TrainError> for StudyError {
    fn from(error: TrainError) -> Self {
        Self::Train(Box::new(error))
    }
}

impl From<DataError> for StudyError {
    fn from(error: DataError) -> Self {
        Self::Data(Box::new(error))
    }
}

impl From<CheckpointError> for StudyError {
    fn from(error: CheckpointError) -> Self {
        Self::Checkpoint(Box::new(error))
    }
}

/// Why a study is not carried out.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReproduceError {
    /// Another process works in the folder.
    #[error("{} is in use by {holder}; wait until it ends, or choose another folder", path.display())]
    Busy {
        /// The folder.
        path: PathBuf,
        /// Process, machine and since when, as the other noted it.
        holder: String,
    },
    /// The folder's results are of another study, scale, data, or of other settings.
    #[error(
        "{}: its results are of `{found}`, now it is `{expected}`; choose another folder, or drop them (--force)",
        path.display()
    )]
    Changed {
        /// The folder.
        path: PathBuf,
        /// The line that was.
        found: String,
        /// The line that is.
        expected: String,
    },
    /// A share that is to be put together is of another study, scale, data, or of other settings.
    #[error(
        "{}: its results are of `{found}`, and what is put together is of `{expected}`; repeat the options of the shares, \
         with the program that made them",
        path.display()
    )]
    OtherShare {
        /// The share's folder.
        path: PathBuf,
        /// The line that it has.
        found: String,
        /// The line that the others should have.
        expected: String,
    },
    /// A result is of another build of the program than the others: a table is made at one commit.
    #[error(
        "{}: `{field}` is {found:?}, that of the other results is {expected:?}; a table is made by one build: choose \
         another folder, or remove the results of one of the two",
        path.display()
    )]
    OtherBuild {
        /// The file.
        path: PathBuf,
        /// What differs: `commit` or `version`.
        field: &'static str,
        /// What the file says.
        found: String,
        /// What the others say.
        expected: String,
    },
    /// Two folders have a result of the same job and seed, and not the same one.
    #[error("{} and {} are of the same job and seed, and differ; leave one of them out", first.display(), second.display())]
    Twice {
        /// The one.
        first: PathBuf,
        /// The other.
        second: PathBuf,
    },
    /// A job is asked for that the study does not have.
    #[error("{job}: no such job, expected one of: {known}")]
    UnknownJob {
        /// What was asked for.
        job: String,
        /// The study's jobs.
        known: String,
    },
    /// A file holds no results of a study.
    #[error("{}: {problem}; expected a results.json that `reproduce` wrote", path.display())]
    NoResults {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: String,
    },
    /// There is something else at the path.
    #[error("{} is there and holds no results; choose another folder, or write beside what is there (--force, where none of its names is in the way)", path.display())]
    Taken {
        /// The folder.
        path: PathBuf,
    },
    /// A kept result cannot be read.
    #[error("{}: {problem}; remove it, and its job is done again", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: String,
    },
    /// The file system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A job failed. What was finished before is kept.
    #[error("{job}, seed {seed}: {error}")]
    Job {
        /// The job.
        job: String,
        /// Its seed.
        seed: u64,
        /// Why.
        error: StudyError,
    },
}
