//! Rows of several seeds, put together.

use std::fmt::Write as _;

use serde::Serialize;
use train::Better;

use super::store::Kept;

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

/// A row over all seeds.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Line {
    /// What it is of.
    pub label: String,
    /// Seeds that have it.
    pub seeds: Vec<u64>,
    /// For each column the values of the seeds in their order; seeds without one are left out.
    pub values: Vec<Vec<f64>>,
    /// For each seed what it took.
    pub seconds: Vec<f64>,
}

impl Tables {
    /// Puts together what is kept, in the order in which it is handed in.
    pub(super) fn of<'a>(kept: impl IntoIterator<Item = &'a Kept>) -> Self {
        let mut tables = Self::default();
        for kept in kept {
            for row in &kept.rows {
                let table = found_or(
                    &mut tables.0,
                    |t| t.name == row.table,
                    || Table { name: row.table.clone(), ..Table::default() },
                );
                let at = table.line(&row.label);
                for cell in &row.cells {
                    let column = table.column(cell);
                    let values = &mut table.rows[at].values;
                    values.resize(values.len().max(column + 1), Vec::new());
                    values[column].extend(cell.value.filter(|v| !v.is_nan()));
                }
                table.rows[at].seeds.push(kept.seed);
                table.rows[at].seconds.push(row.seconds);
            }
        }
        for table in &mut tables.0 {
            let columns = table.columns.len();
            table.rows.iter_mut().for_each(|row| row.values.resize(columns, Vec::new()));
        }
        tables
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

    /// [`mean`](Self::mean) for claims: what has no value is not a number, which holds nothing.
    pub(crate) fn figure(&self, table: &str, row: &str, column: &str) -> f64 {
        self.mean(table, row, column).unwrap_or(f64::NAN)
    }

    /// The largest less the smallest value of a cell; 0 with one seed, none without a value.
    pub fn spread(&self, table: &str, row: &str, column: &str) -> Option<f64> {
        spread(self.values(table, row, column))
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
                let (mean, spread) = self.cell(row, column);
                mean + &spread
            });
            let label = std::iter::once(row.label.clone());
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

    fn line(&mut self, label: &str) -> usize {
        let at = self.rows.iter().position(|row| row.label == label);
        at.unwrap_or_else(|| {
            self.rows.push(Line { label: label.to_owned(), ..Line::default() });
            self.rows.len() - 1
        })
    }

    fn column(&mut self, cell: &super::row::Cell) -> usize {
        let at = self.columns.iter().position(|column| column.name == cell.column);
        at.unwrap_or_else(|| {
            let (name, better, decimals) = (cell.column.clone(), cell.better, cell.decimals);
            self.columns.push(Column { name, better, decimals });
            self.columns.len() - 1
        })
    }

    /// A cell as text: the mean, and in brackets the spread where there are several seeds; but not
    /// where it could only say that a count or a published figure does not change.
    pub(super) fn cell(&self, row: &Line, column: usize) -> (String, String) {
        let decimals = self.columns[column].decimals;
        let values = &row.values[column];
        let Some(mean) = mean(values) else { return ("none".to_owned(), String::new()) };
        let fixed = |spread: f64| spread == 0.0 && self.columns[column].better.is_none();
        let spread = spread(values).filter(|&spread| values.len() > 1 && !fixed(spread));
        let spread = spread.map_or_else(String::new, |s| format!(" ({s:.decimals$})"));
        (format!("{mean:.decimals$}"), spread)
    }

    /// Whether this row has the best mean of the column, as far as the digits shown tell, and another
    /// has not.
    pub(super) fn is_best(&self, row: &Line, column: usize) -> bool {
        let Some(better) = self.columns[column].better else { return false };
        let shown = |row: &Line| self.cell(row, column).0.parse::<f64>().ok();
        let Some(own) = shown(row) else { return false };
        let others = || self.rows.iter().filter_map(shown);
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

fn spread(values: &[f64]) -> Option<f64> {
    let low = values.iter().copied().reduce(f64::min)?;
    let high = values.iter().copied().reduce(f64::max)?;
    Some(high - low)
}

fn found_or<T>(all: &mut Vec<T>, is: impl Fn(&T) -> bool, new: impl FnOnce() -> T) -> &mut T {
    let at = all.iter().position(is).unwrap_or_else(|| {
        all.push(new());
        all.len() - 1
    });
    &mut all[at]
}
