//! Chamfer distance between point sets, and the agreement of normals at nearest points.
//!
//! Which point is nearest to which is not differentiable, so it is a plain value, [`Matches`], that
//! distance and normals share.

use autodiff_lite::{CONTIGUOUS, Real, ShapeError, Var};

use crate::kernels::matching::{Scratch, nearest_indices};
use crate::kernels::vec3::{add, dot, points, points_mut, scale, sub, unit, unit_grad};
use crate::scalar::{record, vertices, wanted};

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
    /// Finds the nearest points of two sets, `[P, 3]` and `[Q, 3]`, or of N pairs of sets.
    ///
    /// # Cost
    /// `O(N P Q)`: all pairs are compared, so the cost does not depend on where the points are. In `f32`
    /// 2466 x 9000 points take about 1.2 ms on two AVX-512 cores (bench `losses`).
    /// # Panics
    /// If the shapes are others, or one set is empty and the other is not.
    #[track_caller]
    pub fn find<F: Real>(&mut self, x: Var<'_, F>, y: Var<'_, F>) {
        let [n, p, q] = sets("chamfer matches", x, y);
        self.x_to_y.clear();
        self.y_to_x.clear();
        let (x, y) = (x.value(), y.value());
        let (x, y) = (x.as_slice().expect(CONTIGUOUS), y.as_slice().expect(CONTIGUOUS));
        for k in 0..n {
            let (x, y) = (&x[3 * k * p..3 * (k + 1) * p], &y[3 * k * q..3 * (k + 1) * q]);
            nearest_indices(x, y, &mut self.scratch, &mut self.x_to_y);
            nearest_indices(y, x, &mut self.scratch, &mut self.y_to_x);
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
        let sign = if cosine > F::zero() {
            -F::one()
        } else if cosine < F::zero() {
            F::one()
        } else {
            F::zero()
        };
        let (at_a, at_b) = (unit_grad(a, inverse_a, b), unit_grad(b, inverse_b, a));
        (F::one() + sign * cosine, scale(at_a, sign), scale(at_b, sign))
    })
}

/// Averages `f(a, b)` over both lists of matched pairs; `f` gives its value and its slopes by `a` and `b`.
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
    if matches.x_to_y.len() != n * p || matches.y_to_x.len() != n * q || p * q == 0 {
        let found = (matches.x_to_y.len(), matches.y_to_x.len());
        ShapeError::new(name, format!("the matches are of {} and {} points", found.0, found.1))
            .operand("x", &x.shape(), "")
            .operand("y", &y.shape(), "")
            .at(x.tape().path())
            .panic();
    }
    let (a, b) = (x.value(), y.value());
    let (a, b) = (a.as_slice().expect(CONTIGUOUS), b.as_slice().expect(CONTIGUOUS));
    let (mut at_x, mut at_y) = (wanted(x), wanted(y));
    let weight_x = directions.x_to_y / (n * p) as f64;
    let weight_y = directions.y_to_x / (n * q) as f64;
    let mut total = 0.0;
    for k in 0..n {
        let (of_x, of_y) = (k * p..(k + 1) * p, k * q..(k + 1) * q);
        let (a, b) = (&points(a)[of_x.clone()], &points(b)[of_y.clone()]);
        let mut at_x = at_x.as_mut().map(|g| &mut points_mut(g)[of_x.clone()]);
        let mut at_y = at_y.as_mut().map(|g| &mut points_mut(g)[of_y.clone()]);
        let (near_x, near_y) = (&matches.x_to_y[of_x], &matches.y_to_x[of_y]);
        total +=
            weight_x * one_way(a, b, near_x, weight_x, at_x.as_deref_mut(), at_y.as_deref_mut(), f);
        total += weight_y * one_way(b, a, near_y, weight_y, at_y, at_x, f);
    }
    record(name, [x, y], total, [at_x, at_y])
}

/// `Σ_i f(a_i, b_near(i))`; adds the weighted slopes, in the order of the points.
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
        let (value, slope_a, slope_b) = f(from, b[j]);
        total += Real::to_f64(value);
        if let Some(at_a) = &mut at_a {
            at_a[i] = add(at_a[i], scale(slope_a, weight));
        }
        if let Some(at_b) = &mut at_b {
            at_b[j] = add(at_b[j], scale(slope_b, weight));
        }
    }
    total
}

/// N, P and Q of two sets or of two batches of sets.
#[track_caller]
fn sets<F: Real>(name: &'static str, x: Var<'_, F>, y: Var<'_, F>) -> [usize; 3] {
    let ([n, p], [m, q]) = (vertices(name, "x", x), vertices(name, "y", y));
    if n != m || (p == 0) != (q == 0) {
        ShapeError::new(
            name,
            "two sets of points, or as many of the one as of the other, expected",
        )
        .operand("x", &x.shape(), "N, P, 3")
        .operand("y", &y.shape(), "N, Q, 3")
        .at(x.tape().path())
        .panic();
    }
    [n, p, q]
}
