//! Ordinary differential equations whose field is a function of Python.

use ndarray::ArrayD;
use numpy::{IntoPyArray, PyUntypedArray};
use ode_deform::solve::{self, Problem, StepController, Tableau};
use pyo3::prelude::*;

use crate::arrays::{self, Floats, whole};
use crate::error;
use crate::precision::Precision;

/// A solution: where it ends, where it was at the times that were asked for, and how much work it was.
#[pyclass(frozen, module = "unsphere")]
pub(crate) struct Solution {
    /// The state at the last time, like the start.
    #[pyo3(get)]
    end: Py<PyAny>,
    /// The states at `save_at`, one after the other along a new first axis.
    #[pyo3(get)]
    states: Py<PyAny>,
    /// The times between which steps were made, float64 [steps + 1].
    #[pyo3(get)]
    times: Py<PyAny>,
    /// Steps that were made.
    #[pyo3(get)]
    accepted: usize,
    /// Attempts whose error was too large.
    #[pyo3(get)]
    rejected: usize,
    /// Calls of the field.
    #[pyo3(get)]
    evaluations: usize,
}

#[pymethods]
impl Solution {
    fn __repr__(&self) -> String {
        let Self { accepted, rejected, evaluations, .. } = self;
        format!("Solution after {accepted} steps ({rejected} rejected), {evaluations} evaluations")
    }
}

/// Solves dy/dt = field(t, y) by an explicit Runge-Kutta method.
///
/// field: a function of a float and an array like `start`, which returns such an array. start: the state at the first time, any shape.
/// span: the first and the last time; time runs either way. method: "euler", "heun", "midpoint", "rk4", "bosh3", "dopri5", "heun3",
/// "three_eighths", "adaptive_heun" or "tsit5". Either step, the size of all steps, or rtol and atol, the error that a step may have; there is
/// no default, since only you know the scale of your state. save_at: times at which the state is wanted besides, in the order in which they
/// are passed; steps do not depend on them. max_steps: when to give up.
///
/// What the field raises is raised. Raises ValueError with a remedy where the solution is not finite, or steps would be too small or too many.
#[pyfunction]
#[pyo3(
    signature = (
        field, start, span, *, method="dopri5", step=None, rtol=None, atol=None, save_at=vec![], max_steps=100_000
    ),
    text_signature = "(field, start, span, *, method='dopri5', step=None, rtol=None, atol=None, save_at=(), max_steps=100000)"
)]
pub(crate) fn odeint(
    py: Python<'_>,
    field: &Bound<'_, PyAny>,
    start: Floats<'_>,
    span: [f64; 2],
    method: &str,
    step: Option<f64>,
    rtol: Option<f64>,
    atol: Option<f64>,
    save_at: Vec<f64>,
    #[pyo3(from_py_with = whole)] max_steps: usize,
) -> PyResult<Solution> {
    // Python's words are joined by underscores.
    let Some(tableau) = Tableau::named(&method.replace('_', "-")) else {
        let known: Vec<String> = Tableau::ALL.iter().map(|t| t.name.replace('-', "_")).collect();
        let known = known.join(", ");
        return Err(error::value(format!("odeint: method '{method}', expected one of {known}")));
    };
    let control = match (step, rtol, atol) {
        (Some(step), None, None) => StepController::Fixed { step },
        (None, Some(rtol), Some(atol)) => StepController::adaptive(rtol, atol),
        _ => return Err(error::value("odeint: either step, or both rtol and atol, expected")),
    };
    let mut problem = Problem::new(span, tableau, control).save_at(save_at);
    problem.limits.steps = max_steps;
    match &start {
        Floats::Single(array) => solved::<f32>(py, field, array.as_array().to_owned(), &problem),
        Floats::Double(array) => solved::<f64>(py, field, array.as_array().to_owned(), &problem),
    }
}

fn solved<F: Precision>(
    py: Python<'_>,
    field: &Bound<'_, PyAny>,
    start: ArrayD<F>,
    problem: &Problem,
) -> PyResult<Solution> {
    let shape = start.shape().to_vec();
    let mut raised = None;
    let derivative = |t: f64, y: &ArrayD<F>| {
        // After an exception nothing is asked any more: what is not finite soon ends the solver.
        if raised.is_none() {
            match called(field, t, y) {
                Ok(derivative) => return derivative,
                Err(error) => raised = Some(error),
            }
        }
        ArrayD::from_elem(y.raw_dim(), F::nan())
    };
    let found = error::caught(|| solve::solve(derivative, start, problem));
    if let Some(error) = raised {
        return Err(error);
    }
    let found = found?.map_err(error::value)?;
    let mut states = ArrayD::zeros([&[found.states.len()], &shape[..]].concat());
    for (mut row, state) in states.outer_iter_mut().zip(&found.states) {
        row.assign(state);
    }
    let stats = found.stats;
    Ok(Solution {
        end: arrays::moved(py, found.end).into_any().unbind(),
        states: arrays::moved(py, states).into_any().unbind(),
        times: found.times.into_pyarray(py).into_any().unbind(),
        accepted: stats.accepted,
        rejected: stats.rejected,
        evaluations: stats.evaluations,
    })
}

/// The field's answer, an array like the state.
fn called<F: Precision>(field: &Bound<'_, PyAny>, t: f64, y: &ArrayD<F>) -> PyResult<ArrayD<F>> {
    let py = field.py();
    py.check_signals()?;
    let answer = field.call1((t, arrays::moved(py, y.clone())))?;
    // Of arrays without axes NumPy makes numbers wherever it computes.
    if y.ndim() == 0
        && answer.cast::<PyUntypedArray>().is_err()
        && let Ok(number) = answer.extract::<f64>()
    {
        return Ok(ArrayD::from_elem(y.raw_dim(), F::from_f64(number)));
    }
    let array = answer.extract::<Floats<'_>>()?;
    if array.shape() != y.shape() {
        let (found, expected) = (array.shape(), y.shape());
        return Err(error::value(format!(
            "odeint: field(t, y) has the shape {found:?}, expected {expected:?} as y"
        )));
    }
    let Some(own) = F::of(&array) else {
        let found = array.dtype();
        return Err(error::value(format!(
            "odeint: field(t, y) is {found}, expected {} as y",
            F::DTYPE
        )));
    };
    Ok(own.as_array().to_owned())
}
