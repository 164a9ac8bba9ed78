//! The bytes of a file, and how much memory they may make their reader take.

use std::borrow::Cow;
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

    /// The text of a list, each line of which may become something of `each` bytes.
    pub(crate) fn text(&self, each: usize, path: &Path) -> Result<Cow<'_, str>, ReadViewsError> {
        let lines = self.bytes.split(|&b| b == b'\n').count() as u64;
        let taken = self.budget().take(lines.saturating_mul(each as u64));
        taken.map_err(|limit| over(path, "lines", limit))?;
        Ok(String::from_utf8_lossy(&self.bytes))
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

/// The lines that say something, without the spaces around them, and their numbers from 1.
pub(crate) fn numbered(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let lines = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
    lines.filter(|(_, line)| !line.is_empty())
}

/// As much of what was found as a message has room for.
pub(crate) fn cut(found: &str) -> String {
    found.chars().take(60).collect()
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
