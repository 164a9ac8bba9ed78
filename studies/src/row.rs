//! What one job found: rows of tables.

use mesh_core::ByteImage;
use serde::{Deserialize, Serialize};
use train::report::{ViewPair, sheet};
use train::{Better, Metric};

/// One row of a table, of one seed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Row {
    /// The heading of the table it belongs to.
    pub table: String,
    /// What the row is of; one row for all seeds.
    pub label: String,
    /// Its values, by column.
    pub cells: Vec<Cell>,
    /// What it took to make: of a training that was interrupted, all parts.
    pub seconds: f64,
    /// What there is to look at; the page shows those of the first seed.
    pub pictures: Vec<Picture>,
}

/// One value.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// The heading of its column.
    pub column: String,
    /// The value; none where there is none.
    pub value: Option<f64>,
    /// Which way is up; none where neither is.
    pub better: Option<Better>,
    /// Digits after the point.
    pub decimals: usize,
}

/// An image with what it shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// The caption.
    pub caption: String,
    /// The image.
    pub image: ByteImage,
}

impl Row {
    /// A row without values.
    pub fn new(table: impl Into<String>, label: impl Into<String>) -> Self {
        Self { table: table.into(), label: label.into(), ..Self::default() }
    }

    /// With one more value.
    #[must_use]
    pub fn with(mut self, cell: Cell) -> Self {
        self.cells.push(cell);
        self
    }

    /// With the time it took.
    #[must_use]
    pub fn took(mut self, seconds: f64) -> Self {
        self.seconds = seconds;
        self
    }

    /// With one image of all pairs, the model above the truth. None are no image. The page puts
    /// the row's label before the caption, unless they are the same.
    #[must_use]
    pub fn showing(mut self, caption: impl Into<String>, pairs: &[ViewPair]) -> Self {
        let image = sheet(pairs);
        self.pictures.extend(image.map(|image| Picture { caption: caption.into(), image }));
        self
    }
}

impl Cell {
    /// A value of which more is better.
    pub fn larger(column: impl Into<String>, value: f64, decimals: usize) -> Self {
        Self { better: Some(Better::Larger), ..Self::plain(column, value, decimals) }
    }

    /// A value of which less is better.
    pub fn smaller(column: impl Into<String>, value: f64, decimals: usize) -> Self {
        Self { better: Some(Better::Smaller), ..Self::plain(column, value, decimals) }
    }

    /// A value that is neither better nor worse.
    pub fn plain(column: impl Into<String>, value: f64, decimals: usize) -> Self {
        Self { column: column.into(), value: Some(value), better: None, decimals }
    }

    /// A score, under its own name.
    pub fn of(metric: &Metric, decimals: usize) -> Self {
        Self {
            better: Some(metric.better),
            ..Self::plain(metric.name.clone(), metric.value, decimals)
        }
    }
}
