//! Chamfer distance between point sets, and the agreement of normals at nearest points.
//!
//! Which point is nearest to which is a plain value, [`Matches`], that distance and normals share.

use autodiff_lite::{Real, Var};

use crate::kernels::neighbors::Norm;
use crate::kernels::vec3::{add, dot, points, points_mut, scale, sub, unit, unit_grad};
use crate::matches::{Matches, sets};
use crate::scalar::{record, sign, wanted};

/// The weights of the two directions.
///
/// Both are 1 in PyTorch3D, kaolin and Mesh R-CNN. The Pixel2Mesh code weighs the way from prediction to
/// truth with 0.55.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Directions {
    /// From the first set to the second.
    pub x_to_y: f64,
    /// From the second set to the first.
    pub y_to_x: f64,
}

impl Default for Directions {
    fn default() -> Self {
        Self { x_to_y: 1.0, y_to_x: 1.0 }
    }
}

/// The Chamfer distance: the mean squared distance to the nearest point, both ways added.
///
/// [`chamfer_distance`] with matches of its own and both directions weighing 1.
///
/// # Shapes
/// `x [P, 3]` and `y [Q, 3]`, or `[N, P, 3]` and `[N, Q, 3]` → a scalar, in squared units.
///
/// # Panics
/// If the shapes are others, or a set is empty.
#[track_caller]
pub fn chamfer<'t, F: Real>(x: Var<'t, F>, y: Var<'t, F>) -> Var<'t, F> {
    let mut matches = Matches::default();
    matches.find(x, y);
    chamfer_distance(x, y, &matches, Directions::default())
}

/// The Chamfer distance over given matches.
///
/// ```text
/// (1/N) Σ_n ( w_xy (1/P) Σ_x ‖x - near(x)‖²  +  w_yx (1/Q) Σ_y ‖y - near(y)‖² )
/// ```
///
/// # Shapes
/// `x [P, 3]` and `y [Q, 3]`, or `[N, P, 3]` and `[N, Q, 3]` → a scalar, in squared units.
/// # Gradient
/// To both sets; exact but where two points are equally near.
/// # Cost
/// `O(N (P + Q))` after the matching; the gradient is made in the same pass.
/// # Panics
/// If the shapes are others, a set is empty, or the matches are not of sets of this size.
/// # References
/// Fan, Su, Guibas 2017, *A Point Set Generation Network*; `chamfer_distance` of PyTorch3D.
#[track_caller]
pub fn chamfer_distance<'t, F: Real>(
    x: Var<'t, F>,
    y: Var<'t, F>,
    matches: &Matches,
    directions: Directions,
) -> Var<'t, F> {
    both_ways("chamfer_distance", x, y, matches, directions, |a, b| {
        let d = sub(a, b);
        let two_d = add(d, d);
        (dot(d, d), two_d, scale(two_d, -F::one()))
    })
}

/// The Chamfer distance under the L1 norm, over given matches.
///
/// ```text
/// (1/N) Σ_n ( w_xy (1/P) Σ_x ‖x - near(x)‖₁  +  w_yx (1/Q) Σ_y ‖y - near(y)‖₁ )
/// ```
///
/// The sum of absolute differences, which forgives outliers; [`Matches::find_l1`] finds what is near in that sense.
///
/// # Shapes
/// As [`chamfer_distance`]; in the units of the points.
/// # Gradient
/// To both sets; zero along an axis where two matched points agree.
/// # Panics
/// As [`chamfer_distance`].
/// # References
/// `chamfer_distance(.., norm=1)` of PyTorch3D.
#[track_caller]
pub fn chamfer_l1<'t, F: Real>(
    x: Var<'t, F>,
    y: Var<'t, F>,
    matches: &Matches,
    directions: Directions,
) -> Var<'t, F> {
    both_ways("chamfer_l1", x, y, matches, directions, |a, b| {
        let signs = [0, 1, 2].map(|k| Norm::L1.derivative(a[k], b[k]));
        (Norm::L1.between(&a, &b), signs, scale(signs, -F::one()))
    })
}

