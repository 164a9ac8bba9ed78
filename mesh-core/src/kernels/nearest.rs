//! Nearest neighbours between two sets of points, exact: by comparing all pairs or, where these are many, in boxes of boxes.
//!
//! Comparing all pairs costs the same whatever the points do. Boxes cost a tenth of it between two surfaces that lie near each
//! other, and up to twice as much where all points are as far from all queries.

mod hierarchy;
mod neighbor;
#[cfg(feature = "simd")]
mod simd;

use super::threads::{for_each, for_each_pair};
use hierarchy::{Found, Hierarchy};
pub use neighbor::Nearest;
#[cfg(feature = "simd")]
pub use simd::nearest_with;

/// Room that [`nearest_into`] works in; keep it between calls and nothing is allocated.
#[derive(Clone, Debug, Default)]
pub struct NearestScratch {
    /// x, y, z of the points, each padded to whole vectors.
    #[cfg(feature = "simd")]
    lanes: [Vec<f32>; 3],
    queries: Hierarchy,
    points: Hierarchy,
    by_leaf: Vec<Found>,
}

/// Queries per parallel task: fixed, and a multiple of the tile.
const CHUNK: usize = 64;
/// Leaves of queries per parallel task: fixed.
const LEAVES: usize = 4;
/// Pairs below which handing out tasks costs more than it brings.
const SERIAL_PAIRS: usize = 1 << 18;
/// Pairs from which on hierarchies are built: what they cost is little then beside comparing them all.
const HIERARCHY_PAIRS: usize = 1 << 20;

/// For each query the nearest of `points`.
///
/// The squared distance is computed in `f32` as `fma(dz, dz, fma(dy, dy, dx·dx))`, and the lowest
/// index wins ties, so the result is the same on every machine and for any number of threads. A
/// query that is not finite, or finite but further than `f32` can square, gets index 0 and infinity;
/// such points are never chosen.
///
/// # Cost
/// `O((P + Q) log P)` where the sets lie near each other; `O(Q P)` below 2^20 pairs, and where all points are as near.
/// # Panics
/// If there are queries but no points, or more than `u32::MAX` points.
pub fn nearest(queries: &[[f32; 3]], points: &[[f32; 3]]) -> Vec<Nearest> {
    let mut found = Vec::new();
    nearest_into(queries, points, &mut NearestScratch::default(), &mut found);
    found
}

/// [`nearest`] into a vector that is reused.
pub fn nearest_into(
    queries: &[[f32; 3]],
    points: &[[f32; 3]],
    scratch: &mut NearestScratch,
    found: &mut Vec<Nearest>,
) {
    check(queries, points);
    if !are_many(queries, points) {
        return compare_all(queries, points, scratch, found);
    }
    let NearestScratch { queries: from, points: to, by_leaf, .. } = scratch;
    for_each([(&mut *from, queries), (&mut *to, points)].into_iter(), |(hierarchy, points)| {
        hierarchy.build(points);
    });
    in_hierarchy(from, to, queries.len(), by_leaf, found);
}

/// [`nearest_into`] both ways: for each point of `x` the nearest of `y`, and for each of `y` the nearest of `x`. Both are put in
/// order once.
///
/// ```
/// use mesh_core::{Nearest, NearestScratch, nearest_both_into};
///
/// let (x, y) = ([[0.0; 3], [1.0; 3]], [[2.0_f32, 1.0, 1.0]]);
/// let (mut x_to_y, mut y_to_x) = (Vec::new(), Vec::new());
/// nearest_both_into(&x, &y, &mut NearestScratch::default(), &mut x_to_y, &mut y_to_x);
/// assert_eq!(x_to_y, [Nearest { index: 0, squared: 6.0 }, Nearest { index: 0, squared: 1.0 }]);
/// assert_eq!(y_to_x, [Nearest { index: 1, squared: 1.0 }]);
/// ```
///
/// # Cost
/// As [`nearest`]'s for both: 2466 and 9000 points of two surfaces take about 0.8 ms on two AVX-512 cores (bench `mesh`).
/// # Panics
/// If one set is empty and the other is not, or one has more than `u32::MAX` points.
pub fn nearest_both_into(
    x: &[[f32; 3]],
    y: &[[f32; 3]],
    scratch: &mut NearestScratch,
    x_to_y: &mut Vec<Nearest>,
    y_to_x: &mut Vec<Nearest>,
) {
    nearest_into(x, y, scratch, x_to_y);
    check(y, x);
    if !are_many(x, y) {
        return compare_all(y, x, scratch, y_to_x);
    }
    let NearestScratch { queries: from, points: to, by_leaf, .. } = scratch;
    in_hierarchy(to, from, y.len(), by_leaf, y_to_x);
}

fn check(queries: &[[f32; 3]], points: &[[f32; 3]]) {
    assert!(!points.is_empty() || queries.is_empty(), "nearest: no points for the queries");
    for count in [queries.len(), points.len()] {
        assert!(u32::try_from(count).is_ok(), "nearest: {count} points exceed u32");
    }
}

fn are_many(queries: &[[f32; 3]], points: &[[f32; 3]]) -> bool {
    queries.len().saturating_mul(points.len()) >= HIERARCHY_PAIRS
}

