//! Rows of several seeds, put together.

use std::fmt::Write as _;

use serde::Serialize;
use train::Better;

use crate::bootstrap::{Interval, Paired, Statistic, interval};
use crate::results::{ColumnRecord, Results};

/// All tables of a study.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Tables(pub Vec<Table>);

/// One table: rows in the order of the jobs.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Table {
    /// Its heading.
    pub name: String,
    /// Its columns, as they came.
    pub columns: Vec<Column>,
    /// Its rows.
    pub rows: Vec<Line>,
}

/// A column's heading, and how its values are read.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Column {
    /// The heading.
    pub name: String,
    /// Which way is up.
    pub better: Option<Better>,
    /// Digits after the point.
    pub decimals: usize,
}

/// A cell for people.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct CellText {
    /// The mean over the seeds.
    pub(super) mean: String,
    /// In brackets, or nothing.
    pub(super) interval: String,
    /// The values of the seeds in brackets, or nothing.
    pub(super) each: String,
}

/// A row over all seeds.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Line {
    /// What it is of.
    pub label: String,
    /// Seeds that have it.
    pub seeds: Vec<u64>,
    /// For each column the values of the seeds in their order; seeds without one are left out.
    pub values: Vec<Vec<f64>>,
    /// For each column the 95 % interval of the mean, where the value is a mean over objects.
    pub intervals: Vec<Option<Interval>>,
    /// For each seed what it took.
    pub seconds: Vec<f64>,
}

impl Tables {
    /// Puts results together, rows and columns in the order in which they come.
    pub(super) fn of(results: &Results) -> Self {
        let mut tables = Self::default();
        for ColumnRecord { table, name, better, decimals } in &results.columns {
            let (name, better, decimals) = (name.clone(), *better, *decimals);
            tables.named(table).columns.push(Column { name, better, decimals });
        }
        for record in &results.rows {
            let row = tables.named(&record.table).line(&record.label);
            row.seeds.push(record.seed);
            row.seconds.push(record.seconds);
        }
        for table in &mut tables.0 {
            let (name, columns) = (&table.name, &table.columns);
            for row in &mut table.rows {
                for column in columns {
                    let samples = results.samples(name, &row.label, &column.name);
                    row.values.push(samples.iter().map(|sample| sample.value).collect());
                    // Where a sample has no objects, the differences of the seeds are all there is to show.
                    let alone = |(_, value): &(String, f64)| *value;
                    let objects = |sample: &crate::results::Sample| {
                        Paired::alone(sample.objects.iter().map(alone).collect())
                    };
                    let known = samples.iter().all(|sample| sample.objects.len() > 1);
                    let paired: Vec<Paired> = samples.iter().map(objects).collect();
                    let found = known.then(|| interval(&paired, Statistic::Difference));
                    row.intervals.push(found.flatten());
                }
            }
        }
        tables
    }

    fn named(&mut self, name: &str) -> &mut Table {
        let table = || Table { name: name.to_owned(), ..Table::default() };
        found_or(&mut self.0, |table| table.name == name, table)
    }

    /// A table by its heading.
    pub fn table(&self, name: &str) -> Option<&Table> {
        self.0.iter().find(|table| table.name == name)
    }

    /// The values of a cell, seed by seed; empty where there is no such cell.
    pub fn values(&self, table: &str, row: &str, column: &str) -> &[f64] {
        let find = || {
            let table = self.table(table)?;
            let column = table.columns.iter().position(|c| c.name == column)?;
            let row = table.rows.iter().find(|r| r.label == row)?;
            row.values.get(column)
        };
        find().map_or(&[], Vec::as_slice)
    }

    /// The mean of a cell over the seeds; none where it has no value.
    pub fn mean(&self, table: &str, row: &str, column: &str) -> Option<f64> {
        mean(self.values(table, row, column))
    }
}

