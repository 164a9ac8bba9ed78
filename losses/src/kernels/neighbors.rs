//! The k nearest of a set of points, in either precision.

use autodiff_lite::Real;
use autodiff_lite::kernels::parallel::{InParts, Parts};

/// How far apart two points are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Norm {
    /// `Σ |x - y|`: PyTorch3D's `norm=1`.
    L1,
    /// `Σ (x - y)²`, the **square** of the Euclidean distance: PyTorch3D's `norm=2`.
    #[default]
    L2,
}

impl Norm {
    /// The distance between two points of the same number of coordinates.
    #[inline]
    pub fn between<F: Real>(self, x: &[F], y: &[F]) -> F {
        let pairs = x.iter().zip(y);
        match self {
            Self::L1 => pairs.map(|(&x, &y)| (x - y).abs()).sum(),
            Self::L2 => pairs.map(|(&x, &y)| (x - y) * (x - y)).sum(),
        }
    }

    /// The derivative of the distance by a coordinate of `x`; zero where both agree.
    #[inline]
    pub fn derivative<F: Real>(self, x: F, y: F) -> F {
        match self {
            Self::L2 => (x - y) + (x - y),
            Self::L1 if x > y => F::one(),
            Self::L1 if x < y => -F::one(),
            Self::L1 => F::zero(),
        }
    }
}

/// Queries of one task.
const CHUNK: usize = 64;

/// Writes, for each query, the indices of the `k` nearest targets, nearest first, and of equally near ones the lowest
/// first. Queries and targets have `width` coordinates.
///
/// All pairs are compared. What is not a number is further than all else.
///
/// # Panics
/// If there are fewer than `k` targets, or a slice has another length.
pub fn k_nearest<F: Real>(
    queries: &[F],
    targets: &[F],
    width: usize,
    k: usize,
    norm: Norm,
    indices: &mut [u32],
) {
    if k == 0 || queries.is_empty() {
        return;
    }
    assert!(width > 0 && targets.len() >= k * width, "{k} nearest of fewer points");
    assert_eq!(indices.len(), queries.len() / width * k);
    let chunks = queries.par_chunks(CHUNK * width).zip(indices.par_chunks_mut(CHUNK * k));
    chunks.for_each(|(queries, indices)| {
        let mut distances = vec![F::zero(); k];
        for (query, indices) in queries.chunks_exact(width).zip(indices.chunks_exact_mut(k)) {
            nearest_of_one(query, targets, norm, &mut distances, indices);
        }
    });
}

fn nearest_of_one<F: Real>(
    query: &[F],
    targets: &[F],
    norm: Norm,
    distances: &mut [F],
    indices: &mut [u32],
) {
    let k = indices.len();
    let mut found = 0;
    for (j, target) in targets.chunks_exact(query.len()).enumerate() {
        let distance = norm.between(query, target);
        let distance = if distance.is_nan() { F::infinity() } else { distance };
        if found == k && distance >= distances[k - 1] {
            continue;
        }
        // The first of those further away makes room.
        let place = distances[..found].partition_point(|&d| d <= distance);
        found = (found + 1).min(k);
        distances.copy_within(place..found - 1, place + 1);
        indices.copy_within(place..found - 1, place + 1);
        (distances[place], indices[place]) = (distance, j as u32);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// As sorting all of them would say, ties by index.
        #[test]
        fn sorted_and_cut(
            queries in proptest::collection::vec(-3i8..3, 2..400),
            targets in proptest::collection::vec(-3i8..3, 10..60),
            k in 1usize..5,
            squared: bool,
        ) {
            let norm = if squared { Norm::L2 } else { Norm::L1 };
            let wide = |x: &[i8]| -> Vec<f64> {
                x[..x.len() / 2 * 2].iter().map(|&x| f64::from(x)).collect()
            };
            let (queries, targets) = (wide(&queries), wide(&targets));
            let mut found = vec![0; queries.len() / 2 * k];
            k_nearest(&queries, &targets, 2, k, norm, &mut found);
            for (query, found) in queries.chunks(2).zip(found.chunks(k)) {
                let mut all: Vec<_> = targets
                    .chunks(2)
                    .enumerate()
                    .map(|(j, target)| (norm.between(query, target), j as u32))
                    .collect();
                all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                let expected: Vec<u32> = all[..k].iter().map(|&(_, j)| j).collect();
                prop_assert_eq!(found, &expected[..]);
            }
        }
    }

    #[test]
    fn no_number_is_furthest() {
        let mut found = [9; 2];
        k_nearest(&[0.0], &[f32::NAN, 5.0, 1.0], 1, 2, Norm::L2, &mut found);
        assert_eq!(found, [2, 1]);
    }
}
