//! What one job found: rows of tables.

use mesh_core::ByteImage;
use models::MeshPair;
use serde::{Deserialize, Serialize};
use train::report::{ViewPair, sheet};
use train::{Better, Metric};

use crate::gallery::sheets;

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
    pub pictures: Vec<CaptionedImage>,
}

/// What an image is of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ImageKind {
    /// Anything, with its caption.
    #[default]
    Sheet,
    /// Objects of the test, as the row's model predicts them.
    Predicted,
    /// The same objects as they are; one image for all rows of a table.
    Truth,
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
    /// The value of each object by its name, where the value is a mean over objects; else empty. An object without one has none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub objects: Vec<(String, Option<f64>)>,
}

/// An image with what it shows.
#[derive(Clone, Debug, PartialEq)]
pub struct CaptionedImage {
    /// The caption.
    pub caption: String,
    /// The image.
    pub image: ByteImage,
    /// What it is of.
    pub kind: ImageKind,
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
        let kind = ImageKind::Sheet;
        self.pictures.extend(image.map(|image| CaptionedImage {
            caption: caption.into(),
            image,
            kind,
        }));
        self
    }

    /// With objects of the test as they were predicted, beside the truth, from three sides. Which objects is to be drawn
    /// ([`drawn`](crate::drawn)), not picked.
    #[must_use]
    pub fn with_objects(mut self, objects: &[MeshPair]) -> Self {
        let names: Vec<&str> = objects.iter().map(|object| object.name.as_str()).collect();
        let caption = names.join(", ");
        let kinds = [ImageKind::Predicted, ImageKind::Truth];
        for (image, kind) in sheets(objects).into_iter().flatten().zip(kinds) {
            self.pictures.push(CaptionedImage { caption: caption.clone(), image, kind });
        }
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
        Self {
            column: column.into(),
            value: Some(value),
            better: None,
            decimals,
            objects: Vec::new(),
        }
    }

    /// With the values that it is the mean of, by object. Several values of an object become their mean.
    #[must_use]
    pub fn over<N: Into<String>>(self, values: impl IntoIterator<Item = (N, f64)>) -> Self {
        let mut objects: Vec<(String, Vec<f64>)> = Vec::new();
        for (name, value) in values {
            let name = name.into();
            match objects.iter_mut().rev().find(|(known, _)| *known == name) {
                Some((_, values)) => values.push(value),
                None => objects.push((name, vec![value])),
            }
        }
        let mean = |values: Vec<f64>| values.iter().sum::<f64>() / values.len() as f64;
        let objects = objects.into_iter().map(|(name, values)| (name, Some(mean(values))));
        let objects =
            objects.map(|(name, value)| (name, value.filter(|v| v.is_finite()))).collect();
        Self { objects, ..self }
    }

    /// A score, under its own name, with its values by object.
    pub fn of(metric: &Metric, decimals: usize) -> Self {
        Self {
            better: Some(metric.better),
            ..Self::plain(metric.name.clone(), metric.value, decimals)
        }
        .over(metric.by_object.iter().cloned())
    }
}