impl Table {
    /// The table for a terminal: columns aligned, cells as in the pages.
    pub fn to_text(&self) -> String {
        let mut lines = vec![vec![self.name.clone()]];
        lines[0].extend(self.columns.iter().map(Column::heading));
        lines[0].push("time".to_owned());
        for row in &self.rows {
            let cells = (0..self.columns.len()).map(|column| {
                let CellText { mean, interval, .. } = self.cell(row, column);
                mean + &interval
            });
            let label = std::iter::once(self.label(row));
            lines.push(label.chain(cells).chain([row.time()]).collect());
        }
        let length = |text: &String| text.chars().count();
        let widths: Vec<usize> = (0..lines[0].len())
            .map(|column| lines.iter().map(|line| length(&line[column])).max().unwrap_or(0))
            .collect();
        let mut text = String::new();
        for line in &lines {
            let _ = write!(text, "{:1$}", line[0], widths[0]);
            for (cell, width) in line.iter().zip(&widths).skip(1) {
                let _ = write!(text, "  {cell:>width$}");
            }
            text.push('\n');
        }
        text
    }

    fn line(&mut self, label: &str) -> &mut Line {
        let line = || Line { label: label.to_owned(), ..Line::default() };
        found_or(&mut self.rows, |row| row.label == label, line)
    }

    /// A cell as text: the mean, its interval, and the values of several seeds; but not where these could only say that a
    /// count or a published figure does not change.
    pub(super) fn cell(&self, row: &Line, column: usize) -> CellText {
        let decimals = self.columns[column].decimals;
        let values = &row.values[column];
        let Some(mean) = mean(values) else {
            return CellText { mean: "none".to_owned(), ..CellText::default() };
        };
        let said = |value: f64| format!("{value:.decimals$}");
        let ends =
            |Interval { low, high, .. }: Interval| format!(" [{}, {}]", said(low), said(high));
        let fixed = values.iter().all(|value| value.to_bits() == values[0].to_bits());
        let each = if values.len() > 1 && !fixed {
            let each: Vec<String> = values.iter().copied().map(said).collect();
            format!(" ({})", each.join(", "))
        } else {
            String::new()
        };
        let interval = row.intervals[column].map_or_else(String::new, ends);
        CellText { mean: said(mean), interval, each }
    }

    /// What a row is of, and how many seeds it has where others have more.
    pub(super) fn label(&self, row: &Line) -> String {
        match row.seeds.len() {
            _ if self.is_whole(row) => row.label.clone(),
            1 => format!("{} (1 seed)", row.label),
            count => format!("{} ({count} seeds)", row.label),
        }
    }

    /// Whether a row has as many seeds as any.
    fn is_whole(&self, row: &Line) -> bool {
        self.rows.iter().all(|other| other.seeds.len() <= row.seeds.len())
    }

    /// Whether this row has the best mean of the column, as far as the digits shown tell, and another
    /// has not, among those with as many seeds as any.
    pub(super) fn is_best(&self, row: &Line, column: usize) -> bool {
        let Some(better) = self.columns[column].better else { return false };
        if !self.is_whole(row) {
            return false;
        }
        let shown = |row: &Line| self.cell(row, column).mean.parse::<f64>().ok();
        let Some(own) = shown(row) else { return false };
        let others = || self.rows.iter().filter(|row| self.is_whole(row)).filter_map(shown);
        others().all(|other| !better.improves(other, own))
            && others().any(|other| better.improves(own, other))
    }
}

impl Column {
    /// The heading with an arrow to the better end.
    pub(super) fn heading(&self) -> String {
        match self.better {
            Some(Better::Larger) => format!("{} ↑", self.name),
            Some(Better::Smaller) => format!("{} ↓", self.name),
            None => self.name.clone(),
        }
    }
}

impl Line {
    /// The mean time over the seeds, as text.
    pub(super) fn time(&self) -> String {
        mean(&self.seconds).map_or_else(String::new, |seconds| format!("{seconds:.1} s"))
    }
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

fn found_or<T>(all: &mut Vec<T>, is: impl Fn(&T) -> bool, new: impl FnOnce() -> T) -> &mut T {
    let at = all.iter().position(is).unwrap_or_else(|| {
        all.push(new());
        all.len() - 1
    });
    &mut all[at]
}
