//! The loop's body: from one accepted step to the next.

use super::control::{Memory, Verdict};
use super::dense::Piece;
use super::state::is_finite;
use super::{Attempt, Ending, Problem, SolveError, State, Tolerance};

/// How much work an integration was.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Steps that were made.
    pub accepted: usize,
    /// Attempts whose error was too large.
    pub rejected: usize,
    /// Evaluations of the field, all of them: those of the first guess, of rejected steps and for interpolation too.
    pub evaluations: usize,
}

/// An accepted step.
#[derive(Debug)]
#[non_exhaustive]
pub struct Step<'s, Y> {
    /// When it began and ended.
    pub times: [f64; 2],
    /// The state at its beginning.
    pub before: &'s Y,
    /// The state at its end.
    pub after: &'s Y,
    /// The derivatives at its stages.
    pub derivatives: &'s [Y],
}

/// What the last step left. Its states are moved on, never copied: at small fields copies would cost as much as all
/// the rest.
#[derive(Clone, Debug)]
struct Made<Y> {
    times: [f64; 2],
    after: Y,
    derivatives: Vec<Y>,
}

/// An integration that is under way.
///
/// [`solve`](super::solve) is a loop over [`advance`](Self::advance); make your own to stop where you like
/// ([`solve_until`](super::solve_until) stops at an event).
///
/// ```
/// use ode_deform::solve::{EULER, Problem, StepController, Stepper};
///
/// // How long until half is gone?
/// let problem = Problem::new([0.0, 10.0], &EULER, StepController::Fixed { step: 0.001 });
/// let mut stepper = Stepper::new(&problem, 1.0_f64)?;
/// while let Some(step) = stepper.advance(&mut |_, y: &f64| -y)? {
///     if *step.after < 0.5 {
///         break;
///     }
/// }
/// assert!((stepper.time() - 2.0_f64.ln()).abs() < 2e-3);
/// # Ok::<(), ode_deform::solve::SolveError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Stepper<'p, Y> {
    problem: &'p Problem,
    t: f64,
    /// The state at the beginning of the last step.
    y: Y,
    last: Option<Made<Y>>,
    /// The derivative at `t`, where it is known and not among those of the last step; what a method carries on instead
    /// of it counts as that.
    derivative: Option<Y>,
    memory: Memory,
    /// Size of the next attempt; none before the first.
    size: Option<f64>,
    stats: Stats,
}

impl<'p, Y: State> Stepper<'p, Y> {
    /// At the beginning of the span.
    ///
    /// # Errors
    /// If a number of the problem makes no sense.
    pub fn new(problem: &'p Problem, y: Y) -> Result<Self, SolveError> {
        problem.check()?;
        let memory = Memory::new(&problem.control, problem.tableau.order);
        let (t, stats) = (problem.span[0], Stats::default());
        Ok(Self { problem, t, y, last: None, derivative: None, memory, size: None, stats })
    }

    /// The time reached.
    pub fn time(&self) -> f64 {
        self.t
    }

    /// The state there.
    pub fn state(&self) -> &Y {
        self.last.as_ref().map_or(&self.y, |last| &last.after)
    }

    /// The state there, taken out.
    pub fn into_state(self) -> Y {
        self.last.map_or(self.y, |last| last.after)
    }

    /// The work so far.
    pub fn stats(&self) -> Stats {
        self.stats
    }

