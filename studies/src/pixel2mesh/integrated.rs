//! One trained field integrated in several ways: to a tolerance, in steps of other sizes, by another method.

use losses::metrics::point_distances;
use models::paired::Pairs;
use models::pixel2mesh::{Method, OdeConfig, OdePixel2Mesh, Scored};
use train::Subset;

use super::by_object;
use crate::{Cell, Row, StudyError};

/// The names of the tables.
pub(super) const ADAPTIVE: &str = "One trained model, integrated otherwise";
pub(super) const FINER: &str = "Trained by one method, followed in other steps";
const FAMILIES: &str = "Evaluations by family";
/// The column that tells whether what is more complex takes more evaluations.
pub(super) const CORRELATION: &str = "correlation with complexity";

/// Steps that fields are followed in, and what their columns are called.
const STEPS: [(&str, f64); 4] =
    [("0.5", 0.5), ("0.25", 0.25), ("0.125", 0.125), ("0.031", 0.03125)];

/// What the tables show.
pub(super) fn caption(table: &str) -> Option<&'static str> {
    match table {
        ADAPTIVE => Some(
            "Models that Dormand-Prince's method trained in steps that its tolerance of 1e-3 decides; of airplanes, and of nine families (45 objects \
             each, 40 others to test). Complexity: the Chamfer distance of the true surface from the ellipsoid that every deformation begins with. \
             Correlations are of ranks, over all test images.",
        ),
        FAMILIES => Some(
            "The model of nine families at its own tolerance. Complexity as above, times 1000.",
        ),
        FINER => Some(
            "CD of the models of the first table, by the method that each was trained by, in steps of the size above the column; in the last column by \
             Euler's method. A field that is a flow does not care how finely it is followed, once this is fine enough. Those that Heun's and the \
             midpoint method train are; what Euler's method trains in few steps is not: the size of its steps is part of what it has learned.",
        ),
        _ => None,
    }
}

/// A trained field by its own method in several steps, and by Euler's.
pub(super) fn finer(
    label: &str,
    system: &OdePixel2Mesh,
    config: &OdeConfig,
    data: &Pairs,
) -> Result<Row, StudyError> {
    let chamfer = |name: &str, step: f64, method: Method| -> Result<Cell, StudyError> {
        let other = OdeConfig { step: [step, step], method, ..config.clone() };
        Ok(distance(name, data, &system.with_config(&other).scored(data, Subset::Test)?))
    };
    let mut row = Row::new(FINER, label);
    for (name, step) in STEPS {
        row = row.with(chamfer(name, step, config.method)?);
    }
    Ok(row.with(chamfer("Euler, 0.25", 0.25, Method::Euler)?))
}

/// Its Chamfer distance, by object too.
fn distance(column: &str, data: &Pairs, scored: &Scored) -> Cell {
    let cell = Cell::smaller(column, scored.mean().chamfer, 3);
    cell.over(by_object(data, scored, |scores| scores.chamfer))
}

/// The claim of the abstract, that the number of deformations adapts.
pub(super) fn adaptively(
    model: &str,
    system: &OdePixel2Mesh,
    config: &OdeConfig,
    data: &Pairs,
    scored: &Scored,
) -> Result<Vec<Row>, StudyError> {
    let mut rows = Vec::new();
    let complexities = complexities(system, data, scored.each.len())?;
    for tolerance in [1e-2, 1e-3, 1e-4] {
        let other = OdeConfig { tolerance: Some(tolerance), ..config.clone() };
        let found = if other == *config {
            scored.clone()
        } else {
            system.with_config(&other).scored(data, Subset::Test)?
        };
        let counts: Vec<f64> =
            found.each.iter().map(|(.., stats)| stats.evaluations as f64).collect();
        let least = counts.iter().copied().fold(f64::INFINITY, f64::min);
        let most = counts.iter().copied().fold(0.0, f64::max);
        let correlation = rank_correlation(&complexities, &counts);
        let row = Row::new(ADAPTIVE, at_tolerance(model, tolerance))
            .with(distance("CD", data, &found))
            .with(Cell::plain("evaluations", found.evaluations(), 1))
            .with(Cell::plain("least", least, 0))
            .with(Cell::plain("most", most, 0))
            .with(Cell::plain(CORRELATION, correlation, 3));
        rows.push(row);
    }
    Ok(rows)
}

