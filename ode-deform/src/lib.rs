//! Ordinary differential equations on the CPU, over arrays and over a tape, with exact gradients that keep one state a step.
//!
//! ```
//! use autodiff_lite::optim::Adam;
//! use autodiff_lite::{Activation, Tape, Var};
//! use nets::{Init, Mlp};
//! use ode_deform::solve::{DOPRI5, Problem, StepController};
//! use ode_deform::{Adjoint, field_fn};
//!
//! // Learn a field whose flow turns points by a right angle.
//! let mlp = Mlp::new(&Init::new(0), &[2, 16, 2], Activation::Tanh);
//! let mut field = field_fn(mlp, |mlp: &Mlp, _t, y: Var<'_>, _| mlp.forward(y));
//! let points = ndarray::arr2(&[[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]);
//! let turned = ndarray::arr2(&[[0.0, 1.0], [-1.0, 0.0], [0.0, -1.0], [1.0, 0.0]]);
//! let problem = Problem::new([0.0, 1.0], &DOPRI5, StepController::adaptive(1e-3, 1e-3));
//!
//! let (mut tape, mut adam) = (Tape::train(0), Adam::new(0.02));
//! let mut losses = Vec::new();
//! for _ in 0..150 {
//!     let start = tape.constant(points.clone());
//!     let flow = Adjoint::Checkpointed.integrate(&field, start, &[], &problem)?;
//!     let loss = (flow.end - tape.constant(turned.clone())).square().mean();
//!     losses.push(loss.item());
//!     let gradients = loss.backward();
//!     tape.reset();
//!     adam.step(field.module_mut(), &gradients);
//! }
//! assert!(losses[149] < 0.01 * losses[0]);
//! # Ok::<(), ode_deform::solve::SolveError>(())
//! ```
//!
//! # Where things are
//!
//! | for | see |
//! |---|---|
//! | integrating arrays, tuples, variables of a tape | [`solve::solve`], [`solve::State`] |
//! | stopping at an event | [`solve::solve_until`] |
//! | a loop of your own | [`solve::Stepper`], [`solve::Tableau::attempt`] |
//! | methods | [`solve::EULER`], [`solve::HEUN`], [`solve::MIDPOINT`], [`solve::RK4`], [`solve::BOSH3`], [`solve::DOPRI5`], [`solve::TSIT5`], [`solve::HEUN3`], [`solve::THREE_EIGHTHS`], [`solve::ADAPTIVE_HEUN`] |
//! | step sizes | [`solve::StepController`]: fixed, random, or following the error |
//! | states at asked times | [`Problem::save_at`](solve::Problem::save_at) |
//! | the solution as a curve | [`Problem::save_dense`](solve::Problem::save_dense), [`solve::Dense`] |
//! | a field with parameters | [`VectorField`], [`field_fn`] |
//! | gradients | [`Adjoint`]; with respect to times too, [`Adjoint::integrate_between`] over a [`TimedField`] |
//!
//! # Conventions
//!
//! - Times and step sizes are `f64`; states are what they are. Time runs either way.
//! - The last step ends at the last time exactly; stepping past it, as some published code does, is
//!   [an option](solve::Ending::Overshoot).
//! - Tolerances have no default. Evaluations, accepted and rejected steps are part of every result.
//! - What goes wrong is a [`SolveError`](solve::SolveError) that names the remedy.
//!
//! # Invariants
//!
//! - `solve` knows neither adjoints nor networks nor meshes: it is a loop that an adjoint calls, never the reverse.
//! - The same seed gives the same steps and bits, whatever the number of threads.
//! - Replayed steps are those that were accepted; the gradient is that of the numbers computed.
//!
//! # What this crate does not do
//!
//! Implicit methods for stiff equations, gradients with respect to step sizes or through the time of an event, second
//! derivatives.

#[cfg(feature = "deform")]
pub use nets;
/// The crates whose types stand in this one's functions.
pub use {autodiff_lite, ndarray};

#[cfg(feature = "deform")]
pub mod deform;
pub mod solve;

mod adjoint;

pub use adjoint::{
    Adjoint, FieldFn, Flow, TimedField, TimedFieldFn, VectorField, field_fn, timed_field_fn,
};
