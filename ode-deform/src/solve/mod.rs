//! Initial value problems by explicit Runge-Kutta methods, over anything that has linear combinations.
//!
//! ```
//! use ode_deform::solve::{DOPRI5, Problem, StepController, solve};
//!
//! // A harmonic oscillator, once around, and where it is at a quarter.
//! let quarter = std::f64::consts::FRAC_PI_2;
//! let problem = Problem::new([0.0, 4.0 * quarter], &DOPRI5, StepController::adaptive(1e-8, 1e-8))
//!     .save_at([quarter]);
//! let solution = solve(|_, &[x, v]: &[f64; 2]| [v, -x], [1.0, 0.0], &problem)?;
//! assert!((solution.end[0] - 1.0).abs() < 1e-6);
//! assert!((solution.states[0][1] + 1.0).abs() < 1e-6);
//! // One evaluation to begin with, one to guess the first step, six for each attempt.
//! let stats = solution.stats;
//! assert_eq!(stats.evaluations, 2 + 6 * (stats.accepted + stats.rejected));
//! # Ok::<(), ode_deform::solve::SolveError>(())
//! ```

mod control;
mod dense;
mod error;
mod event;
mod methods;
mod problem;
mod state;
mod stepper;
mod tableau;
#[cfg(test)]
mod tests;
mod tolerance;

pub use control::{Pid, StepController};
pub use dense::Dense;
pub use error::SolveError;
pub use event::{Crossing, solve_until, solve_until_crossing};
pub use methods::{
    ADAPTIVE_HEUN, BOSH3, DOPRI5, EULER, HEUN, HEUN3, MIDPOINT, RK4, THREE_EIGHTHS, TSIT5,
};
pub use problem::{Ending, Limits, Problem};
pub use state::{Squares, State};
pub(crate) use state::{combine, slice_squares};
pub use stepper::{Stats, Step, Stepper};
pub use tableau::{Attempt, Tableau};
pub use tolerance::Tolerance;

/// What an integration gave.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Solution<Y> {
    /// The state at the end.
    pub end: Y,
    /// The states at the asked times.
    pub states: Vec<Y>,
    /// When each accepted step began, and when the last ended: the end of the span, or past it where that was asked.
    pub times: Vec<f64>,
    /// How much work it was.
    pub stats: Stats,
    /// The solution as a curve, where the [problem](Problem::save_dense) asks for it and there was a step.
    pub dense: Option<Dense<Y>>,
    /// When an event ended it before the last time, see [`solve_until`].
    pub event: Option<f64>,
}

/// Integrates `dy/dt = field(t, y)` from the state at the beginning.
///
/// # Errors
/// If the problem makes no sense, the step size underflows, there are too many steps, or the state or a derivative is not
/// finite.
pub fn solve<Y: State>(
    field: impl FnMut(f64, &Y) -> Y,
    start: Y,
    problem: &Problem,
) -> Result<Solution<Y>, SolveError> {
    solve_watched(field, start, problem, |_| {})
}

/// [`solve`], showing each accepted step.
///
/// # Errors
/// As [`solve`].
pub fn solve_watched<Y: State>(
    mut field: impl FnMut(f64, &Y) -> Y,
    start: Y,
    problem: &Problem,
    mut watch: impl FnMut(Step<'_, Y>),
) -> Result<Solution<Y>, SolveError> {
    let direction = problem.direction();
    let mut save_at = problem.save_at.iter().copied().peekable();
    let mut states = Vec::with_capacity(problem.save_at.len());
    let mut stepper = Stepper::new(problem, start)?;
    let mut times = vec![stepper.time()];
    let mut pieces = Vec::new();
    while save_at.next_if_eq(&problem.span[0]).is_some() {
        states.push(stepper.state().clone());
    }
    while stepper.advance(&mut field)?.is_some() {
        let reached = stepper.time();
        while let Some(time) = save_at.next_if(|&time| (reached - time) * direction >= 0.0) {
            states.push(stepper.interpolate(&mut field, time));
        }
        times.push(reached);
        if problem.dense {
            pieces.extend(stepper.piece(&mut field));
        }
        stepper.last_step().into_iter().for_each(&mut watch);
    }
    let (stats, dense) = (stepper.stats(), Dense::new(problem.tableau, pieces));
    Ok(Solution { end: stepper.into_state(), states, times, stats, dense, event: None })
}
