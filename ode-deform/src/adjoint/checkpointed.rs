//! Keeping states, and computing each step once more on the way back.

use std::sync::{Mutex, PoisonError};

use autodiff_lite::{Backward, Op, Param, Real, Tensor, Var};

use super::kept::Kept;
use super::replay::{Evaluator, inputs_on, pass_on, seeds, sources, stacked, weighted};
use super::{Flow, VectorField};
use crate::solve::{Problem, SolveError, State};

pub(super) fn integrate<'t, F: Real, V: VectorField<F>>(
    field: &V,
    start: Var<'t, F>,
    inputs: &[Var<'t, F>],
    problem: &Problem,
) -> Result<Flow<'t, F>, SolveError> {
    let tape = start.tape();
    let mut evaluator = Evaluator::new(field, tape);
    let (vars, params) = sources(field, start, inputs);
    let wanted = tape.wants_grad(&vars);
    let values: Vec<_> = inputs.iter().map(|input| input.value()).collect();
    let path = evaluator.run(start.value(), &values, problem, wanted)?;
    let (times, stats) = (path.solution.times.clone(), path.solution.stats);
    let value = stacked(&path.solution, tape.pool());
    let op = Replay {
        evaluator: Mutex::new(evaluator),
        problem: problem.clone(),
        inputs: inputs.len(),
        params,
        befores: path.befores,
        carried: path.carried,
        times: times.clone(),
    };
    let output = tape.record(&vars, value, op);
    Ok(Flow::of(output, problem.save_at.len(), times, stats))
}

struct Replay<F: Real, V> {
    evaluator: Mutex<Evaluator<F, V>>,
    problem: Problem,
    inputs: usize,
    params: Vec<Param<F>>,
    befores: Vec<Kept<F>>,
    carried: Vec<Kept<F>>,
    times: Vec<f64>,
}

/// Gradients at the beginning or the end of a step.
struct Seeds<F: Real> {
    of_state: Kept<F>,
    /// Of the derivative that the method carries from one step to the next.
    of_carried: Option<Kept<F>>,
}

impl<F: Real, V: VectorField<F>> Replay<F, V> {
    /// The gradient of the state at the beginning of step `n`, from that at its end and those of the states that were
    /// asked for within it.
    fn step_back(
        &self,
        cx: &mut Backward<'_, F>,
        evaluator: &mut Evaluator<F, V>,
        n: usize,
        at_end: Seeds<F>,
        within: Vec<(f64, Kept<F>)>,
    ) -> Seeds<F> {
        let times @ [from, to] = [self.times[n], self.times[n + 1]];
        let before = {
            let (evaluator, tape) = (&*evaluator, &*evaluator.tape);
            let y = tape.leaf(self.befores[n].tensor().clone());
            let inputs = inputs_on(tape, cx, self.inputs);
            let mut field = over(y, |t, y| evaluator.derivative(t, *y, &inputs));
            // The first derivative is computed anew even where it was the last of the step before: of this state it is the
            // same function. But what a method carries on is not: it comes in as a variable of its own.
            let tableau = self.problem.tableau;
            let carried = n.checked_sub(1).and_then(|before| self.carried.get(before));
            let carried = carried.map(|derivative| tape.leaf(derivative.tensor().clone()));
            let step = tableau.attempt(&mut field, times, &y, carried, !within.is_empty());
            let needed = !within.is_empty() && !tableau.is_fsal();
            let end = if tableau.carries_last {
                step.derivatives.last().copied()
            } else {
                needed.then(|| field(to, &step.after))
            };
            let mut terms = vec![(step.after, at_end.of_state)];
            if let (Some(seed), Some(&last)) = (at_end.of_carried, step.derivatives.last()) {
                terms.push((last, seed));
            }
            for (time, seed) in within {
                let theta = (time - from) / (to - from);
                let state =
                    tableau.interpolate(theta, to - from, &y, &step.derivatives, end.as_ref());
                terms.push((state, seed));
            }
            let total = weighted(terms).expect("there is a term for the end");
            let gradients = total.backward();
            pass_on(cx, &gradients, &inputs, &self.params);
            let of = |gradient: Option<&Tensor<F>>| match gradient {
                Some(gradient) => Kept::new(gradient.clone(), cx.pool()),
                None => Kept::zeros(self.befores[n].tensor().shape(), cx.pool()),
            };
            Seeds {
                of_state: of(gradients.wrt(y)),
                of_carried: carried.map(|carried| of(gradients.wrt(carried))),
            }
        };
        evaluator.tape.reset();
        before
    }
}

/// The closure itself, as a field of states like `y`: what the compiler does not see in one that is bound to a name.
fn over<Y, C: FnMut(f64, &Y) -> Y>(_: Y, field: C) -> C {
    field
}

impl<F: Real, V: VectorField<F>> Op<F> for Replay<F, V> {
    fn name(&self) -> &'static str {
        "integrate"
    }

    fn pullback(&self, cx: &mut Backward<'_, F>) {
        let mut evaluator = self.evaluator.lock().unwrap_or_else(PoisonError::into_inner);
        let save_at = &self.problem.save_at;
        let (mut waiting, end) = seeds(cx, save_at.len());
        let mut gradient = Seeds { of_state: end, of_carried: None };
        let add = |gradient: &mut Seeds<F>, seed: &Kept<F>| {
            gradient.of_state = Kept::lincomb(&[(1.0, &gradient.of_state), (1.0, seed)]);
        };
        for n in (0..self.befores.len()).rev() {
            let [from, to] = [self.times[n], self.times[n + 1]];
            let mut within = Vec::new();
            // Those asked for at the beginning belong to the step before, or to the start.
            while let Some(&time) = waiting.len().checked_sub(1).map(|last| &save_at[last])
                && (time - from) * (to - from) > 0.0
            {
                let seed = waiting.pop().expect("there is one for each time of save_at");
                if time == to {
                    add(&mut gradient, &seed);
                } else {
                    within.push((time, seed));
                }
            }
            gradient = self.step_back(cx, &mut evaluator, n, gradient, within);
        }
        for seed in waiting {
            add(&mut gradient, &seed);
        }
        cx.give(0, gradient.of_state.into_tensor());
    }
}
