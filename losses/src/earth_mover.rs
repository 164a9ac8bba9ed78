//! The earth mover's distance: what it takes to carry one point set onto another.

use autodiff_lite::{Real, Var};

use crate::kernels::assignment::{Assignment, assign, distance};
use crate::kernels::vec3::{points, points_mut};
use crate::scalar::{record, same_shape, vertices, wanted};

/// The mean distance over the pairing of both sets whose distances add up to the least.
///
/// ```text
/// (1/(N P)) Σ_n min over pairings φ Σ_x ‖x - φ(x)‖
/// ```
///
/// # Shapes
/// `x` and `y` `[P, 3]` or `[N, P, 3]` → a scalar, in the units of the points, not squared. As many points in the one as
/// in the other; published figures differ in units: Pixel2Mesh prints 0.01 times the sum of an approximation.
/// # Gradient
/// To both sets, through the pairing as it is; zero where two partners coincide.
/// # Cost
/// That of the [`Assignment`], in double precision on one thread a set.
/// # Panics
/// If the shapes are others, a coordinate or a squared distance is not finite, or the excess of an approximate assignment is not above 0.
/// # References
/// Fan, Su, Guibas 2017, *A Point Set Generation Network*, section 3.2.
///
/// ```
/// use autodiff_lite::Tape;
/// use losses::{Assignment, earth_mover};
///
/// let tape = Tape::<f32>::train(0);
/// let x = tape.leaf(ndarray::arr2(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]));
/// let y = tape.constant(ndarray::arr2(&[[1.0, 0.0, 2.0], [0.0, 0.0, 0.0]]));
/// assert_eq!(earth_mover(x, y, Assignment::Exact).item(), 1.0);
/// ```
#[track_caller]
pub fn earth_mover<'t, F: Real>(x: Var<'t, F>, y: Var<'t, F>, method: Assignment) -> Var<'t, F> {
    let [n, p] = vertices("earth_mover", "x", x);
    same_shape("earth_mover", ["x", "y"], x, y);
    let (a, b) = (x.value(), y.value());
    let (a, b) = (a.as_slice(), b.as_slice());
    let (mut at_x, mut at_y) = (wanted(x), wanted(y));
    let weight = 1.0 / (n * p).max(1) as f64;
    let mut total = 0.0;
    for k in 0..n {
        let set = |all: &[F]| -> Vec<[f64; 3]> {
            points(all)[k * p..(k + 1) * p].iter().map(|q| q.map(Real::to_f64)).collect()
        };
        let (a, b) = (set(a), set(b));
        for (i, j) in assign(&a, &b, method).into_iter().enumerate() {
            let (from, to) = (a[i], b[j as usize]);
            let length = distance(from, to);
            total += weight * length;
            if length == 0.0 {
                continue;
            }
            for axis in 0..3 {
                let derivative = weight * (from[axis] - to[axis]) / length;
                if let Some(at_x) = &mut at_x {
                    points_mut(at_x)[k * p + i][axis] += F::from_f64(derivative);
                }
                if let Some(at_y) = &mut at_y {
                    points_mut(at_y)[k * p + j as usize][axis] -= F::from_f64(derivative);
                }
            }
        }
    }
    record("earth_mover", [x, y], total, [at_x, at_y])
}

#[cfg(test)]
mod tests {
    use autodiff_lite::Tape;
    use proptest::prelude::*;

    use super::*;
    use crate::testing;

    proptest! {
        #[test]
        fn gradients(batch in proptest::option::of(1usize..3), p in 1usize..7, seed: u64) {
            let shapes = [testing::shape(batch, p), testing::shape(batch, p)];
            for method in [Assignment::Exact, Assignment::Auction { excess: 1e-3 }] {
                testing::checked(&|x: &[Var<'_, f64>]| earth_mover(x[0], x[1], method), &shapes, &testing::options(seed))?;
            }
        }

        #[test]
        fn moving_a_set_costs_the_way(dx in -1.0f64..1.0, dy in -1.0f64..1.0, seed: u64) {
            let drawn = testing::options(seed).draw(&[vec![20, 3]]);
            let tape = Tape::<f64>::eval();
            let moved = &drawn[0] + &ndarray::arr1(&[dx, dy, 0.5]);
            let (x, y) = (tape.constant(drawn[0].clone()), tape.constant(moved));
            let distance = (dx * dx + dy * dy + 0.25).sqrt();
            prop_assert!((earth_mover(x, y, Assignment::Exact).item() - distance).abs() < 1e-12);
        }
    }

    #[test]
    #[should_panic(expected = "earth_mover: x and y differ in shape")]
    fn as_many_points_in_both() {
        let tape = Tape::<f32>::eval();
        let [x, y] = [2, 3].map(|p| tape.constant(ndarray::Array2::zeros((p, 3))));
        let _ = earth_mover(x, y, Assignment::Exact);
    }
}
