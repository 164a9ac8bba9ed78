//! The k nearest points of a set.

use autodiff_lite::Shapes;
use losses::{Neighbors, Norm};
use pyo3::prelude::*;

use crate::arrays::{self, Floats};
use crate::error;
use crate::precision::Precision;
use crate::recorded::{Arguments, Recorded, fits, record};
use crate::wanted::Wanted;

/// More distances than this are a mistake; memory for them is asked for at once, and who does not get it is ended.
const MOST: usize = 1 << 31;

/// What is searched for: k as it was checked, and the shape `[P, k]` or `[N, P, k]` of the answer.
struct Search {
    k: usize,
    norm: Norm,
    shape: Vec<usize>,
}

impl Search {
    /// Checks two sets of points, `[P, D]` and `[Q, D]`, or batches of them, and what is asked of them.
    fn checked(
        op: &'static str,
        x: &Floats<'_>,
        y: &Floats<'_>,
        k: i64,
        norm: i64,
    ) -> PyResult<Self> {
        let mut shapes = Shapes::of(op);
        let mut set = |name: &str, array: &Floats<'_>, points: &'static str| {
            let found = array.shape();
            fits(if found.len() == 2 {
                shapes.axes(name, found, [points, "D"]).map(|[points, _]| points)
            } else {
                shapes.axes(name, found, ["N", points, "D"]).map(|[_, points, _]| points)
            })
        };
        set("x", x, "P")?;
        let targets = set("y", y, "Q")?;
        let empty = x.shape().contains(&0) || y.shape().contains(&0);
        if empty || x.shape().len() != y.shape().len() {
            return Err(error::value(
                shapes.error("sets of points alike, none of them empty, expected"),
            ));
        }
        let Some(k) = usize::try_from(k).ok().filter(|k| (1..=targets).contains(k)) else {
            return Err(error::value(format!(
                "{op}: k is {k}, expected 1 to {targets}, the points of y"
            )));
        };
        let norm = match norm {
            1 => Norm::L1,
            2 => Norm::L2,
            _ => return Err(error::value(format!("{op}: norm is {norm}, expected 1 or 2"))),
        };
        let mut shape = x.shape().to_vec();
        if let Some(last) = shape.last_mut() {
            *last = k;
        }
        let count = shape.iter().try_fold(1_usize, |count, &size| count.checked_mul(size));
        if count.is_none_or(|count| count > MOST) {
            return Err(error::value(format!(
                "{op}: distances of shape {shape:?}, expected at most 2**31 of them"
            )));
        }
        // Nothing is near to what is no number, and which points come out would look as if something were.
        x.check_numbers(op, "x")?;
        y.check_numbers(op, "y")?;
        Ok(Self { k, norm, shape })
    }

    /// Which points of y are nearest to those of x.
    fn indices<F: Precision>(
        &self,
        py: Python<'_>,
        sets: &Arguments<'_, '_, 2>,
    ) -> PyResult<Vec<i64>> {
        let (tape, [x, y]) = sets.load::<F>()?;
        py.detach(move || {
            error::caught(|| {
                let mut near = Neighbors::default();
                near.find(tape.constant(x), tape.constant(y), self.k, self.norm);
                near.indices().iter().map(|&index| i64::from(index)).collect()
            })
        })
    }
}

/// How far the k nearest points of y are from each point of x, nearest first. PyTorch3D's `knn_points`: distances are squared.
///
/// x: [P, D] or [N, P, D]. y: [Q, D] or [N, Q, D]. k: 1 to Q. norm: 2, or 1 for sums of absolute differences, which are not squared. Value
/// [P, k] or [N, P, k], in squared units (norm 1: in units). Gradients: x, y; which points are nearest counts as fixed, and `neighbors` says it.
/// Raises ValueError where y has fewer than k points, a set is empty, or a coordinate is NaN.
/// Cost: O(N P Q D), all pairs are compared.
#[pyfunction]
#[pyo3(signature = (x, y, k, *, norm=2, wrt=None))]
pub(crate) fn knn_points(
    py: Python<'_>,
    x: Floats<'_>,
    y: Floats<'_>,
    k: i64,
    norm: i64,
    wrt: Option<Wanted>,
) -> PyResult<Recorded> {
    let Search { k, norm, .. } = Search::checked("knn_points", &x, &y, k, norm)?;
    record!(py, Arguments::new("knn_points", [("x", &x), ("y", &y)], wrt.as_ref())?, |x, y| {
        let mut near = Neighbors::default();
        near.find(x, y, k, norm);
        losses::knn_distances(x, y, &near)
    })
}

/// Which k points of y are nearest to each point of x, nearest first: the indices of PyTorch3D's `knn_points`.
///
/// x: [P, D] or [N, P, D]. y: [Q, D] or [N, Q, D]. k: 1 to Q. norm: 2 or 1, as `knn_points` has it. Result: int64 [P, k] or [N, P, k], places in
/// the set of y; of equally near points the lowest come first. `y[indices]`, of sets without a batch, is PyTorch3D's `knn_gather`.
/// Raises ValueError where y has fewer than k points, a set is empty, or a coordinate is NaN.
#[pyfunction]
#[pyo3(signature = (x, y, k, *, norm=2))]
pub(crate) fn neighbors<'py>(
    py: Python<'py>,
    x: Floats<'_>,
    y: Floats<'_>,
    k: i64,
    norm: i64,
) -> PyResult<Bound<'py, PyAny>> {
    let search = Search::checked("neighbors", &x, &y, k, norm)?;
    let sets = Arguments::new("neighbors", [("x", &x), ("y", &y)], None)?;
    let found = if sets.is_double() {
        search.indices::<f64>(py, &sets)?
    } else {
        search.indices::<f32>(py, &sets)?
    };
    let found = ndarray::ArrayD::from_shape_vec(search.shape, found).map_err(error::value)?;
    Ok(arrays::moved(py, found).into_any())
}