    /// The step made last.
    pub fn last_step(&self) -> Option<Step<'_, Y>> {
        let Made { times, after, derivatives } = self.last.as_ref()?;
        Some(Step { times: *times, before: &self.y, after, derivatives })
    }

    /// Makes one step; none at the end.
    ///
    /// # Errors
    /// Underflow of the step size, too many attempts, or a state or derivative that is not finite. The stepper stays at the
    /// last good state.
    pub fn advance(
        &mut self,
        field: &mut impl FnMut(f64, &Y) -> Y,
    ) -> Result<Option<Step<'_, Y>>, SolveError> {
        if self.is_finished() {
            return Ok(None);
        }
        self.settle();
        let tolerance = self.problem.control.tolerance();
        if self.derivative.is_none() {
            self.stats.evaluations += 1;
            self.derivative = Some(field(self.t, &self.y));
        }
        if self.size.is_none() {
            self.size = Some(self.first(field)?);
        }
        let mut failure = None;
        loop {
            let size = self.allowed(self.size.expect("decided above"));
            let next = self.next_time(size);
            self.check_limits(size, next, failure)?;
            let (times, derivative) = ([self.t, next], self.derivative.take());
            let attempt = self.problem.tableau.attempt(field, times, &self.y, derivative, true);
            self.stats.evaluations += attempt.evaluations;
            let finite = is_finite(&attempt.after);
            failure = (!finite).then(|| self.non_finite(&attempt.derivatives));
            let error = match (tolerance, &failure) {
                (None, Some(failure)) => return Err(failure.clone()),
                (None, None) => 0.0,
                (Some(_), Some(_)) => f64::NAN,
                (Some(tolerance), None) => self.error(times, &attempt, tolerance),
            };
            match self.memory.judge((next - self.t).abs(), error) {
                Verdict::Accept { next: following } => {
                    self.size = Some(following);
                    self.stats.accepted += 1;
                    self.t = next;
                    let Attempt { after, derivatives, .. } = attempt;
                    self.last = Some(Made { times, after, derivatives });
                    return Ok(self.last_step());
                }
                Verdict::Reject { retry } => {
                    self.stats.rejected += 1;
                    self.size = Some(retry);
                    self.derivative = attempt.derivatives.into_iter().next();
                }
            }
        }
    }

    /// The state at a time within the last step.
    pub fn interpolate(&mut self, field: &mut impl FnMut(f64, &Y) -> Y, time: f64) -> Y {
        let tableau = self.problem.tableau;
        let Some(last) = &self.last else { return self.y.clone() };
        let [from, to] = last.times;
        if time == to {
            return last.after.clone();
        }
        let known = tableau.is_fsal() || tableau.carries_last;
        if self.derivative.is_none() && !known {
            // The next step begins with it, so it is not lost.
            self.stats.evaluations += 1;
            self.derivative = Some(field(to, &last.after));
        }
        let theta = (time - from) / (to - from);
        let end =
            if tableau.carries_last { last.derivatives.last() } else { self.derivative.as_ref() };
        tableau.interpolate(theta, to - from, &self.y, &last.derivatives, end)
    }

    /// The last step as a piece of a curve.
    pub(super) fn piece(&mut self, field: &mut impl FnMut(f64, &Y) -> Y) -> Option<Piece<Y>> {
        let tableau = self.problem.tableau;
        let last = self.last.as_ref()?;
        if self.derivative.is_none() && !tableau.is_fsal() && !tableau.carries_last {
            self.stats.evaluations += 1;
            self.derivative = Some(field(last.times[1], &last.after));
        }
        let end =
            if tableau.carries_last { last.derivatives.last() } else { self.derivative.as_ref() };
        Some(Piece {
            times: last.times,
            before: self.y.clone(),
            after: last.after.clone(),
            derivatives: last.derivatives.clone(),
            end: end.cloned(),
        })
    }

    /// Makes the end of the last step the beginning of the next.
    fn settle(&mut self) {
        if let Some(mut last) = self.last.take() {
            self.y = last.after;
            if self.problem.tableau.is_fsal() || self.problem.tableau.carries_last {
                self.derivative = last.derivatives.pop();
            }
        }
    }

    fn error(&self, times: [f64; 2], attempt: &Attempt<Y>, tolerance: Tolerance) -> f64 {
        let error = self.problem.tableau.error_of(times[1] - times[0], &attempt.derivatives);
        let error = error.expect("the problem was checked for it");
        Y::error_squares(&error, &self.y, &attempt.after, tolerance).rms()
    }

    fn is_finished(&self) -> bool {
        let left = (self.problem.span[1] - self.t) * self.problem.direction();
        match self.problem.ending {
            Ending::Exact => left <= 0.0,
            Ending::Overshoot => left < 0.0,
        }
    }

    fn next_time(&self, size: f64) -> f64 {
        let end = self.problem.span[1];
        // A remainder of rounding errors is no step.
        let reaches = size * (1.0 + 1e-9) >= (end - self.t).abs();
        if reaches && self.problem.ending == Ending::Exact {
            end
        } else {
            self.t + size * self.problem.direction()
        }
    }

    /// The size that is asked for, no greater than what may be: where sizes follow no error they stay as they are.
    fn allowed(&self, size: f64) -> f64 {
        let follows = self.problem.control.tolerance().is_some();
        if follows { size.min(self.problem.limits.greatest_step) } else { size }
    }

    fn check_limits(
        &self,
        size: f64,
        next: f64,
        failure: Option<SolveError>,
    ) -> Result<(), SolveError> {
        let limits = self.problem.limits;
        if self.stats.accepted + self.stats.rejected >= limits.steps {
            return Err(SolveError::StepLimit { t: self.t, limit: limits.steps });
        }
        // A size that is given is no matter of the error.
        let asked = self.problem.control.tolerance().map_or(0.0, |_| limits.least_step);
        let least = asked.max(4.0 * f64::EPSILON * self.t.abs());
        let cut = next == self.problem.span[1];
        if (size < least && !cut) || next == self.t {
            let underflow = SolveError::StepUnderflow { t: self.t, step: size, least };
            return Err(failure.unwrap_or(underflow));
        }
        Ok(())
    }

    fn non_finite(&self, derivatives: &[Y]) -> SolveError {
        let stage =
            derivatives.iter().position(|derivative| !is_finite(derivative)).map(|stage| stage + 1);
        SolveError::NonFinite { t: self.t, stage }
    }

    fn first(&mut self, field: &mut impl FnMut(f64, &Y) -> Y) -> Result<f64, SolveError> {
        if let Some(known) = self.memory.first() {
            return Ok(known);
        }
        let tolerance =
            self.problem.control.tolerance().expect("only what follows the error guesses");
        if !self.derivative.as_ref().is_some_and(is_finite) {
            return Err(SolveError::NonFinite { t: self.t, stage: Some(1) });
        }
        Ok(self.guess(field, tolerance))
    }

    /// A first step whose error is about a hundredth of the tolerance (Hairer, Nørsett, Wanner 1993, II.4).
    fn guess(&mut self, field: &mut impl FnMut(f64, &Y) -> Y, tolerance: Tolerance) -> f64 {
        let (y, direction) = (&self.y, self.problem.direction());
        let derivative = self.derivative.as_ref().expect("known before the first step");
        let norm = |x: &Y| Y::error_squares(x, y, y, tolerance).rms();
        let (of_state, of_derivative) = (norm(y), norm(derivative));
        let span = (self.problem.span[1] - self.problem.span[0]).abs();
        let least = 1e-6 * span;
        let small = of_state < 1e-5 || of_derivative < 1e-5;
        // The field need not be defined beyond the span.
        let trial = if small { least } else { (0.01 * of_state / of_derivative).min(span) };
        let there = Y::lincomb(&[(1.0, y), (direction * trial, derivative)]);
        self.stats.evaluations += 1;
        let bent = field(self.t + direction * trial, &there);
        let curvature = norm(&Y::lincomb(&[(1.0, &bent), (-1.0, derivative)])) / trial;
        let largest = of_derivative.max(curvature);
        let order = self.problem.tableau.order as f64;
        let by_curvature = if largest <= 1e-15 {
            (trial * 1e-3).max(least)
        } else {
            (0.01 / largest).powf(order.recip())
        };
        let guess = by_curvature.min(100.0 * trial);
        if guess.is_finite() && guess > 0.0 { guess } else { least }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::solve::{DOPRI5, EULER, Limits, StepController, solve};

    #[test]
    fn the_field_is_asked_within_the_span_and_steps_are_no_longer_than_allowed() {
        let mut latest = 0.0_f64;
        let slow = |t: f64, _: &f64| {
            latest = latest.max(t);
            1e-6
        };
        let control = StepController::adaptive(1e-3, 1e-6);
        let problem = Problem::new([0.0, 1.0], &DOPRI5, control);
        solve(slow, 1.0, &problem).unwrap();
        assert!(latest <= 1.0, "asked at {latest}");

        let limits = Limits { greatest_step: 0.3, ..Limits::default() };
        let problem = Problem { limits, ..problem };
        let found = solve(|_, _: &f64| 1e-6, 1.0, &problem).unwrap();
        assert!(found.times.windows(2).all(|w| w[1] - w[0] <= 0.3 + 1e-12), "{:?}", found.times);
        let limits = Limits { greatest_step: 0.0, ..Limits::default() };
        let error =
            solve(|_, _: &f64| 1.0, 1.0, &Problem { limits, ..problem.clone() }).unwrap_err();
        assert!(error.to_string().contains("greatest step"), "{error}");

        // What is given does not follow the error.
        let limits = Limits { least_step: 0.1, greatest_step: 0.001, ..Limits::default() };
        let problem = Problem {
            limits,
            ..Problem::new([0.0, 1.0], &EULER, StepController::Fixed { step: 0.01 })
        };
        assert_eq!(solve(|_, _: &f64| 1.0, 0.0, &problem).unwrap().stats.accepted, 100);
    }
}