/// The paper's very small steps.
pub(super) fn in_small_steps(
    model: &str,
    system: &OdePixel2Mesh,
    config: &OdeConfig,
    data: &Pairs,
) -> Result<Row, StudyError> {
    let small = OdeConfig {
        method: Method::Euler,
        step: [0.001, 0.005],
        tolerance: None,
        ..config.clone()
    };
    let found = system.with_config(&small).scored(data, Subset::Test)?;
    Ok(Row::new(ADAPTIVE, format!("{model}: Euler, steps of U(0.001, 0.005)'s mean"))
        .with(distance("CD", data, &found))
        .with(Cell::plain("evaluations", found.evaluations(), 1)))
}

/// The row of a model that is integrated to a tolerance.
pub(super) fn at_tolerance(model: &str, tolerance: f64) -> String {
    format!("{model}: tolerance {tolerance:e}")
}

/// What each family takes.
pub(super) fn by_family(
    system: &OdePixel2Mesh,
    data: &Pairs,
    scored: &Scored,
) -> Result<Vec<Row>, StudyError> {
    let complexities = complexities(system, data, scored.each.len())?;
    let parts = super::by_category(data, scored);
    let of = |(family, part): &(String, Scored)| {
        let mine = scored.each.iter().zip(&complexities);
        let mine = mine.filter(|((object, ..), _)| data.name(*object)[0] == family);
        let all: Vec<f64> = mine.map(|(_, complexity)| *complexity).collect();
        let mean = all.iter().sum::<f64>() / all.len().max(1) as f64;
        Row::new(FAMILIES, family)
            .with(distance("CD", data, part))
            .with(Cell::plain("complexity", 1e3 * mean, 2))
            .with(Cell::plain("evaluations", part.evaluations(), 2))
    };
    Ok(parts.iter().map(of).collect())
}

/// How far the true surface of each scored image is from the ellipsoid: Pixel2Mesh's Chamfer distance.
fn complexities(
    system: &OdePixel2Mesh,
    data: &Pairs,
    images: usize,
) -> Result<Vec<f64>, StudyError> {
    let ellipsoid = &system.template().finest().mesh.positions;
    let views = system.shared().pairs.scored_views;
    let far = |k: usize| {
        let (_, pair) = data.trial(Subset::Test, views, k)?;
        let (there, back) = point_distances(ellipsoid, &pair.truth.positions).chamfer(true);
        Ok(there + back)
    };
    (0..images).map(far).collect()
}

/// Spearman's, equal values sharing the mean of their ranks; 0 where one is constant.
fn rank_correlation(a: &[f64], b: &[f64]) -> f64 {
    let (a, b) = (ranks(a), ranks(b));
    let n = a.len() as f64;
    let mean = |x: &[f64]| x.iter().sum::<f64>() / n;
    let (ma, mb) = (mean(&a), mean(&b));
    let sum = |f: &dyn Fn(usize) -> f64| (0..a.len()).map(f).sum::<f64>();
    let both = sum(&|i| (a[i] - ma) * (b[i] - mb));
    let squares = sum(&|i| (a[i] - ma).powi(2)) * sum(&|i| (b[i] - mb).powi(2));
    if squares > 0.0 { both / squares.sqrt() } else { 0.0 }
}

fn ranks(x: &[f64]) -> Vec<f64> {
    let below = |v: f64| x.iter().filter(|&&other| other < v).count() as f64;
    let same = |v: f64| x.iter().filter(|&&other| other.to_bits() == v.to_bits()).count() as f64;
    x.iter().map(|&v| below(v) + 0.5 * (same(v) - 1.0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_correlate() {
        let a = [1.0, 2.0, 3.0, 10.0];
        assert!((rank_correlation(&a, &[2.0, 3.0, 5.0, 7.0]) - 1.0).abs() < 1e-12);
        assert!((rank_correlation(&a, &[9.0, 3.0, 2.0, 1.0]) + 1.0).abs() < 1e-12);
        assert!(rank_correlation(&a, &[5.0; 4]).abs() < 1e-12);
        assert_eq!(ranks(&[3.0, 1.0, 3.0]), [1.5, 0.0, 1.5]);
    }
}
