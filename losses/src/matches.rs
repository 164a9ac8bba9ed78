//! Which points of two sets are nearest to each other: a plain value, since it is not differentiable.

use autodiff_lite::{Real, Var};

use crate::kernels::matching::{Scratch, nearest_indices};
use crate::kernels::neighbors::{Norm, k_nearest};
use crate::scalar::vertices;

/// Which point of one set is nearest to each point of the other, both ways.
///
/// Keep it from step to step: it is then found again in the same memory.
///
/// ```
/// use autodiff_lite::Tape;
/// use losses::{Directions, Matches, chamfer_distance};
///
/// let tape = Tape::<f32>::train(0);
/// let x = tape.leaf(ndarray::arr2(&[[0.0, 0.0, 0.0]]));
/// let y = tape.constant(ndarray::arr2(&[[3.0, 0.0, 0.0], [0.0, 4.0, 0.0]]));
/// let mut matches = Matches::default();
/// matches.find(x, y);
/// assert_eq!(matches.x_to_y(), [0]);
/// let loss = chamfer_distance(x, y, &matches, Directions::default());
/// assert_eq!(loss.item(), 9.0 + (9.0 + 16.0) / 2.0);
/// ```
#[derive(Clone, Debug, Default)]
pub struct Matches {
    x_to_y: Vec<u32>,
    y_to_x: Vec<u32>,
    scratch: Scratch,
}

impl Matches {
    /// Finds the nearest points of two sets, or of N pairs of sets.
    ///
    /// # Shapes
    /// `x [P, 3]` and `y [Q, 3]`, or `[N, P, 3]` and `[N, Q, 3]`.
    ///
    /// # Cost
    /// In `f32` as [`nearest_both_into`](mesh_core::nearest_both_into)'s, set by set: 2466 x 9000 points of two surfaces take
    /// about 0.8 ms on two AVX-512 cores (bench `losses`). In `f64` `O(N P Q)`.
    /// # Panics
    /// If the shapes are others, or one set is empty and the other is not.
    #[track_caller]
    pub fn find<F: Real>(&mut self, x: Var<'_, F>, y: Var<'_, F>) {
        self.find_by(x, y, nearest_indices);
    }

    /// [`find`](Self::find) under the L1 norm, `|Δx| + |Δy| + |Δz|`: for [`chamfer_l1`](crate::chamfer_l1).
    ///
    /// # Shapes
    /// As for [`find`](Self::find).
    ///
    /// # Cost
    /// `O(N P Q)`, in parallel over points.
    /// # Panics
    /// As [`find`](Self::find).
    #[track_caller]
    pub fn find_l1<F: Real>(&mut self, x: Var<'_, F>, y: Var<'_, F>) {
        self.find_by(x, y, |[x, y], _, indices| {
            for ((from, to), found) in [(x, y), (y, x)].into_iter().zip(indices) {
                let before = found.len();
                found.resize(before + from.len() / 3, 0);
                k_nearest(from, to, 3, 1, Norm::L1, &mut found[before..]);
            }
        });
    }

    /// Set by set; `nearest` puts behind what is found already, for each point of both, the nearest of the other.
    #[track_caller]
    fn find_by<F: Real>(
        &mut self,
        x: Var<'_, F>,
        y: Var<'_, F>,
        nearest: impl Fn([&[F]; 2], &mut Scratch, [&mut Vec<u32>; 2]),
    ) {
        let [n, p, q] = sets("chamfer matches", x, y);
        self.x_to_y.clear();
        self.y_to_x.clear();
        let (x, y) = (x.value(), y.value());
        let (x, y) = (x.as_slice(), y.as_slice());
        for k in 0..n {
            let (x, y) = (&x[3 * k * p..3 * (k + 1) * p], &y[3 * k * q..3 * (k + 1) * q]);
            nearest([x, y], &mut self.scratch, [&mut self.x_to_y, &mut self.y_to_x]);
        }
    }

    /// For each point of the first set the nearest of the second; set after set in a batch.
    pub fn x_to_y(&self) -> &[u32] {
        &self.x_to_y
    }

    /// For each point of the second set the nearest of the first; set after set in a batch.
    pub fn y_to_x(&self) -> &[u32] {
        &self.y_to_x
    }
}

/// N, P and Q of two sets or of two batches of sets.
#[track_caller]
pub(crate) fn sets<F: Real>(name: &'static str, x: Var<'_, F>, y: Var<'_, F>) -> [usize; 3] {
    let ([n, p], [m, q]) = (vertices(name, "x", x), vertices(name, "y", y));
    if n != m || (p == 0) != (q == 0) {
        let message = "two sets of points, or as many of the one as of the other, expected";
        let operands = [("x", &x.shape()[..], "N, P, 3"), ("y", &y.shape(), "N, Q, 3")];
        x.tape().refuse(name, message, &operands);
    }
    [n, p, q]
}

#[cfg(test)]
mod tests {
    use autodiff_lite::Tape;
    use proptest::prelude::*;

    use super::*;
    use crate::testing;

    proptest! {
        #[test]
        fn single_and_double_precision_match_alike(p in 1usize..40, q in 1usize..40, seed: u64) {
            let drawn = testing::options(seed).draw(&[vec![p, 3], vec![q, 3]]);
            // The same numbers in both precisions.
            let single = drawn.iter().map(|a| a.mapv(|v| v as f32)).collect::<Vec<_>>();
            let (coarse, fine) = (Tape::<f32>::eval(), Tape::<f64>::eval());
            let (mut a, mut b) = (Matches::default(), Matches::default());
            a.find(coarse.constant(single[0].clone()), coarse.constant(single[1].clone()));
            let double = single.iter().map(|a| a.mapv(f64::from)).collect::<Vec<_>>();
            b.find(fine.constant(double[0].clone()), fine.constant(double[1].clone()));
            prop_assert_eq!(a.x_to_y(), b.x_to_y());
            prop_assert_eq!(a.y_to_x(), b.y_to_x());
        }
    }
}
