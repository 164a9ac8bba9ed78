//! Distances between point sets, and the figures made of them.

use mesh_core::{Nearest, NearestScratch, nearest_both_into};
use serde::Serialize;

/// The distance from every point of one set to the nearest of the other, both ways.
///
/// Distances are not squared; the nearest point is found in `f32`, its distance computed in `f64`.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct PointDistances {
    /// From each predicted point to the nearest true one.
    pub accuracy: Vec<f64>,
    /// From each true point to the nearest predicted one.
    pub completeness: Vec<f64>,
    /// For each predicted point, the index of the nearest true one.
    pub accuracy_index: Vec<u32>,
    /// For each true point, the index of the nearest predicted one.
    pub completeness_index: Vec<u32>,
}

/// Precision, recall and their harmonic mean at one distance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct FScore {
    /// The distance (never squared) below which a point counts as matched.
    pub threshold: f64,
    /// The share of predicted points closer than `threshold` to the truth.
    pub precision: f64,
    /// The share of true points closer than `threshold` to the prediction.
    pub recall: f64,
    /// `2 P R / (P + R)`; 0 when both are 0.
    pub f_score: f64,
}

/// Finds the distances between two point sets; exact, `O(P Q)` in brute force.
///
/// # Panics
/// If a set is empty.
///
/// ```
/// let d = losses::metrics::point_distances(&[[0.0; 3]], &[[3.0, 4.0, 0.0], [9.0, 0.0, 0.0]]);
/// assert_eq!(d.accuracy, [5.0]);
/// assert_eq!(d.chamfer(false), (5.0, 7.0));
/// ```
pub fn point_distances(prediction: &[[f32; 3]], truth: &[[f32; 3]]) -> PointDistances {
    assert!(
        !prediction.is_empty() && !truth.is_empty(),
        "point_distances: both sets need points, found {} and {}",
        prediction.len(),
        truth.len()
    );
    let (mut to_truth, mut to_prediction) = (Vec::new(), Vec::new());
    let mut scratch = NearestScratch::default();
    nearest_both_into(prediction, truth, &mut scratch, &mut to_truth, &mut to_prediction);
    let (accuracy_index, accuracy) = sided(prediction, truth, &to_truth);
    let (completeness_index, completeness) = sided(truth, prediction, &to_prediction);
    PointDistances { accuracy, completeness, accuracy_index, completeness_index }
}

fn sided(queries: &[[f32; 3]], points: &[[f32; 3]], found: &[Nearest]) -> (Vec<u32>, Vec<f64>) {
    let index: Vec<u32> = found.iter().map(|n| n.index).collect();
    let distance =
        queries.iter().zip(&index).map(|(q, &i)| distance(q, &points[i as usize])).collect();
    (index, distance)
}

fn distance(a: &[f32; 3], b: &[f32; 3]) -> f64 {
    let d: [f64; 3] = std::array::from_fn(|k| f64::from(a[k]) - f64::from(b[k]));
    (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt()
}

impl PointDistances {
    /// The mean distances (squared if `squared`): prediction to truth, and truth to prediction.
    pub fn chamfer(&self, squared: bool) -> (f64, f64) {
        let mean = |d: &[f64]| {
            let total: f64 = d.iter().map(|d| if squared { d * d } else { *d }).sum();
            total / d.len() as f64
        };
        (mean(&self.accuracy), mean(&self.completeness))
    }

    /// Precision, recall and F-score at a distance (not squared); a distance equal to it does not count.
    pub fn f_score(&self, threshold: f64) -> FScore {
        let share =
            |d: &[f64]| d.iter().filter(|&&d| d < threshold).count() as f64 / d.len() as f64;
        let (precision, recall) = (share(&self.accuracy), share(&self.completeness));
        let sum = precision + recall;
        let f_score = if sum > 0.0 { 2.0 * precision * recall / sum } else { 0.0 };
        FScore { threshold, precision, recall, f_score }
    }

    /// The mean `|cos|` between the unit normals of nearest points, averaged over both ways.
    pub fn normal_consistency(&self, prediction: &[[f32; 3]], truth: &[[f32; 3]]) -> f64 {
        let one_way = |own: &[[f32; 3]], other: &[[f32; 3]], index: &[u32]| {
            let total: f64 = own
                .iter()
                .zip(index)
                .map(|(a, &i)| {
                    let b = &other[i as usize];
                    let dot: f64 = (0..3).map(|k| f64::from(a[k]) * f64::from(b[k])).sum();
                    dot.abs().min(1.0)
                })
                .sum();
            total / own.len() as f64
        };
        0.5 * (one_way(prediction, truth, &self.accuracy_index)
            + one_way(truth, prediction, &self.completeness_index))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn points() -> impl Strategy<Value = Vec<[f32; 3]>> {
        proptest::collection::vec(proptest::array::uniform3(-1.0f32..1.0), 1..40)
    }

    proptest! {
        #[test]
        fn a_set_is_at_no_distance_from_itself(p in points()) {
            let d = point_distances(&p, &p);
            prop_assert_eq!(d.chamfer(true), (0.0, 0.0));
            prop_assert_eq!(d.f_score(1e-12).f_score, 1.0);
        }

        #[test]
        fn the_order_of_the_points_does_not_matter(p in points(), q in points(), turn in 0usize..40) {
            let mut moved = p.clone();
            moved.rotate_left(turn % p.len());
            let (a, b) = (point_distances(&p, &q), point_distances(&moved, &q));
            let ((a0, a1), (b0, b1)) = (a.chamfer(true), b.chamfer(true));
            prop_assert!((a0 - b0).abs() < 1e-12 && (a1 - b1).abs() < 1e-12);
            prop_assert_eq!(a.f_score(0.3), b.f_score(0.3));
        }

        #[test]
        fn swapping_the_sets_swaps_the_directions(p in points(), q in points()) {
            let (a, b) = (point_distances(&p, &q), point_distances(&q, &p));
            prop_assert_eq!(a.chamfer(false).0, b.chamfer(false).1);
            prop_assert_eq!(a.f_score(0.4).f_score, b.f_score(0.4).f_score);
        }
    }

    #[test]
    fn f_score_by_hand() {
        // Two of four predicted points are near, one of two true ones: P 1/2, R 1/2.
        let p = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [5.0, 0.0, 0.0], [6.0, 0.0, 0.0]];
        let q = [[0.0, 0.0, 0.0], [0.0, 9.0, 0.0]];
        let f = point_distances(&p, &q).f_score(0.5);
        assert_eq!((f.precision, f.recall, f.f_score), (0.5, 0.5, 0.5));
    }
}
