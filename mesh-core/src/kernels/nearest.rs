//! Nearest neighbours between two sets of points, exact, by comparing all pairs.
//!
//! Comparing all pairs costs the same whatever the points do, which matters to a loss: early in a
//! training the two sets are far apart, and there grids and trees are slowest. Nine vector
//! instructions serve one query and one vector of points; four queries share each load.

use pulp::{Arch, Simd, WithSimd};

use super::threads::for_each_pair;

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
    lanes: [Vec<f32>; 3],
}

/// Queries per parallel task: fixed, and a multiple of the tile.
const CHUNK: usize = 64;
/// Queries that share each load of points.
const TILE: usize = 4;
/// Points are padded to the widest vector there is.
const PAD: usize = 16;
/// Pairs below which handing out tasks costs more than it brings.
const SERIAL_PAIRS: usize = 1 << 18;

/// For each query the nearest of `points`.
///
/// The squared distance is computed in `f32` as `fma(dz, dz, fma(dy, dy, dx·dx))`, and the lowest
/// index wins ties, so the result is the same on every machine and for any number of threads. A
/// query that is not finite, or finite but further than `f32` can square, gets index 0 and infinity;
/// such points are never chosen.
///
/// # Cost
/// `O(Q P)`: 2466 x 9000 in both directions takes about 1.2 ms on two AVX-512 cores (bench `mesh`).
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
    nearest_with(Arch::new(), queries, points, scratch, found);
}

/// [`nearest_into`] on a given instruction set.
pub fn nearest_with(
    arch: Arch,
    queries: &[[f32; 3]],
    points: &[[f32; 3]],
    scratch: &mut NearestScratch,
    found: &mut Vec<Nearest>,
) {
    assert!(!points.is_empty() || queries.is_empty(), "nearest: no points for the queries");
    assert!(u32::try_from(points.len()).is_ok(), "nearest: {} points exceed u32", points.len());
    let padded = points.len().next_multiple_of(PAD);
    for (axis, lane) in scratch.lanes.iter_mut().enumerate() {
        lane.clear();
        lane.extend(points.iter().map(|p| p[axis]));
        // Infinitely far away, so never strictly nearer than anything.
        lane.resize(padded, f32::INFINITY);
    }
    found.clear();
    found.resize(queries.len(), Nearest::default());

    let [x, y, z] = &scratch.lanes;
    let run = |queries: &[[f32; 3]], found: &mut [Nearest]| {
        arch.dispatch(AllPairs { queries, x, y, z, found });
    };
    if queries.len().saturating_mul(points.len()) < SERIAL_PAIRS {
        run(queries, found);
    } else {
        for_each_pair(queries, found, CHUNK, run);
    }
}

/// The obvious loop, for tests.
pub fn nearest_scalar(queries: &[[f32; 3]], points: &[[f32; 3]]) -> Vec<Nearest> {
    let search = |q: &[f32; 3]| {
        let mut best = Nearest { index: 0, squared: f32::INFINITY };
        for (index, p) in points.iter().enumerate() {
            let [dx, dy, dz] = [q[0] - p[0], q[1] - p[1], q[2] - p[2]];
            let squared = dz.mul_add(dz, dy.mul_add(dy, dx * dx));
            if squared < best.squared {
                best = Nearest { index: index as u32, squared };
            }
        }
        best
    };
    queries.iter().map(search).collect()
}

struct AllPairs<'a> {
    queries: &'a [[f32; 3]],
    x: &'a [f32],
    y: &'a [f32],
    z: &'a [f32],
    found: &'a mut [Nearest],
}