/// How far the normals at nearest points are from equal, both ways added: [`chamfer_normals`] that tells front from
/// back.
///
/// ```text
/// (1/N) Σ_n ( w_xy (1/P) Σ_x (1 - cos(n_x, n_near(x)))  +  w_yx (1/Q) Σ_y (1 - cos(n_y, n_near(y))) )
/// ```
///
/// # Shapes
/// As [`chamfer_normals`] → a scalar in `[0, 4]` for weights of 1.
/// # Gradient
/// To both sets of normals.
/// # Panics
/// As [`chamfer_normals`].
/// # References
/// The normal term of `chamfer_distance(.., abs_cosine=False)` of PyTorch3D.
#[track_caller]
pub fn chamfer_normals_signed<'t, F: Real>(
    x_normals: Var<'t, F>,
    y_normals: Var<'t, F>,
    matches: &Matches,
    directions: Directions,
) -> Var<'t, F> {
    both_ways("chamfer_normals_signed", x_normals, y_normals, matches, directions, |a, b| {
        let ((a, inverse_a), (b, inverse_b)) = (unit(a), unit(b));
        let (at_a, at_b) = (unit_grad(a, inverse_a, b), unit_grad(b, inverse_b, a));
        (F::one() - dot(a, b), scale(at_a, -F::one()), scale(at_b, -F::one()))
    })
}

/// How far the normals at nearest points are from parallel, both ways added.
///
/// ```text
/// (1/N) Σ_n ( w_xy (1/P) Σ_x (1 - |cos(n_x, n_near(x))|)  +  w_yx (1/Q) Σ_y (1 - |cos(n_y, n_near(y))|) )
/// ```
///
/// # Shapes
/// The normals of the matched points, `[P, 3]` and `[Q, 3]` or batches; they need not be unit vectors → a
/// scalar in `[0, 2]` for weights of 1.
/// # Gradient
/// To both sets of normals; zero where two are perpendicular, the kink of the absolute value.
/// # Cost
/// `O(N (P + Q))`; the gradient is made in the same pass.
/// # Panics
/// If the shapes are others, a set is empty, or the matches are not of sets of this size.
/// # References
/// The normal term of `chamfer_distance` of PyTorch3D, used by Mesh R-CNN.
#[track_caller]
pub fn chamfer_normals<'t, F: Real>(
    x_normals: Var<'t, F>,
    y_normals: Var<'t, F>,
    matches: &Matches,
    directions: Directions,
) -> Var<'t, F> {
    both_ways("chamfer_normals", x_normals, y_normals, matches, directions, |a, b| {
        let ((a, inverse_a), (b, inverse_b)) = (unit(a), unit(b));
        let cosine = dot(a, b);
        let sign = -sign(cosine);
        let (at_a, at_b) = (unit_grad(a, inverse_a, b), unit_grad(b, inverse_b, a));
        (F::one() + sign * cosine, scale(at_a, sign), scale(at_b, sign))
    })
}

/// Averages `f(a, b)` over both lists of matched pairs; `f` gives its value and its derivatives by `a` and `b`.
#[track_caller]
fn both_ways<'t, F: Real>(
    name: &'static str,
    x: Var<'t, F>,
    y: Var<'t, F>,
    matches: &Matches,
    directions: Directions,
    f: impl Fn([F; 3], [F; 3]) -> (F, [F; 3], [F; 3]) + Copy,
) -> Var<'t, F> {
    let [n, p, q] = sets(name, x, y);
    if matches.x_to_y().len() != n * p || matches.y_to_x().len() != n * q || p * q == 0 {
        let (of_x, of_y) = (matches.x_to_y().len(), matches.y_to_x().len());
        let message = format!("the matches are of {of_x} and {of_y} points");
        x.tape().refuse(name, message, &[("x", &x.shape(), ""), ("y", &y.shape(), "")]);
    }
    let (a, b) = (x.value(), y.value());
    let (a, b) = (a.as_slice(), b.as_slice());
    let (mut at_x, mut at_y) = (wanted(x), wanted(y));
    let weight_x = directions.x_to_y / (n * p) as f64;
    let weight_y = directions.y_to_x / (n * q) as f64;
    let mut total = 0.0;
    for k in 0..n {
        let (of_x, of_y) = (k * p..(k + 1) * p, k * q..(k + 1) * q);
        let (a, b) = (&points(a)[of_x.clone()], &points(b)[of_y.clone()]);
        let mut at_x = at_x.as_mut().map(|g| &mut points_mut(g)[of_x.clone()]);
        let mut at_y = at_y.as_mut().map(|g| &mut points_mut(g)[of_y.clone()]);
        let (near_x, near_y) = (&matches.x_to_y()[of_x], &matches.y_to_x()[of_y]);
        total +=
            weight_x * one_way(a, b, near_x, weight_x, at_x.as_deref_mut(), at_y.as_deref_mut(), f);
        total += weight_y * one_way(b, a, near_y, weight_y, at_y, at_x, f);
    }
    record(name, [x, y], total, [at_x, at_y])
}

