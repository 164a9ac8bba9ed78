//! What a study found, row by row, seed by seed and object by object: all that tables, claims, curves and pages are made of.
//!
//! It is small enough to be committed beside the tables, so that those can be made again without training.

use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use train::{Better, Fingerprint};

use crate::error::ReproduceError;
use crate::layout::laid_out;
use crate::order::Order;
use crate::scale::Scale;
use crate::store::{Kept, KeptImage, KeptRow};

/// What such a file is called in a study's folder.
pub(crate) const FILE: &str = "results.json";
/// What it says of its form.
const FORMAT: &str = "unsphere results 1";
/// Digits of a row's value, and of an object's.
const DIGITS: [usize; 2] = [6, 4];

/// A study's results.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Results {
    /// The form of the file.
    pub format: String,
    /// The study's name.
    pub study: String,
    /// How much of it was done.
    pub scale: Scale,
    /// Where the data came from.
    pub data: String,
    /// A number that other settings change.
    pub settings: String,
    /// The command that made it.
    pub command: String,
    /// Jobs that are still to be done.
    pub left: usize,
    /// The jobs that are done.
    pub jobs: Vec<JobRecord>,
    /// Lists of objects; a cell says which of them its scores are of.
    pub objects: Vec<Vec<String>>,
    /// All columns of all tables.
    pub columns: Vec<ColumnRecord>,
    /// One entry a row and seed.
    pub rows: Vec<RowRecord>,
    /// The courses of the trainings.
    pub curves: Vec<CurveRecord>,
}

/// A job that is done.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JobRecord {
    /// Its name.
    pub job: String,
    /// Its seed.
    pub seed: u64,
    /// What it took, seconds.
    pub seconds: f64,
    /// What its training took of that.
    pub training: f64,
    /// Version of the program.
    pub version: String,
    /// Commit of the program; empty where it is not known.
    pub commit: String,
    /// The processor.
    pub cpu: String,
    /// The machine.
    pub machine: String,
    /// Threads.
    pub threads: usize,
}

/// A column of a table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ColumnRecord {
    /// The heading of its table.
    pub table: String,
    /// Its own.
    pub name: String,
    /// Which way is up.
    pub better: Option<Better>,
    /// Digits after the point.
    pub decimals: usize,
}

/// A row of one seed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RowRecord {
    /// The heading of its table.
    pub table: String,
    /// What it is of.
    pub label: String,
    /// The job that made it.
    pub job: String,
    /// Its seed.
    pub seed: u64,
    /// What it took.
    pub seconds: f64,
    /// Its values.
    pub cells: Vec<CellRecord>,
    /// Files of images, below the folder of the results.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pictures: Vec<KeptImage>,
}

/// A value.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CellRecord {
    /// The heading of its column.
    pub column: String,
    /// The value.
    pub value: Option<f64>,
    /// Which list of objects its scores are of.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub objects: Option<usize>,
    /// The value of each of them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub scores: Vec<Option<f64>>,
}

/// How a figure went over a training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CurveRecord {
    /// The job.
    pub job: String,
    /// Its seed.
    pub seed: u64,
    /// What it is of: the loss, or a score of validation.
    pub name: String,
    /// Steps and values.
    pub points: Vec<[f64; 2]>,
}

/// What one seed has in a cell.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Sample {
    pub(crate) seed: u64,
    pub(crate) value: f64,
    /// By name; empty where there are no values by object.
    pub(crate) objects: Vec<(String, f64)>,
}

