//! What the quick form of a study must reach, and what must not reach it.
//!
//! A floor that everything passes shows nothing. Each is therefore at most 1.3 times the error that was found, and models that
//! learned nothing, or see nothing, have to miss it.

use serde::Serialize;

use crate::claim::Score;
use crate::results::Results;

/// How many times the error that was found a row may have.
pub(crate) const SLACK: f64 = 1.3;

/// A bound on a row's error.
#[derive(Clone, Debug, PartialEq)]
pub struct Floor {
    score: Score,
    perfect: f64,
    found: f64,
    missed_by: Vec<String>,
}

/// A floor that was checked.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Check {
    /// What has to be.
    pub text: String,
    /// The figure that decides it.
    pub found: String,
    /// Whether it is so.
    pub passed: bool,
}

impl Floor {
    /// Of a score whose value nothing beats is `perfect`, and that was found to be `found`.
    pub fn new(score: Score, perfect: f64, found: f64) -> Self {
        Self { score, perfect, found, missed_by: Vec::new() }
    }

    /// And a row of the same table that must miss it: a model that was not trained, one that sees nothing.
    #[must_use]
    pub fn missed_by(mut self, row: impl Into<String>) -> Self {
        self.missed_by.push(row.into());
        self
    }

    /// The value that has to be reached.
    pub fn bound(&self) -> f64 {
        self.perfect + SLACK * (self.found - self.perfect)
    }

    fn error(&self, value: f64) -> f64 {
        (self.perfect - value).abs()
    }

    /// The row reaches the bound, and those that must not do not.
    pub(crate) fn check(&self, results: &Results) -> Vec<Check> {
        let Score { table, rows, column } = &self.score;
        let most = SLACK * self.error(self.found);
        let value = |row: &str| {
            let samples = results.samples(table, row, column);
            let sum: f64 = samples.iter().map(|sample| sample.value).sum();
            (!samples.is_empty()).then(|| sum / samples.len() as f64)
        };
        let said =
            |value: Option<f64>| value.map_or_else(|| "none".to_owned(), |v| format!("{v:.3}"));
        let way = if self.found < self.perfect { "at least" } else { "at most" };
        let bound = self.bound();
        let reaching = rows.iter().map(|row| {
            let value = value(row);
            let passed = value.is_some_and(|value| self.error(value) <= most);
            let text = format!("{row}: {column} is {way} {bound:.3}");
            Check { text, found: said(value), passed }
        });
        let missing = self.missed_by.iter().map(|row| {
            let value = value(row);
            // A row that is not there shows nothing; one whose value is no number would have none.
            let there = results.rows.iter().any(|r| r.table == *table && r.label == *row);
            let passed = there && value.is_none_or(|value| self.error(value) > most);
            let text = format!("{row}: {column} misses that, which is not {way} {bound:.3}");
            Check { text, found: said(value), passed }
        });
        reaching.chain(missing).collect()
    }
}
