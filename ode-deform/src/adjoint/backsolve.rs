//! The continuous adjoint equation, solved backwards.
//!
//! ```text
//! dy/dt = f        da/dt = -aᵀ ∂f/∂y        dg/dt = -aᵀ ∂f/∂θ
//! ```

use std::cell::RefCell;
use std::sync::{Mutex, PoisonError};

use autodiff_lite::kernels::elementwise;
use autodiff_lite::{Backward, Op, Param, Real, Tensor, Var};

use super::kept::Kept;
use super::replay::{Evaluator, seeds, sources, stacked};
use super::{Flow, VectorField};
use crate::solve::{Ending, Problem, SolveError, Squares, State, Tolerance, solve};

pub(super) fn integrate<'t, F: Real, V: VectorField<F>>(
    field: &V,
    start: Var<'t, F>,
    inputs: &[Var<'t, F>],
    problem: &Problem,
) -> Result<Flow<'t, F>, SolveError> {
    let tape = start.tape();
    let mut evaluator = Evaluator::new(field, tape);
    let (vars, params) = sources(field, start, inputs);
    let values: Vec<_> = inputs.iter().map(|input| input.value()).collect();
    let solution = evaluator.run(start.value(), &values, problem, false)?.solution;
    let (times, stats) = (solution.times.clone(), solution.stats);
    let value = stacked(&solution, tape.pool());
    let last = times.last().copied().unwrap_or(problem.span[0]);
    let states = solution.states.into_iter().chain([solution.end]).collect();
    let op = Backsolve {
        evaluator: Mutex::new(evaluator),
        problem: problem.clone(),
        last,
        inputs: inputs.len(),
        params,
        states,
    };
    let output = tape.record(&vars, value, op);
    Ok(Flow::of(output, problem.save_at.len(), times, stats))
}

struct Backsolve<F: Real, V> {
    evaluator: Mutex<Evaluator<F, V>>,
    problem: Problem,
    /// The time of the end.
    last: f64,
    inputs: usize,
    params: Vec<Param<F>>,
    /// The asked states and the end.
    states: Vec<Kept<F>>,
}

/// State, adjoint, and the sums that become gradients.
#[derive(Clone, Debug)]
struct Augmented<F: Real> {
    y: Kept<F>,
    a: Kept<F>,
    sums: Vec<Kept<F>>,
}

impl<F: Real> State for Augmented<F> {
    fn lincomb(terms: &[(f64, &Self)]) -> Self {
        let pick = |part: &dyn Fn(&Self) -> &Kept<F>| {
            let terms: Vec<_> = terms.iter().map(|(c, s)| (*c, part(s))).collect();
            Kept::lincomb(&terms)
        };
        let sums = (0..terms[0].1.sums.len()).map(|i| pick(&|s| &s.sums[i])).collect();
        Self { y: pick(&|s| &s.y), a: pick(&|s| &s.a), sums }
    }

    fn error_squares(error: &Self, before: &Self, after: &Self, tolerance: Tolerance) -> Squares {
        let of_state = Kept::error_squares(&error.y, &before.y, &after.y, tolerance);
        let of_adjoint = Kept::error_squares(&error.a, &before.a, &after.a, tolerance);
        let both = of_state.plus(of_adjoint);
        let sums = error.sums.iter().zip(&before.sums).zip(&after.sums);
        sums.fold(both, |all, ((e, b), a)| all.plus(Kept::error_squares(e, b, a, tolerance)))
    }
}