/// `Σ_i f(a_i, b_near(i))`; adds the weighted derivatives, in the order of the points.
fn one_way<F: Real>(
    a: &[[F; 3]],
    b: &[[F; 3]],
    near: &[u32],
    weight: f64,
    mut at_a: Option<&mut [[F; 3]]>,
    mut at_b: Option<&mut [[F; 3]]>,
    f: impl Fn([F; 3], [F; 3]) -> (F, [F; 3], [F; 3]),
) -> f64 {
    let weight = F::from_f64(weight);
    let mut total = 0.0;
    for (i, (&from, &j)) in a.iter().zip(near).enumerate() {
        let j = j as usize;
        let (value, derivative_a, derivative_b) = f(from, b[j]);
        total += Real::to_f64(value);
        if let Some(at_a) = &mut at_a {
            at_a[i] = add(at_a[i], scale(derivative_a, weight));
        }
        if let Some(at_b) = &mut at_b {
            at_b[j] = add(at_b[j], scale(derivative_b, weight));
        }
    }
    total
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use autodiff_lite::Tape;
    use mesh_core::primitives;
    use ndarray::ArrayD;
    use proptest::prelude::*;

    use super::*;
    use crate::testing;

    /// Matching inside the function, so that differences see what the matches do.
    fn distance<'t>(x: Var<'t, f64>, y: Var<'t, f64>, directions: Directions) -> Var<'t, f64> {
        let mut matches = Matches::default();
        matches.find(x, y);
        chamfer_distance(x, y, &matches, directions)
    }

    fn points_of(set: &[[f32; 3]]) -> f64 {
        let tape = Tape::<f32>::eval();
        let x = tape.constant(testing::array::<f32>(set));
        f64::from(chamfer(x, x).item())
    }

    /// Whether the nearest point of `y` is nearer than the second to each point of `x`, by enough.
    fn decided(x: &ArrayD<f64>, y: &ArrayD<f64>, sets: usize) -> bool {
        let [x, y] = [x, y].map(|x| points(x.as_slice().expect("drawn row-major")));
        let (p, q) = (x.len() / sets, y.len() / sets);
        (0..x.len()).all(|i| {
            let set = &y[i / p * q..][..q];
            let mut distances: Vec<f64> =
                set.iter().map(|&to| sub(x[i], to)).map(|d| dot(d, d)).collect();
            distances.sort_unstable_by(f64::total_cmp);
            distances.windows(2).next().is_none_or(|two| two[1] - two[0] > 1e-3)
        })
    }

    autodiff_lite::testkit::gradcheck!(sums_of_differences: |x, y| {
            let mut matches = Matches::default();
            matches.find_l1(x, y);
            chamfer_l1(x, y, &matches, Directions { x_to_y: 0.7, y_to_x: 1.3 })
        },
        shapes [[[5, 3], [4, 3]], [[2, 3, 3], [2, 6, 3]]], options testing::options(1));
    autodiff_lite::testkit::gradcheck!(signed_cosines: |x, y, m, n| {
            let mut matches = Matches::default();
            matches.find(x.detach(), y.detach());
            chamfer_normals_signed(m, n, &matches, Directions::default())
        },
        shapes [[[5, 3], [4, 3], [5, 3], [4, 3]]], options testing::options(2));

    /// Near under one norm is not near under the other, and a normal that is turned round is as wrong as can be.
    #[test]
    fn l1_and_signs_by_hand() {
        let tape = Tape::<f64>::train(0);
        let x = tape.constant(ndarray::arr2(&[[0.0, 0.0, 0.0]]));
        let y = tape.constant(ndarray::arr2(&[[2.0, 2.0, 0.0], [0.0, 0.0, 3.0]]));
        let (mut matches, mut l1) = (Matches::default(), Matches::default());
        matches.find(x, y);
        l1.find_l1(x, y);
        assert_eq!((matches.x_to_y(), l1.x_to_y()), (&[0][..], &[1][..]));
        assert_eq!(chamfer_l1(x, y, &l1, Directions::default()).item(), 3.0 + 3.5);
        let up = tape.constant(ndarray::arr2(&[[0.0, 0.0, 2.0]]));
        let down = tape.constant(ndarray::arr2(&[[0.0, 0.0, -1.0]]));
        let mut one = Matches::default();
        one.find(x, x);
        let both = Directions::default();
        assert_eq!(chamfer_normals(up, down, &one, both).item(), 0.0);
        assert_eq!(chamfer_normals_signed(up, down, &one, both).item(), 4.0);
        assert_eq!(chamfer_normals_signed(up, up, &one, both).item(), 0.0);
    }

    proptest! {
        #[test]
        fn gradients(batch in proptest::option::of(1usize..3), p in 1usize..9, q in 1usize..9,
                     xy in 0.0f64..2.0, yx in 0.0f64..2.0, seed: u64) {
            let shapes = [testing::shape(batch, p), testing::shape(batch, q)];
            let directions = Directions { x_to_y: xy, y_to_x: yx };
            let drawn = testing::options(seed).draw(&shapes);
            let sets = batch.unwrap_or(1);
            // Where two are as near as each other, differences would cross the kink.
            prop_assume!(decided(&drawn[0], &drawn[1], sets) && decided(&drawn[1], &drawn[0], sets));
            testing::checked(&|x: &[Var<'_, f64>]| distance(x[0], x[1], directions), &shapes, &testing::options(seed))?;

            let fixed = testing::options(seed ^ 3).draw(&shapes);
            let options = testing::options(seed).range(0.1, 1.5);
            testing::checked(&|n: &[Var<'_, f64>]| {
                let tape = n[0].tape();
                let mut matches = Matches::default();
                matches.find(tape.constant(fixed[0].clone()), tape.constant(fixed[1].clone()));
                chamfer_normals(n[0], n[1], &matches, directions)
            }, &shapes, &options)?;
        }

        #[test]
        fn order_and_rigid_motion_do_not_matter(a in -3.0f32..3.0, b in -3.0f32..3.0, turn in 1usize..40) {
            let (ball, torus) = (primitives::icosphere(1), primitives::torus(1.0, 0.3, 9, 7));
            let of = |x: &[[f32; 3]], y: &[[f32; 3]]| {
                let tape = Tape::<f64>::eval();
                chamfer(tape.constant(testing::array(x)), tape.constant(testing::array(y))).item()
            };
            let plain = of(&ball.positions, &torus.positions);
            let mut shuffled = ball.positions.clone();
            shuffled.rotate_left(turn % 42);
            prop_assert!((of(&shuffled, &torus.positions) - plain).abs() < 1e-12);
            let place = |mesh| testing::moved(mesh, [a, b], 1.0, [1.0, 2.0, -0.5]).positions;
            prop_assert!((of(&place(&ball), &place(&torus)) - plain).abs() < 1e-5);
        }
    }

    #[test]
    fn a_set_is_at_no_distance_from_itself() {
        assert_eq!(points_of(&primitives::icosphere(2).positions), 0.0);
    }

    #[test]
    fn concentric_spheres() {
        // The nearest point of the larger sphere lies on the same ray: each way the square of the gap.
        let ball = primitives::icosphere(3).positions;
        let tape = Tape::<f64>::train(0);
        let x = tape.leaf(testing::array(&ball));
        let y = tape.constant(testing::array::<f64>(&ball).mapv(|v| 1.05 * v));
        let mut matches = Matches::default();
        matches.find(x, y);
        let loss = chamfer_distance(x, y, &matches, Directions { x_to_y: 1.0, y_to_x: 0.55 });
        assert_relative_eq!(loss.item(), 1.55 * 0.05 * 0.05, epsilon = 1e-8);
        // Normals of a sphere about the origin are its points.
        assert_relative_eq!(
            chamfer_normals(x, y, &matches, Directions::default()).item(),
            0.0,
            epsilon = 1e-12
        );
        // Every point is pulled outward along its own ray, by 2 · 1.55 · 0.05 / P.
        let gradients = loss.backward();
        let pull = gradients
            .wrt(x)
            .map(|g| g.iter().zip(x.value().iter()).map(|(g, x)| g * x).sum::<f64>());
        assert_relative_eq!(pull.unwrap_or_default(), -2.0 * 1.55 * 0.05, epsilon = 1e-6);
    }

    #[test]
    fn perpendicular_normals_by_hand() {
        let tape = Tape::<f64>::train(0);
        let x = tape.constant(ndarray::arr2(&[[0.0, 0.0, 0.0]]));
        let mut matches = Matches::default();
        matches.find(x, x);
        let up = tape.leaf(ndarray::arr2(&[[0.0, 0.0, 2.0]]));
        let down = tape.leaf(ndarray::arr2(&[[0.0, 0.0, -1.0]]));
        let side = tape.leaf(ndarray::arr2(&[[3.0, 0.0, 0.0]]));
        assert_eq!(chamfer_normals(up, side, &matches, Directions::default()).item(), 2.0);
        assert_eq!(chamfer_normals(up, down, &matches, Directions::default()).item(), 0.0);
    }

    #[test]
    #[should_panic(expected = "chamfer_distance: the matches are of 1 and 1 points")]
    fn matches_of_other_sets() {
        let tape = Tape::<f32>::eval();
        let one = tape.constant(ndarray::Array2::zeros((1, 3)));
        let two = tape.constant(ndarray::Array2::zeros((2, 3)));
        let mut matches = Matches::default();
        matches.find(one, one);
        let _ = chamfer_distance(one, two, &matches, Directions::default());
    }
}
