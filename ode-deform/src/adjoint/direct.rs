//! Recording everything.

use autodiff_lite::{Real, Var};

use super::replay::derivative_of;
use super::{Flow, VectorField};
use crate::solve::{Problem, SolveError, solve};

pub(super) fn integrate<'t, F: Real, V: VectorField<F>>(
    field: &V,
    start: Var<'t, F>,
    inputs: &[Var<'t, F>],
    problem: &Problem,
) -> Result<Flow<'t, F>, SolveError> {
    let solution = solve(|t, y: &Var<'t, F>| derivative_of(field, t, *y, inputs), start, problem)?;
    let (end, states) = (solution.end, solution.states);
    Ok(Flow { end, states, times: solution.times, stats: solution.stats })
}
