//! Gradients through an integration.

mod backsolve;
mod checkpointed;
mod direct;
mod field;
mod flow;
mod kept;
mod replay;
#[cfg(test)]
mod tests;
mod timed;

use autodiff_lite::{Real, Var};

pub use field::{FieldFn, VectorField, field_fn};
pub use flow::Flow;
pub use timed::{TimedField, TimedFieldFn, timed_field_fn};

use crate::solve::{Problem, SolveError};

/// How the gradient of an integration is found.
///
/// Steps are constants to all of them: no gradient flows into step sizes or tolerances, nor into times but by
/// [`integrate_between`](Adjoint::integrate_between), and replayed steps are those that were accepted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "kebab-case")
)]
#[non_exhaustive]
pub enum Adjoint {
    /// Every operation of every evaluation is recorded: exact, and the memory grows with the evaluations.
    Direct,
    /// Only the state at the beginning of each step is kept; on the way back each step is computed once more, recorded
    /// and forgotten. Exact, to rounding equal to [`Direct`](Self::Direct); memory of one step, and one state a step;
    /// the time of one more pass forward. On a tape it is one operation. Running statistics of a field's norms, which
    /// evaluations of [`Direct`](Self::Direct) move, stay as they are, here and in [`Backsolve`](Self::Backsolve): a field should have norms without (layer,
    /// group, or frozen batch norms).
    #[default]
    Checkpointed,
    /// **Approximate.** The continuous adjoint equation is solved backwards from the end, and the state with it: only
    /// the asked states and the end are kept. The gradient is that of the exact flow and not of the computed one, and
    /// the state found on the way back is not the one that was passed: the error falls with the step size and may be
    /// of any size where the flow contracts. There are two reasons to choose it: memory that does not grow even by
    /// states, and showing why [`Checkpointed`](Self::Checkpointed) is better. Where the way back fails, gradients are
    /// not numbers.
    ///
    /// # References
    /// Chen et al. 2018, *Neural Ordinary Differential Equations*; against it: Zhuang et al. 2020, *Adaptive
    /// Checkpoint Adjoint*.
    Backsolve,
}

impl Adjoint {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Direct, Self::Checkpointed, Self::Backsolve];

    /// Integrates a field from `start`.
    ///
    /// Gradients reach `start`, the `inputs`, and the trainable parameters of the field.
    ///
    /// # Shapes
    /// `start`: any that the field takes, `inputs`: those of the field → the shape of `start` at the end and at each asked
    /// time.
    ///
    /// # Errors
    /// As [`solve`](crate::solve::solve).
    ///
    /// # Panics
    /// If the field gives a derivative of another shape than the state.
    pub fn integrate<'t, F: Real, V: VectorField<F>>(
        self,
        field: &V,
        start: Var<'t, F>,
        inputs: &[Var<'t, F>],
        problem: &Problem,
    ) -> Result<Flow<'t, F>, SolveError> {
        match self {
            Self::Direct => direct::integrate(field, start, inputs, problem),
            Self::Checkpointed => checkpointed::integrate(field, start, inputs, problem),
            Self::Backsolve => backsolve::integrate(field, start, inputs, problem),
        }
    }
}
