//! Nearest neighbours between two sets of points, exact: by comparing all pairs or, where these are very many, in a k-d tree.
//!
//! Comparing all pairs costs the same whatever the points do, which matters to a loss: early in a
//! training the two sets are far apart, and there grids and trees are slowest. Metrics compare a
//! hundred thousand points with as many, which was three quarters of a small fit before there was a tree.

#[cfg(feature = "simd")]
mod simd;
mod tree;

use super::threads::for_each_pair;
#[cfg(feature = "simd")]
pub use simd::nearest_with;
use tree::Tree;

/// The point nearest to a query.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Nearest {
    /// Its index; the lowest one where several are equally near.
    pub index: u32,
    /// The squared distance to it.
    pub squared: f32,
}

/// Room that [`nearest_into`] works in; keep it between calls and nothing is allocated.
#[derive(Clone, Debug, Default)]
pub struct NearestScratch {
    /// x, y, z of the points, each padded to whole vectors.
    #[cfg(feature = "simd")]
    lanes: [Vec<f32>; 3],
    tree: Tree,
}

/// Queries per parallel task: fixed, and a multiple of the tile.
const CHUNK: usize = 64;
/// Pairs below which handing out tasks costs more than it brings.
const SERIAL_PAIRS: usize = 1 << 18;
/// Pairs from which on a tree is built: what it costs then is little beside comparing them all.
const TREE_PAIRS: usize = 1 << 27;

/// For each query the nearest of `points`.
///
/// The squared distance is computed in `f32` as `fma(dz, dz, fma(dy, dy, dx·dx))`, and the lowest
/// index wins ties, so the result is the same on every machine and for any number of threads. A
/// query that is not finite, or finite but further than `f32` can square, gets index 0 and infinity;
/// such points are never chosen.
///
/// # Cost
/// `O(Q P)`: 2466 x 9000 in both directions takes about 1.2 ms on two AVX-512 cores (bench `mesh`). From 2^27 pairs on
/// `O((P + Q) log P)` where the sets lie near each other, and about as much as before where they do not.
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
    if queries.len().saturating_mul(points.len()) >= TREE_PAIRS {
        return in_tree(queries, points, scratch, found);
    }
    #[cfg(feature = "simd")]
    nearest_with(pulp::Arch::new(), queries, points, scratch, found);
    #[cfg(not(feature = "simd"))]
    in_chunks(queries, points, found, |queries, found| compare(queries, points, found));
}

/// [`nearest_into`] by a tree.
fn in_tree(
    queries: &[[f32; 3]],
    points: &[[f32; 3]],
    scratch: &mut NearestScratch,
    found: &mut Vec<Nearest>,
) {
    scratch.tree.build(points);
    let tree = &scratch.tree;
    in_chunks(queries, points, found, |queries, found| {
        #[cfg(feature = "simd")]
        simd::nearest_in(pulp::Arch::new(), tree, queries, found);
        #[cfg(not(feature = "simd"))]
        for (query, found) in queries.iter().zip(found) {
            let (index, squared) = tree.nearest(*query, tree::scan);
            *found = Nearest { index, squared };
        }
    });
}

/// The obvious loop, for tests.
pub fn nearest_scalar(queries: &[[f32; 3]], points: &[[f32; 3]]) -> Vec<Nearest> {
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
    assert!(!points.is_empty() || queries.is_empty(), "nearest: no points for the queries");
    assert!(u32::try_from(points.len()).is_ok(), "nearest: {} points exceed u32", points.len());
    found.clear();
    found.resize(queries.len(), Nearest::default());
    if queries.len().saturating_mul(points.len()) < SERIAL_PAIRS {
        run(queries, found);
    } else {
        for_each_pair(queries, found, CHUNK, run);
    }
}

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
    fn very_many_pairs_find_the_same_in_a_tree() {
        // A shell and points around its middle, from where every part of it is as near.
        let point = |i: usize, scale: f32| {
            let (a, b) = (i as f32 * 0.7, i as f32 * 0.013);
            [a.cos() * b.sin(), a.sin() * b.sin(), b.cos()].map(|v| v * scale)
        };
        let queries: Vec<_> = (0..12_000).map(|i| point(i, (i % 7) as f32 * 0.3)).collect();
        let points: Vec<_> = (0..12_000).map(|i| point(3 * i, 1.0)).collect();
        assert!(queries.len() * points.len() > TREE_PAIRS);
        assert_eq!(nearest(&queries, &points), nearest_scalar(&queries, &points));
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