impl<F: Real, V: VectorField<F>> Backsolve<F, V> {
    /// The derivative of the augmented state.
    fn derivative(
        &self,
        evaluator: &mut Evaluator<F, V>,
        inputs: &[(Tensor<F>, bool)],
        t: f64,
        state: &Augmented<F>,
    ) -> Augmented<F> {
        let pool = evaluator.tape.pool().clone();
        let derivatives = {
            let (evaluator, tape) = (&*evaluator, &*evaluator.tape);
            let y = tape.leaf(state.y.tensor().clone());
            let on_tape = |(value, needed): &(Tensor<F>, bool)| {
                if *needed { tape.leaf(value.clone()) } else { tape.constant(value.clone()) }
            };
            let inputs: Vec<_> = inputs.iter().map(on_tape).collect();
            let derivative = evaluator.derivative(t, y, &inputs);
            let gradients = derivative.backward_with(state.a.tensor().clone());
            let negative = |gradient: Option<&Tensor<F>>, like: &Kept<F>| {
                let Some(gradient) = gradient else {
                    return Kept::zeros(like.tensor().shape(), &pool);
                };
                let mut own = pool.array(gradient.shape());
                elementwise::map(gradient.as_slice(), own.as_slice_mut(), |g| -g);
                Kept::new(own, &pool)
            };
            let (of_inputs, of_params) = state.sums.split_at(inputs.len());
            let inputs = inputs.iter().zip(of_inputs).map(|(&x, like)| (gradients.wrt(x), like));
            let params = self.params.iter().zip(of_params).map(|(p, like)| (gradients.of(p), like));
            Augmented {
                y: Kept::new(derivative.value(), &pool),
                a: negative(gradients.wrt(y), &state.a),
                sums: inputs
                    .chain(params)
                    .map(|(gradient, like)| negative(gradient, like))
                    .collect(),
            }
        };
        evaluator.tape.reset();
        derivatives
    }

    /// Back from the end to the beginning, where the gradients are complete.
    fn solve_back(
        &self,
        evaluator: &mut Evaluator<F, V>,
        inputs: &[(Tensor<F>, bool)],
        (save_at, at_end): (Vec<Kept<F>>, Kept<F>),
    ) -> Result<Augmented<F>, SolveError> {
        let pool = evaluator.tape.pool().clone();
        let mut sums: Vec<_> = inputs.iter().map(|(x, _)| Kept::zeros(x.shape(), &pool)).collect();
        sums.extend(self.params.iter().map(|param| Kept::zeros(param.shape(), &pool)));
        let end = self.states.last().expect("the end is always kept").clone();
        let mut state = Augmented { y: end, a: at_end, sums };
        let mut time = self.last;
        let evaluator = RefCell::new(evaluator);
        let back = |state: Augmented<F>, span: [f64; 2]| {
            let ending = Ending::Exact;
            let (save_at, dense) = (Vec::new(), false);
            let problem = Problem { span, ending, save_at, dense, ..self.problem.clone() };
            let field = |t: f64, s: &Augmented<F>| {
                self.derivative(&mut evaluator.borrow_mut(), inputs, t, s)
            };
            solve(field, state, &problem).map(|solution| solution.end)
        };
        for (i, seed) in save_at.iter().enumerate().rev() {
            let mut reached = back(state, [time, self.problem.save_at[i]])?;
            reached.a = Kept::lincomb(&[(1.0, &reached.a), (1.0, seed)]);
            // The state that was passed is known here: no need to go on from the one found on the way back.
            reached.y = self.states[i].clone();
            (state, time) = (reached, self.problem.save_at[i]);
        }
        back(state, [time, self.problem.span[0]])
    }
}

impl<F: Real, V: VectorField<F>> Op<F> for Backsolve<F, V> {
    fn name(&self) -> &'static str {
        "integrate"
    }

    fn pullback(&self, cx: &mut Backward<'_, F>) {
        let mut evaluator = self.evaluator.lock().unwrap_or_else(PoisonError::into_inner);
        let inputs: Vec<_> = (1..=self.inputs).map(|i| (cx.input(i), cx.needs(i))).collect();
        let seeds = seeds(cx, self.problem.save_at.len());
        let Ok(start) = self.solve_back(&mut evaluator, &inputs, seeds) else {
            for i in 0..cx.input_count() {
                cx.grad_slice_mut(i).fill(F::nan());
            }
            return;
        };
        cx.give(0, start.a.tensor().clone());
        for (i, sum) in start.sums.iter().enumerate() {
            if cx.needs(1 + i) {
                elementwise::add_to(sum.tensor().as_slice(), cx.grad_slice_mut(1 + i));
            }
        }
    }
}