impl Results {
    /// Of what is kept, in the order in which it is handed in.
    pub(crate) fn of<'a>(
        study: &str,
        settings: &str,
        order: &Order<'_>,
        kept: impl IntoIterator<Item = &'a Kept>,
        left: usize,
    ) -> Self {
        let data = order.data_name();
        let settings = format!("{:016x}", Fingerprint::new().with(settings.as_bytes()).value());
        let command = order.provenance.command.clone();
        let (study, format) = (study.to_owned(), FORMAT.to_owned());
        let mut results = Self {
            format,
            study,
            scale: order.scale,
            data,
            settings,
            command,
            left,
            ..Self::default()
        };
        for kept in kept {
            results.add(kept);
        }
        results
    }

    fn add(&mut self, kept: &Kept) {
        self.jobs.push(JobRecord {
            job: kept.job.clone(),
            seed: kept.seed,
            seconds: rounded(kept.seconds, DIGITS[0]).unwrap_or(0.0),
            training: rounded(kept.training, DIGITS[0]).unwrap_or(0.0),
            version: kept.version.clone(),
            commit: kept.commit.clone(),
            cpu: kept.cpu.clone(),
            machine: kept.machine.clone(),
            threads: kept.threads,
        });
        for row in &kept.rows {
            self.add_row(kept, row);
        }
        self.curves.extend(kept.curves.iter().map(|curve| CurveRecord {
            job: kept.job.clone(),
            seed: kept.seed,
            name: curve.name.clone(),
            points: curve.points.clone(),
        }));
    }

    fn add_row(&mut self, kept: &Kept, row: &KeptRow) {
        let mut cells = Vec::new();
        for cell in &row.cells {
            let known = |c: &ColumnRecord| c.table == row.table && c.name == cell.column;
            if !self.columns.iter().any(known) {
                let (table, name) = (row.table.clone(), cell.column.clone());
                let (better, decimals) = (cell.better, cell.decimals);
                self.columns.push(ColumnRecord { table, name, better, decimals });
            }
            let (names, values): (Vec<String>, Vec<Option<f64>>) =
                cell.objects.iter().cloned().unzip();
            cells.push(CellRecord {
                column: cell.column.clone(),
                value: cell.value.and_then(|value| rounded(value, DIGITS[0])),
                objects: (!names.is_empty()).then(|| self.list(names)),
                scores: values.iter().map(|v| v.and_then(|v| rounded(v, DIGITS[1]))).collect(),
            });
        }
        self.rows.push(RowRecord {
            table: row.table.clone(),
            label: row.label.clone(),
            job: kept.job.clone(),
            seed: kept.seed,
            seconds: rounded(row.seconds, DIGITS[0]).unwrap_or(0.0),
            cells,
            pictures: row.pictures.clone(),
        });
    }

    /// The number of a list of objects.
    fn list(&mut self, names: Vec<String>) -> usize {
        let at = self.objects.iter().position(|list| *list == names);
        at.unwrap_or_else(|| {
            self.objects.push(names);
            self.objects.len() - 1
        })
    }

    /// What the seeds have in a cell, in ascending order of the seeds; those without a value are left out.
    pub(crate) fn samples(&self, table: &str, row: &str, column: &str) -> Vec<Sample> {
        let mut samples: Vec<Sample> = self
            .rows
            .iter()
            .filter(|record| record.table == table && record.label == row)
            .filter_map(|record| {
                let cell = record.cells.iter().find(|cell| cell.column == column)?;
                Some(Sample { seed: record.seed, value: cell.value?, objects: self.named(cell) })
            })
            .collect();
        samples.sort_by_key(|sample| sample.seed);
        samples
    }

    fn named(&self, cell: &CellRecord) -> Vec<(String, f64)> {
        let names = cell.objects.and_then(|list| self.objects.get(list));
        let values = cell.scores.iter().map(|value| value.unwrap_or(f64::NAN));
        names.into_iter().flatten().cloned().zip(values).collect()
    }

    /// The file.
    pub fn to_json(&self) -> String {
        let value = serde_json::to_value(self).expect("plain figures serialise");
        laid_out(&value)
    }

    /// Reads such a file.
    ///
    /// # Errors
    /// If it cannot be read, or is none.
    pub fn read(path: &Path) -> Result<Self, ReproduceError> {
        let io = |source| ReproduceError::Io { path: path.to_owned(), source };
        let text = std::fs::read_to_string(path).map_err(io)?;
        let unfit = |problem: String| ReproduceError::NoResults { path: path.to_owned(), problem };
        let value: Value = serde_json::from_str(&text).map_err(|error| unfit(error.to_string()))?;
        if value["format"] != FORMAT {
            return Err(unfit(format!("`format` is {}, expected {FORMAT:?}", value["format"])));
        }
        let results: Self =
            serde_json::from_value(value).map_err(|error| unfit(error.to_string()))?;
        results.check().map_err(unfit)?;
        Ok(results)
    }

    /// What serde does not see.
    fn check(&self) -> Result<(), String> {
        for row in &self.rows {
            for cell in &row.cells {
                let list = cell.objects.map(|list| self.objects.get(list).map_or(0, Vec::len));
                if list.unwrap_or(0) != cell.scores.len() {
                    let (label, column, count) = (&row.label, &cell.column, cell.scores.len());
                    let found = list.unwrap_or(0);
                    return Err(format!(
                        "row {label:?}, column {column:?}, has {count} `scores`, expected one for each of its {found} `objects`"
                    ));
                }
            }
        }
        Ok(())
    }
}

/// To so many digits, so that what is written is what is used; none for what is not a number.
fn rounded(value: f64, digits: usize) -> Option<f64> {
    let text = format!("{value:.*e}", digits - 1);
    text.parse().ok().filter(|value: &f64| value.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_rounded_to_digits_not_places() {
        assert_eq!(rounded(0.000_123_456, 4), Some(0.000_123_5));
        assert_eq!(rounded(-98_765.4, 4), Some(-98_770.0));
        assert_eq!(rounded(0.0, 4), Some(0.0));
        assert_eq!(rounded(f64::NAN, 4), None);
        assert_eq!(rounded(f64::INFINITY, 4), None);
    }
}