impl WithSimd for AllPairs<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (x, _) = S::as_simd_f32s(self.x);
        let (y, _) = S::as_simd_f32s(self.y);
        let (z, _) = S::as_simd_f32s(self.z);
        let mut tiles = self.queries.chunks_exact(TILE);
        let mut outputs = self.found.chunks_exact_mut(TILE);
        for (queries, found) in (&mut tiles).zip(&mut outputs) {
            tile::<S, TILE>(simd, queries, x, y, z, found);
        }
        let rest = outputs.into_remainder();
        for (query, found) in tiles.remainder().chunks(1).zip(rest.chunks_mut(1)) {
            tile::<S, 1>(simd, query, x, y, z, found);
        }
    }
}

/// `N` queries against all points. Each lane keeps its own nearest; the lanes are compared last.
#[inline(always)]
fn tile<S: Simd, const N: usize>(
    simd: S,
    queries: &[[f32; 3]],
    x: &[S::f32s],
    y: &[S::f32s],
    z: &[S::f32s],
    found: &mut [Nearest],
) {
    let queries: [[S::f32s; 3]; N] =
        std::array::from_fn(|i| queries[i].map(|v| simd.splat_f32s(v)));
    let mut squared = [simd.splat_f32s(f32::INFINITY); N];
    let mut block = [simd.splat_u32s(0); N];
    for (k, ((&x, &y), &z)) in x.iter().zip(y).zip(z).enumerate() {
        let here = simd.splat_u32s(k as u32);
        for i in 0..N {
            let dx = simd.sub_f32s(queries[i][0], x);
            let dy = simd.sub_f32s(queries[i][1], y);
            let dz = simd.sub_f32s(queries[i][2], z);
            let d = simd.mul_f32s(dx, dx);
            let d = simd.mul_add_f32s(dy, dy, d);
            let d = simd.mul_add_f32s(dz, dz, d);
            // Strictly nearer: of equals in one lane the first stays.
            let nearer = simd.less_than_f32s(d, squared[i]);
            squared[i] = simd.select_f32s(nearer, d, squared[i]);
            block[i] = simd.select_u32s(nearer, here, block[i]);
        }
    }
    // Written out whole before any lane is looked at: a reference into the accumulators would keep
    // them in memory, and store them all in every turn of the loop above.
    let (mut distances, mut blocks) = ([[0.0_f32; PAD]; N], [[0_u32; PAD]; N]);
    for i in 0..N {
        S::as_mut_simd_f32s(&mut distances[i]).0[0] = squared[i];
        S::as_mut_simd_u32s(&mut blocks[i]).0[0] = block[i];
    }
    for (found, (distances, blocks)) in found.iter_mut().zip(distances.iter().zip(&blocks)) {
        let mut best = Nearest { index: u32::MAX, squared: f32::INFINITY };
        let lanes = distances.iter().zip(blocks).take(S::F32_LANES);
        for (lane, (&squared, &block)) in lanes.enumerate() {
            let index = block * S::F32_LANES as u32 + lane as u32;
            if squared < best.squared || (squared == best.squared && index < best.index) {
                best = Nearest { index, squared };
            }
        }
        *found = best;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Every instruction set that this machine has.
    pub(crate) fn arches() -> Vec<Arch> {
        let mut arches = vec![Arch::Scalar, Arch::new()];
        #[cfg(target_arch = "x86_64")]
        arches.extend(pulp::x86::V3::try_new().map(Arch::V3));
        arches
    }

    fn cloud(max: usize) -> impl Strategy<Value = Vec<[f32; 3]>> {
        // Few distinct values, so that ties are common.
        let small = prop::array::uniform3((-3_i8..=3).prop_map(f32::from));
        let any = prop::array::uniform3(-10.0_f32..10.0);
        prop::collection::vec(prop_oneof![small, any], 1..max)
    }

    proptest! {
        #[test]
        fn simd_equals_scalar(queries in cloud(70), points in cloud(90)) {
            let expected = nearest_scalar(&queries, &points);
            for arch in arches() {
                let (mut scratch, mut found) = (NearestScratch::default(), Vec::new());
                nearest_with(arch, &queries, &points, &mut scratch, &mut found);
                prop_assert_eq!(&found, &expected);
            }
        }
    }

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
