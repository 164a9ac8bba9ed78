//! What can go wrong with a state file.

use std::fmt;
use std::io;
use std::path::PathBuf;

use super::Stored;

/// A state file could not be written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}", path.display())]
pub struct SaveError {
    /// The file.
    pub path: PathBuf,
    /// Why.
    #[source]
    pub source: io::Error,
}

/// A state file could not be loaded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LoadError {
    /// The file cannot be read.
    #[error("cannot read {}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        #[source]
        source: io::Error,
    },
    /// The bytes are not a safetensors file.
    #[error("{} is not a safetensors file: {reason}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
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

/// All differences between a module and a file.
#[derive(Clone, Debug, Default, PartialEq, Eq, thiserror::Error)]
pub struct Mismatch {
    /// Names that the module has and the file lacks.
    pub missing: Vec<String>,
    /// Names that the file has and the module lacks.
    pub unexpected: Vec<String>,
    /// Arrays of another shape or type: name, expected, found.
    pub different: Vec<(String, String, String)>,
}

impl Mismatch {
    pub(super) fn compare(&mut self, name: &str, shape: &[usize], stored: Option<&Stored>) {
        match stored {
            None => self.missing.push(name.to_owned()),
            Some(stored) if stored.shape != shape => {
                self.wrong_shape(name, shape, &stored.shape);
            }
            Some(stored) if !stored.numbers.is_real() => {
                self.wrong_type(name, "F32 or F64", stored.numbers.type_name());
            }
            Some(_) => {}
        }
    }

    pub(super) fn wrong_shape(&mut self, name: &str, expected: &[usize], found: &[usize]) {
        self.different.push((name.to_owned(), format!("{expected:?}"), format!("{found:?}")));
    }

    pub(super) fn wrong_type(&mut self, name: &str, expected: &str, found: &str) {
        self.different.push((name.to_owned(), expected.to_owned(), found.to_owned()));
    }

    pub(super) fn into_result(self) -> Result<(), Self> {
        if self == Self::default() { Ok(()) } else { Err(self) }
    }
}

impl fmt::Display for Mismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut parts = Vec::new();
        if !self.missing.is_empty() {
            parts.push(format!("missing {}", self.missing.join(", ")));
        }
        if !self.unexpected.is_empty() {
            parts.push(format!("unexpected {}", self.unexpected.join(", ")));
        }
        for (name, expected, found) in &self.different {
            parts.push(format!("{name} is {found} instead of {expected}"));
        }
        f.write_str(&parts.join("; "))
    }
}
