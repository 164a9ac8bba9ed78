//! The same on vector instructions: nine of them serve one query and one vector of points; four queries share each load.

use pulp::{Arch, Simd, WithSimd};

use super::hierarchy::{Found, Hierarchy, Leaf, ask};
use super::neighbor::Nearest;
use super::{NearestScratch, in_chunks};

/// Queries that share each load of points.
const TILE: usize = 4;
/// Points are padded to the widest vector there is.
const PAD: usize = 16;

/// [`nearest_into`](super::nearest_into) on a given instruction set.
pub fn nearest_with(
    arch: Arch,
    queries: &[[f32; 3]],
    points: &[[f32; 3]],
    scratch: &mut NearestScratch,
    found: &mut Vec<Nearest>,
) {
    let padded = points.len().next_multiple_of(PAD);
    for (axis, lane) in scratch.lanes.iter_mut().enumerate() {
        lane.clear();
        lane.extend(points.iter().map(|p| p[axis]));
        // Infinitely far away, so never strictly nearer than anything.
        lane.resize(padded, f32::INFINITY);
    }
    let [x, y, z] = &scratch.lanes;
    in_chunks(queries, points, found, |queries, found| {
        arch.dispatch(AllPairs { queries, x, y, z, found });
    });
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

/// What is nearest to the points of each leaf, in a hierarchy of others.
pub(super) fn nearest_in(arch: Arch, points: &Hierarchy, leaves: &[Leaf], found: &mut [Found]) {
    arch.dispatch(InHierarchy { points, leaves, found });
}

struct InHierarchy<'a> {
    points: &'a Hierarchy,
    leaves: &'a [Leaf],
    found: &'a mut [Found],
}

impl WithSimd for InHierarchy<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        ask(self.points, self.leaves, self.found);
    }
}

#[cfg(test)]
mod tests {
    use super::super::nearest_scalar;
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
                let (mut from, mut to) = (Hierarchy::default(), Hierarchy::default());
                from.build(&queries);
                to.build(&points);
                let mut by_leaf = vec![Found::NOTHING; from.leaves().len()];
                nearest_in(arch, &to, from.leaves(), &mut by_leaf);
                found.fill(Nearest::default());
                for (leaf, by_leaf) in from.leaves().iter().zip(&by_leaf) {
                    leaf.write(by_leaf, &mut found);
                }
                prop_assert_eq!(&found, &expected);
            }
        }
    }
}