/// [`nearest_into`] by comparing all pairs.
fn compare_all(
    queries: &[[f32; 3]],
    points: &[[f32; 3]],
    scratch: &mut NearestScratch,
    found: &mut Vec<Nearest>,
) {
    #[cfg(feature = "simd")]
    nearest_with(pulp::Arch::new(), queries, points, scratch, found);
    #[cfg(not(feature = "simd"))]
    {
        let _ = scratch;
        in_chunks(queries, points, found, |queries, found| compare(queries, points, found));
    }
}

/// [`nearest_into`] by hierarchies of both.
fn in_hierarchy(
    queries: &Hierarchy,
    points: &Hierarchy,
    count: usize,
    by_leaf: &mut Vec<Found>,
    found: &mut Vec<Nearest>,
) {
    let leaves = queries.leaves();
    by_leaf.clear();
    by_leaf.resize(leaves.len(), Found::NOTHING);
    for_each_pair(leaves, by_leaf, LEAVES, |leaves, by_leaf| {
        #[cfg(feature = "simd")]
        simd::nearest_in(pulp::Arch::new(), points, leaves, by_leaf);
        #[cfg(not(feature = "simd"))]
        hierarchy::ask(points, leaves, by_leaf);
    });
    found.clear();
    found.resize(count, Nearest { index: 0, squared: f32::INFINITY });
    for (leaf, by_leaf) in leaves.iter().zip(by_leaf) {
        leaf.write(by_leaf, found);
    }
}

/// The obvious loop, which the others are compared with.
#[cfg(test)]
fn nearest_scalar(queries: &[[f32; 3]], points: &[[f32; 3]]) -> Vec<Nearest> {
    let mut found = vec![Nearest::default(); queries.len()];
    compare(queries, points, &mut found);
    found
}

/// Checks the sizes and calls `run` with parts of the queries and what is found for them, on several threads if that pays.
fn in_chunks(
    queries: &[[f32; 3]],
    points: &[[f32; 3]],
    found: &mut Vec<Nearest>,
    run: impl Fn(&[[f32; 3]], &mut [Nearest]) + Sync,
) {
    check(queries, points);
    found.clear();
    found.resize(queries.len(), Nearest::default());
    if queries.len().saturating_mul(points.len()) < SERIAL_PAIRS {
        run(queries, found);
    } else {
        for_each_pair(queries, found, CHUNK, run);
    }
}

#[cfg(any(test, not(feature = "simd")))]
fn compare(queries: &[[f32; 3]], points: &[[f32; 3]], found: &mut [Nearest]) {
    for (q, found) in queries.iter().zip(found) {
        let mut best = Nearest { index: 0, squared: f32::INFINITY };
        for (index, p) in points.iter().enumerate() {
            let [dx, dy, dz] = [q[0] - p[0], q[1] - p[1], q[2] - p[2]];
            let squared = dz.mul_add(dz, dy.mul_add(dy, dx * dx));
            if squared < best.squared {
                best = Nearest { index: index as u32, squared };
            }
        }
        *found = best;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_clouds_go_parallel_and_stay_equal() {
        let grid = |n: usize, step: f32| -> Vec<[f32; 3]> {
            (0..n)
                .map(|i| [(i % 17) as f32 * step, (i / 17 % 19) as f32, (i / 323) as f32])
                .collect()
        };
        let (queries, points) = (grid(1003, 0.7), grid(1501, 1.3));
        assert_eq!(nearest(&queries, &points), nearest_scalar(&queries, &points));
    }

    #[test]
    fn many_pairs_find_the_same_in_boxes() {
        // A shell and points around its middle, from where every part of it is as near.
        let point = |i: usize, scale: f32| {
            let (a, b) = (i as f32 * 0.7, i as f32 * 0.013);
            [a.cos() * b.sin(), a.sin() * b.sin(), b.cos()].map(|v| v * scale)
        };
        let x: Vec<_> = (0..5_003).map(|i| point(i, (i % 7) as f32 * 0.3)).collect();
        let y: Vec<_> = (0..4_001).map(|i| point(3 * i, 1.0)).collect();
        assert!(are_many(&x, &y));
        assert_eq!(nearest(&x, &y), nearest_scalar(&x, &y));
        let (mut x_to_y, mut y_to_x) = (Vec::new(), Vec::new());
        let mut scratch = NearestScratch::default();
        for part in [&y[..], &y[..5]] {
            nearest_both_into(&x, part, &mut scratch, &mut x_to_y, &mut y_to_x);
            assert_eq!(x_to_y, nearest_scalar(&x, part));
            assert_eq!(y_to_x, nearest_scalar(part, &x));
        }
    }

    #[test]
    fn numbers_that_are_not_finite() {
        let points = [[f32::NAN, 0.0, 0.0], [1.0, 0.0, 0.0], [f32::INFINITY, 0.0, 0.0]];
        let queries = [[0.0; 3], [f32::NAN; 3], [f32::INFINITY; 3], [3e38, 0.0, 0.0]];
        let found = nearest(&queries, &points);
        assert_eq!(found[0], Nearest { index: 1, squared: 1.0 });
        for lost in &found[1..] {
            assert_eq!(*lost, Nearest { index: 0, squared: f32::INFINITY });
        }
        assert!(nearest(&[], &[]).is_empty());
    }

    #[test]
    #[should_panic(expected = "no points")]
    fn no_points() {
        nearest(&[[0.0; 3]], &[]);
    }
}
