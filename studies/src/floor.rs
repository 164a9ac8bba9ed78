//! What the quick form of a study must reach, and what must not reach it.
//!
//! A floor that everything passes shows nothing. Each is therefore at most 1.3 times the error that was found, and models that
//! learned nothing, or see nothing, have to miss it.

use serde::Serialize;

use crate::claim::Score;
use crate::results::Results;

/// How many times the error that was found a row may have, at most.
pub(crate) const SLACK: f64 = 1.3;

/// A bound on a row's error.
#[derive(Clone, Debug, PartialEq)]
pub struct Floor {
    score: Score,
    perfect: f64,
    found: f64,
    times: f64,
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
        Self { score, perfect, found, times: SLACK, missed_by: Vec::new() }
    }

    /// Within fewer times the error that was found, where 1.3 times are reached by what must miss it.
    ///
    /// # Panics
    /// If it is more than 1.3 times.
    #[must_use]
    pub fn within(self, times: f64) -> Self {
        assert!(times <= SLACK, "within: {times} times the error, expected {SLACK} at most");
        Self { times, ..self }
    }

    /// And a row of the same table that must miss it: a model that was not trained, one that sees nothing.
    #[must_use]
    pub fn missed_by(mut self, row: impl Into<String>) -> Self {
        self.missed_by.push(row.into());
        self
    }

    /// The rows that must reach it, and those that must not.
    pub fn rows(&self) -> Vec<&str> {
        self.score.rows.iter().chain(&self.missed_by).map(String::as_str).collect()
    }

    /// The value that has to be reached.
    pub fn bound(&self) -> f64 {
        self.perfect + self.times * (self.found - self.perfect)
    }

    fn error(&self, value: f64) -> f64 {
        (self.perfect - value).abs()
    }

    /// The row reaches the bound, and those that must not do not.
    pub(crate) fn check(&self, results: &Results) -> Vec<Check> {
        let Score { table, rows, column } = &self.score;
        let most = self.times * self.error(self.found);
        let value = |row: &str| {
            let samples = results.samples(table, row, column);
            let sum: f64 = samples.iter().map(|sample| sample.value).sum();
            (!samples.is_empty()).then(|| sum / samples.len() as f64)
        };
        let said =
            |value: Option<f64>| value.map_or_else(|| "none".to_owned(), |v| format!("{v:.3}"));
        let relation = if self.found < self.perfect { "at least" } else { "at most" };
        let bound = self.bound();
        let reaching = rows.iter().map(|row| {
            let value = value(row);
            let passed = value.is_some_and(|value| self.error(value) <= most);
            let text = format!("{row}: {column} is {relation} {bound:.3}");
            Check { text, found: said(value), passed }
        });
        let missing = self.missed_by.iter().map(|row| {
            let value = value(row);
            // A row that is not there shows nothing; one whose value is no number would have none.
            let there = results.rows.iter().any(|r| r.table == *table && r.label == *row);
            let passed = there && value.is_none_or(|value| self.error(value) > most);
            let text = format!("{row}: {column} is not {relation} {bound:.3}");
            Check { text, found: said(value), passed }
        });
        reaching.chain(missing).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::{CellRecord, RowRecord};

    fn with(rows: &[(&str, f64)]) -> Results {
        let record = |(label, value): &(&str, f64)| RowRecord {
            table: "t".into(),
            label: (*label).into(),
            job: (*label).into(),
            seed: 0,
            seconds: 0.0,
            cells: vec![CellRecord {
                column: "iou".into(),
                value: Some(*value).filter(|value| value.is_finite()),
                objects: None,
                scores: vec![],
            }],
            pictures: vec![],
        };
        Results { rows: rows.iter().map(record).collect(), ..Results::default() }
    }

    /// Found 0.8: an error of 0.2, of which 1.3 times are allowed, so 0.74.
    #[test]
    fn a_floor_is_reached_and_missed_by_those_that_must() {
        let floor = Floor::new(Score::new("t", "own", "iou"), 1.0, 0.8).missed_by("untrained");
        assert!((floor.bound() - 0.74).abs() < 1e-12);
        let passed = |own: f64, untrained: f64| {
            let checks = floor.check(&with(&[("own", own), ("untrained", untrained)]));
            checks.iter().map(|check| check.passed).collect::<Vec<_>>()
        };
        assert_eq!(passed(0.75, 0.5), [true, true]);
        assert_eq!(passed(0.73, 0.5), [false, true]);
        // What learned nothing and is as good shows that the floor shows nothing.
        assert_eq!(passed(0.75, 0.75), [true, false]);
        assert_eq!(passed(f64::NAN, f64::NAN), [false, true]);
        let checks = floor.check(&with(&[("own", 0.8)]));
        assert!(checks[0].passed && !checks[1].passed, "{checks:?}");
    }
}
