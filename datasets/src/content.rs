//! The bytes of a file, and how much memory they may make their reader take.

use std::path::Path;

use mesh_core::{Budget, Limits, OverLimit};

use crate::error::{ReadViewsError, ViewsProblem};

/// What is left of any file's memory for what nobody counts: paths, messages, buffers of decoders.
const UNCOUNTED: u64 = 16_000_000;

/// The bytes of a file, which know how many of them were really stored.
#[derive(Debug)]
pub(crate) struct Content {
    bytes: Vec<u8>,
    /// What is held already, and how much may be.
    budget: Budget,
}

impl Content {
    /// The bytes of a file that takes `stored` of them on the disk or in its archive.
    ///
    /// # Errors
    /// If they alone are more than the limits allow.
    pub(crate) fn new(bytes: Vec<u8>, stored: u64, limits: &Limits) -> Result<Self, OverLimit> {
        let mut budget = limits.budget(stored);
        budget.take(bytes.len() as u64)?;
        // Where so little is allowed, nothing that is worth counting will be read.
        let _ = budget.take(UNCOUNTED);
        Ok(Self { bytes, budget })
    }

    /// What may be taken for the values that are made of these bytes.
    pub(crate) fn budget(&self) -> Budget {
        self.budget.clone()
    }

    /// Whether there is room for so many bytes of values for each line.
    ///
    /// # Errors
    /// If not.
    pub(crate) fn check_lines(&self, each: usize) -> Result<(), OverLimit> {
        let lines = self.bytes.split(|&b| b == b'\n').count() as u64;
        self.budget().take(lines.saturating_mul(each as u64))
    }
}

/// Bytes that were never stored otherwise.
#[cfg(test)]
impl From<&[u8]> for Content {
    fn from(bytes: &[u8]) -> Self {
        let stored = bytes.len() as u64;
        Self::new(bytes.to_vec(), stored, &Limits::default()).expect("bytes are 20 times as many")
    }
}

impl std::ops::Deref for Content {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.bytes
    }
}

/// What an archive's entry of so many stored bytes may inflate to: about half of what it may take,
/// the rest is for its values.
pub(crate) fn inflated(stored: u64, limits: &Limits) -> u64 {
    limits.peak(stored) / 2
}

/// The error of the file at `path`, about what was being read of it.
pub(crate) fn over(path: &Path, field: impl Into<String>, limit: OverLimit) -> ReadViewsError {
    let OverLimit { needed: found, most: limit } = limit;
    ReadViewsError::new(path, ViewsProblem::TooLarge { field: field.into(), found, limit })
}
