//! Evaluations on tapes of their own: what the operations of this crate share.

use autodiff_lite::kernels::elementwise;
use autodiff_lite::{
    Backward, Gradients, Module, NestedTape, Param, ParamId, Pool, Real, Tape, Tensor, Var,
};
use rand::Rng;

use super::VectorField;
use super::kept::Kept;
use crate::solve::{Problem, Solution, SolveError, solve_watched};

/// A field with a tape to evaluate it on, and a seed that makes what it draws the same each time.
pub(super) struct Evaluator<F: Real, V> {
    pub(super) field: V,
    pub(super) tape: NestedTape<F>,
    pub(super) seed: u64,
}

/// What gradients go to: the start, the inputs, then the field's trainable parameters, which come along.
pub(super) fn sources<'t, F: Real, V: VectorField<F>>(
    field: &V,
    start: Var<'t, F>,
    inputs: &[Var<'t, F>],
) -> (Vec<Var<'t, F>>, Vec<Param<F>>) {
    let params = trainable(field);
    let given = std::iter::once(start).chain(inputs.iter().copied());
    let vars = given.chain(params.iter().map(|param| start.tape().param(param))).collect();
    (vars, params)
}

/// The trainable parameters of a field, each once, in the order of its fields.
fn trainable<F: Real>(field: &impl Module<F>) -> Vec<Param<F>> {
    let mut found: Vec<Param<F>> = Vec::new();
    field.visit("", &mut |_: &str, param: &Param<F>| {
        let known: Vec<ParamId> = found.iter().map(Param::id).collect();
        if param.trainable && !known.contains(&param.id()) {
            found.push(param.clone());
        }
    });
    found
}

/// What a forward pass leaves for the way back.
pub(super) struct Path<F: Real> {
    /// The state at the beginning of each step.
    pub(super) befores: Vec<Kept<F>>,
    /// For a method that carries its last stage on, what was carried into each step but the first.
    pub(super) carried: Vec<Kept<F>>,
    pub(super) solution: Solution<Kept<F>>,
}

impl<F: Real, V: VectorField<F>> Evaluator<F, V> {
    pub(super) fn new(field: &V, tape: &Tape<F>) -> Self {
        let seed = if tape.is_training() { tape.rng().next_u64() } else { 0 };
        Self { field: field.clone(), tape: tape.nested(), seed }
    }

    /// Integrates without recording; keeps the states if `wanted`.
    pub(super) fn run(
        &mut self,
        start: Tensor<F>,
        inputs: &[Tensor<F>],
        problem: &Problem,
        wanted: bool,
    ) -> Result<Path<F>, SolveError> {
        let pool = self.tape.pool().clone();
        let (mut befores, mut carried) = (Vec::new(), Vec::new());
        // No gradient flows here: with frozen parameters nothing is recorded at all.
        let mut frozen = self.field.clone();
        frozen.set_trainable("", false);
        let field = |t: f64, y: &Kept<F>| {
            self.tape.reseed(self.seed);
            let derivative = {
                let y = self.tape.constant(y.tensor().clone());
                let inputs: Vec<_> =
                    inputs.iter().map(|input| self.tape.constant(input.clone())).collect();
                derivative_of(&frozen, t, y, &inputs).value()
            };
            self.tape.reset();
            Kept::new(derivative, &pool)
        };
        let solution = solve_watched(field, Kept::new(start, &pool), problem, |step| {
            if wanted {
                if problem.tableau.carries_last && !befores.is_empty() {
                    carried.extend(step.derivatives.first().cloned());
                }
                befores.push(step.before.clone());
            }
        })?;
        Ok(Path { befores, carried, solution })
    }

    /// The field on this evaluator's tape, drawing what it drew before.
    pub(super) fn derivative<'t>(
        &'t self,
        t: f64,
        y: Var<'t, F>,
        inputs: &[Var<'t, F>],
    ) -> Var<'t, F> {
        self.tape.reseed(self.seed);
        derivative_of(&self.field, t, y, inputs)
    }
}

/// The derivative, checked.
#[track_caller]
pub(super) fn derivative_of<'t, F: Real, V: VectorField<F>>(
    field: &V,
    t: f64,
    y: Var<'t, F>,
    inputs: &[Var<'t, F>],
) -> Var<'t, F> {
    let derivative = field.eval(t, y, inputs);
    let (found, expected) = (derivative.shape(), y.shape());
    assert!(found == expected, "a field gave a derivative {found:?} for a state {expected:?}");
    derivative
}

/// `[K, ..]` of all asked states and the end, or the end alone.
pub(super) fn stacked<F: Real>(solution: &Solution<Kept<F>>, pool: &Pool) -> Tensor<F> {
    if solution.states.is_empty() {
        return solution.end.tensor().clone();
    }
    let all = solution.states.iter().chain([&solution.end]);
    let mut shape = vec![solution.states.len() + 1];
    shape.extend(solution.end.tensor().shape());
    let mut out = pool.array(&shape);
    let parts = out.as_slice_mut().chunks_mut(solution.end.tensor().len().max(1));
    for (part, state) in parts.zip(all) {
        part.copy_from_slice(state.tensor().as_slice());
    }
    out
}

/// The gradients of the asked states and of the end, from that of [`stacked`].
pub(super) fn seeds<F: Real>(cx: &Backward<'_, F>, save_at: usize) -> (Vec<Kept<F>>, Kept<F>) {
    let (gradient, shape) = (cx.grad_out(), cx.input(0).shape().to_vec());
    let part = |i: usize| {
        let len = shape.iter().product::<usize>();
        let mut own = cx.array(&shape);
        let from = &gradient.as_slice()[i * len..(i + 1) * len];
        own.as_slice_mut().copy_from_slice(from);
        Kept::new(own, cx.pool())
    };
    ((0..save_at).map(part).collect(), part(save_at))
}

/// Adds the gradients of one replay to those of the operation's inputs: the first is the state, then the inputs, then
/// the parameters.
pub(super) fn pass_on<F: Real>(
    cx: &mut Backward<'_, F>,
    gradients: &Gradients<F>,
    inputs: &[Var<'_, F>],
    params: &[Param<F>],
) {
    let of_inputs = inputs.iter().map(|&input| gradients.wrt(input));
    let of_params = params.iter().map(|param| gradients.of(param));
    for (i, gradient) in of_inputs.chain(of_params).enumerate() {
        if cx.needs(1 + i)
            && let Some(gradient) = gradient
        {
            elementwise::add_to(gradient.as_slice(), cx.grad_slice_mut(1 + i));
        }
    }
}

/// A scalar of value 0 whose gradient to each variable is given: several products with Jacobians in one walk.
pub(super) fn weighted<F: Real>(terms: Vec<(Var<'_, F>, Kept<F>)>) -> Option<Var<'_, F>> {
    let tape = terms.first()?.0.tape();
    let (vars, seeds): (Vec<_>, Vec<_>) = terms.into_iter().unzip();
    let zero = tape.pool().filled(&[], F::zero());
    Some(tape.record_fn("seeds", &vars, zero, move |cx: &mut Backward<'_, F>| {
        for (i, seed) in seeds.iter().enumerate() {
            cx.give(i, seed.tensor().clone());
        }
    }))
}

/// Constants or leaves of the inputs, as the operation needs their gradients.
pub(super) fn inputs_on<'t, F: Real>(
    tape: &'t Tape<F>,
    cx: &Backward<'_, F>,
    count: usize,
) -> Vec<Var<'t, F>> {
    (1..=count)
        .map(|i| if cx.needs(i) { tape.leaf(cx.input(i)) } else { tape.constant(cx.input(i)) })
        .collect()
}
