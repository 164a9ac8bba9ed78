//! The tables of the paper on neural ODEs for Pixel2Mesh.

mod integrated;
mod memory;
mod object_frame;
mod planes;
mod retrieval;
mod solvers;

pub use memory::MemoryStudy;
pub use object_frame::{ObjectFrameStudy, changed};
pub use planes::PlanesStudy;
pub use solvers::SolversStudy;

use models::paired::{Pairs, PointScores};
use models::pixel2mesh::Scored;

use crate::{Cell, Row, Study};

/// The studies of this module, in the order of lists.
pub const STUDIES: &[&dyn Study] = &[&PlanesStudy, &SolversStudy, &ObjectFrameStudy, &MemoryStudy];

/// What makes the quick ones quick. In fewer steps, or with the published encoder, a model that sees is no better than one
/// that does not.
const QUICK: &[(&str, &str)] = &[
    ("max-steps", "400"),
    ("warmup", "5"),
    ("image-size", "32"),
    ("channels", "[4, 4, 8, 16, 16, 16]"),
    ("encoder-form", "residual"),
    ("feature-scale", "0.1"),
    ("learning-rate", "0.003"),
    ("hidden", "32"),
    ("level", "0"),
    ("points", "500"),
    ("batch", "8"),
    ("objects", "60"),
    ("test-objects", "8"),
    ("synthetic-views", "4"),
];

/// A model that sees nothing: what it reads of an image is below the rounding of what it adds it to.
const BLINDED: (&str, &str) = ("feature-scale", "1e-12");

/// A row with the scores of a table, in its order.
fn with_scores(row: Row, data: &Pairs, scored: &Scored) -> Row {
    let mean = scored.mean();
    let through = |mean: PointScores| {
        Cell::smaller("self-intersecting, %", 100.0 * mean.quality.self_intersecting, 2)
    };
    let folded = |mean: PointScores| Cell::smaller("folded, %", 100.0 * mean.quality.folded, 2);
    let cell = |cell: Cell, of: fn(&PointScores) -> f64| cell.over(by_object(data, scored, of));
    row.with(cell(Cell::smaller("CD", mean.chamfer, 3), |s| s.chamfer))
        .with(cell(Cell::larger("F(τ)", 100.0 * mean.f_score, 2), |s| 100.0 * s.f_score))
        .with(cell(Cell::larger("F(2τ)", 100.0 * mean.f_score_double, 2), |s| {
            100.0 * s.f_score_double
        }))
        .with(cell(Cell::smaller("EMD", mean.earth_mover, 3), |s| s.earth_mover))
        .with(cell(Cell::larger("normals", mean.normals, 3), |s| s.normals))
        .with(cell(through(mean), |s| 100.0 * s.quality.self_intersecting))
        .with(cell(folded(mean), |s| 100.0 * s.quality.folded))
}

/// A score of each image, by the name of its object.
fn by_object<'a>(
    data: &'a Pairs,
    scored: &'a Scored,
    of: impl Fn(&PointScores) -> f64 + 'a,
) -> impl Iterator<Item = (String, f64)> + 'a {
    scored.each.iter().map(move |(object, scores, _)| (data.name(*object).join("/"), of(scores)))
}

/// Scores category by category, in the order of the data.
fn by_category(data: &Pairs, scored: &Scored) -> Vec<(String, Scored)> {
    let mut parts: Vec<(String, Scored)> = Vec::new();
    for (one, name) in scored.each.iter().zip(&scored.names) {
        let [category, _] = data.name(one.0);
        let known = parts.iter().position(|(name, _)| name == category);
        let place = known.unwrap_or(parts.len());
        if known.is_none() {
            parts.push((category.to_owned(), Scored::default()));
        }
        parts[place].1.each.push(*one);
        parts[place].1.names.push(name.clone());
    }
    parts
}

/// What the columns are, for captions.
const COLUMNS: &str = "CD: mean squared distances between predicted vertices and 10,000 true points, both ways, in Pixel2Mesh's frame \
                       (objects times 0.57), times 1000. F at squared distances of 1e-4 and 2e-4, per cent. EMD: exact, 512 surface \
                       points, mean distance times 100. Normals: mean absolute cosine at nearest points. Self-intersecting: faces that run through \
                       another one; folded: edges at which the surface turns by more than 120 degrees.";
