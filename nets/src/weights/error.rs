//! What can go wrong with a file of weights.

use std::io;
use std::path::PathBuf;

use autodiff_lite::state::Mismatch;
use pickle::PickleError;
use pickle::budget::OverLimit;

/// Weights could not be loaded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WeightsError {
    /// The file cannot be read.
    #[error("cannot read {}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        #[source]
        source: io::Error,
    },
    /// The bytes are not a file of weights.
    #[error("{}: {source}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: FormatError,
    },
    /// The map of names gives two arrays one name.
    #[error("{}: after renaming, two arrays are called {name}", path.display())]
    Twice {
        /// The file.
        path: PathBuf,
        /// The name.
        name: String,
    },
    /// The file is sound, but of another model.
    #[error("{} does not fit the model: {mismatch}", path.display())]
    Mismatch {
        /// The file.
        path: PathBuf,
        /// All differences.
        mismatch: Mismatch,
    },
}

/// Bytes are no file of weights.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FormatError {
    /// They do not begin like a file of PyTorch's, and are no safetensors either.
    #[error("neither safetensors nor a PyTorch file: {0}")]
    Safetensors(String),
    /// They begin like a file of PyTorch's.
    #[error("not a sound PyTorch file: {0}")]
    Pth(#[from] PthError),
}

/// What is wrong with a file of PyTorch's.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PthError {
    /// The zip archive cannot be read.
    #[error("{0}")]
    Archive(String),
    /// No file of the archive is the pickle of the weights.
    #[error("the archive holds no data.pkl: is it a TorchScript or other zip file?")]
    NoPickle,
    /// A file of the archive is not as PyTorch writes it.
    #[error("{name} {reason}")]
    Entry {
        /// Its name in the archive.
        name: String,
        /// What is wrong with it.
        reason: &'static str,
    },
    /// It was written by a machine that stores numbers the other way round.
    #[error("its numbers are big-endian")]
    BigEndian,
    /// A pickle cannot be read.
    #[error("{part}: {source}")]
    Pickle {
        /// Which one, and where it begins.
        part: String,
        /// What is wrong with it.
        source: PickleError,
    },
    /// A storage is not there, or not whole.
    #[error("storage {key} {reason}")]
    Storage {
        /// Its name.
        key: String,
        /// What is wrong with it.
        reason: &'static str,
    },
    /// A tensor is no part of its storage.
    #[error("{name}: {reason}")]
    Tensor {
        /// Its name.
        name: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The file would take more memory than one of its length may.
    #[error(transparent)]
    Memory(#[from] OverLimit),
    /// No tensor has a name.
    #[error("it holds no tensor under a name: save `model.state_dict()`")]
    Empty,
}
