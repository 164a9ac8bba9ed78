//! Integration that ends when something happens.

use super::{Dense, Problem, Solution, SolveError, State, Stepper};

/// The most refinements of the time of an event.
const REFINEMENTS: usize = 200;

/// [`solve`](super::solve) up to the time at which `event` changes its sign, if that comes before the end.
///
/// The sign is looked at after each step; within the step in which it changes, the time is where the event of the
/// interpolated state is zero, to the last digits of the time. The solution ends there: its `end` is the state at that
/// time, its `event` the time; states that were asked for later are left out, so that
/// [`states`](Solution::states) may be fewer than asked. An event that is zero at the beginning has not happened yet; one
/// that happens twice within a step is not seen: [`Limits::greatest_step`](super::Limits::greatest_step) makes steps short enough.
///
/// ```
/// use ode_deform::solve::{Problem, StepController, TSIT5, solve_until};
///
/// // A ball is thrown up: when is it back, and how fast?
/// let problem = Problem::new([0.0, 10.0], &TSIT5, StepController::adaptive(1e-9, 1e-9));
/// let flight = |_, &[_, v]: &[f64; 2]| [v, -9.81];
/// let back = solve_until(flight, |_, &[height, _]| height, [0.0, 20.0], &problem)?;
/// assert!((back.event.expect("it falls") - 40.0 / 9.81).abs() < 1e-9);
/// assert!((back.end[1] + 20.0).abs() < 1e-8);
/// # Ok::<(), ode_deform::solve::SolveError>(())
/// ```
///
/// # Errors
/// As [`solve`](super::solve), and if the event's value is not a finite number.
/// # References
/// Hairer, Nørsett, Wanner 1993, *Solving Ordinary Differential Equations I*, II.6 (events on dense output); the
/// refinement is Dowell and Jarratt's 1971 *modified regula falsi* ("Illinois"), with halving.
pub fn solve_until<Y: State>(
    field: impl FnMut(f64, &Y) -> Y,
    event: impl FnMut(f64, &Y) -> f64,
    start: Y,
    problem: &Problem,
) -> Result<Solution<Y>, SolveError> {
    solve_until_crossing(field, (event, Crossing::Either), start, problem)
}

/// Which changes of the sign of an event end an integration; SciPy's `direction`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Crossing {
    /// Both.
    #[default]
    Either,
    /// From below zero upwards, as the integration goes.
    Rising,
    /// From above zero downwards.
    Falling,
}

impl Crossing {
    /// Whether the way from one value to another is one that ends.
    fn happens(self, before: f64, after: f64) -> bool {
        let crosses = before != 0.0 && (after == 0.0 || (after < 0.0) != (before < 0.0));
        let wanted = match self {
            Self::Either => true,
            Self::Rising => before < 0.0,
            Self::Falling => before > 0.0,
        };
        crosses && wanted
    }
}

/// [`solve_until`] an event crosses zero one way: the other way it goes on.
///
/// ```
/// use ode_deform::solve::{Crossing, Limits, Problem, StepController, TSIT5, solve_until_crossing};
///
/// // A ball is thrown up: when does it pass a height of 10 on its way down? Steps of at most half a second do not leap over both ways.
/// let limits = Limits { greatest_step: 0.5, ..Limits::default() };
/// let control = StepController::adaptive(1e-9, 1e-9);
/// let problem = Problem { limits, ..Problem::new([0.0, 10.0], &TSIT5, control) };
/// let flight = |_, &[_, v]: &[f64; 2]| [v, -9.81];
/// let above = |_, &[height, _]: &[f64; 2]| height - 10.0;
/// let fallen = solve_until_crossing(flight, (above, Crossing::Falling), [0.0, 20.0], &problem)?;
/// let root = (20.0_f64.powi(2) - 2.0 * 9.81 * 10.0).sqrt();
/// assert!((fallen.event.expect("it falls") - (20.0 + root) / 9.81).abs() < 1e-9);
/// # Ok::<(), ode_deform::solve::SolveError>(())
/// ```
///
/// # Errors
/// As [`solve_until`].
pub fn solve_until_crossing<Y: State>(
    mut field: impl FnMut(f64, &Y) -> Y,
    (mut event, crossing): (impl FnMut(f64, &Y) -> f64, Crossing),
    start: Y,
    problem: &Problem,
) -> Result<Solution<Y>, SolveError> {
    let direction = problem.direction();
    let mut watched = |t: f64, y: &Y| {
        let value = event(t, y);
        if value.is_finite() { Ok(value) } else { Err(SolveError::Event { t }) }
    };
    let mut save_at = problem.save_at.iter().copied().peekable();
    let (mut states, mut pieces) = (Vec::new(), Vec::new());
    let mut stepper = Stepper::new(problem, start)?;
    let mut times = vec![stepper.time()];
    let mut value = watched(stepper.time(), stepper.state())?;
    while save_at.next_if_eq(&problem.span[0]).is_some() {
        states.push(stepper.state().clone());
    }
    let mut happened = None;
    while happened.is_none() && stepper.advance(&mut field)?.is_some() {
        let (from, to) = (times[times.len() - 1], stepper.time());
        let reached = watched(to, stepper.state())?;
        if crossing.happens(value, reached) {
            let ends = [(from, value), (to, reached)];
            let at = |time: f64| {
                let state = stepper.interpolate(&mut field, time);
                watched(time, &state)
            };
            happened = Some(zero_between(ends, at)?);
        }
        value = reached;
        let until = happened.unwrap_or(to);
        while let Some(time) = save_at.next_if(|&time| (until - time) * direction >= 0.0) {
            states.push(stepper.interpolate(&mut field, time));
        }
        times.push(until);
        if problem.dense {
            pieces.extend(stepper.piece(&mut field));
        }
    }
    let mut dense = Dense::new(problem.tableau, pieces);
    if let (Some(curve), Some(time)) = (&mut dense, happened) {
        curve.cut(time);
    }
    let end = match happened {
        Some(time) => stepper.interpolate(&mut field, time),
        None => stepper.state().clone(),
    };
    Ok(Solution { end, states, times, stats: stepper.stats(), dense, event: happened })
}

/// Where a function that has different signs at both ends is zero.
fn zero_between(
    [(mut a, mut at_a), (mut b, mut at_b)]: [(f64, f64); 2],
    mut f: impl FnMut(f64) -> Result<f64, SolveError>,
) -> Result<f64, SolveError> {
    if at_b == 0.0 {
        return Ok(b);
    }
    let (mut width, mut last) = ((b - a).abs(), 0);
    for round in 0..REFINEMENTS {
        let step = (b - a).abs();
        if step <= 2.0 * f64::EPSILON * a.abs().max(b.abs()) {
            break;
        }
        // Where the secant does not halve in three rounds, halve.
        let halve = round % 3 == 2 && step > 0.5 * width;
        if round % 3 == 2 {
            width = step;
        }
        let secant = b - at_b * (b - a) / (at_b - at_a);
        let inside = (secant - a) * (secant - b) < 0.0;
        let next = if inside && !halve { secant } else { 0.5 * (a + b) };
        if next == a || next == b {
            break;
        }
        let value = f(next)?;
        if value == 0.0 {
            return Ok(next);
        }
        if (value < 0.0) == (at_b < 0.0) {
            (b, at_b) = (next, value);
            if last == 1 {
                at_a *= 0.5;
            }
            last = 1;
        } else {
            (a, at_a) = (next, value);
            if last == -1 {
                at_b *= 0.5;
            }
            last = -1;
        }
    }
    Ok(b)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::solve::{ADAPTIVE_HEUN, DOPRI5, EULER, RK4, StepController, TSIT5, Tableau, solve};

    fn turning(_: f64, &[x, y]: &[f64; 2]) -> [f64; 2] {
        [-y, x]
    }

    #[test]
    fn a_point_on_a_circle_crosses_the_axis_either_way_of_time() {
        for tableau in [&DOPRI5, &TSIT5] {
            for (end, expected) in [(9.0, 1.0), (-9.0, -1.0)] {
                let control = StepController::adaptive(1e-10, 1e-10);
                let quarter = std::f64::consts::FRAC_PI_2;
                let problem = Problem::new([0.0, end], tableau, control)
                    .save_at([0.0, 0.5 * expected, 2.0 * expected])
                    .save_dense();
                let found = solve_until(turning, |_, y| y[0], [1.0, 0.0], &problem).unwrap();
                let time = found.event.unwrap();
                assert!((time - expected * quarter).abs() < 1e-8, "{}: {time}", tableau.name);
                assert!((found.end[1] - expected).abs() < 1e-8 && found.end[0].abs() < 1e-13);
                assert_eq!(found.states.len(), 2, "what comes later is left out");
                assert_eq!(found.times.last(), Some(&time));
                let curve = found.dense.unwrap();
                assert_eq!(curve.span(), [0.0, time]);
                assert!((curve.at(0.5 * expected).unwrap()[0] - 0.5_f64.cos()).abs() < 1e-7);
                assert!(curve.at(1.6 * expected).is_none() && curve.at(-0.1 * expected).is_none());
            }
        }
    }

    #[test]
    fn what_does_not_happen_changes_nothing() {
        let problem = Problem::new([0.0, 1.0], &RK4, StepController::Fixed { step: 0.1 });
        let plain = solve(turning, [1.0, 0.0], &problem).unwrap();
        assert_eq!(solve_until(turning, |_, _| 1.0, [1.0, 0.0], &problem).unwrap(), plain);
        // Zero at the beginning is not an event; zero at the end of a step is.
        let line = |_: f64, _: &f64| 1.0;
        let steps = Problem::new([0.0, 1.0], &EULER, StepController::Fixed { step: 0.25 });
        assert_eq!(solve_until(line, |_, y| *y, 0.0, &steps).unwrap().event, None);
        let found = solve_until(line, |t, _| t - 0.5, 0.0, &steps).unwrap();
        assert_eq!((found.event, found.end, found.stats.accepted), (Some(0.5), 0.5, 2));
    }

    #[test]
    fn an_event_without_a_number_is_an_error() {
        let problem = Problem::new([0.0, 1.0], &RK4, StepController::Fixed { step: 0.25 });
        let event = |t: f64, _: &f64| if t > 0.6 { f64::NAN } else { 1.0 };
        let error = solve_until(|_, y: &f64| *y, event, 1.0, &problem).unwrap_err();
        assert_eq!(error, SolveError::Event { t: 0.75 });
    }

    /// What is asked for by name is what is asked for as a curve, for all methods.
    #[test]
    fn the_curve_has_the_states_that_were_asked_for() {
        for tableau in Tableau::ALL {
            let asked = [0.05, 0.3, 0.31, 0.77, 1.0];
            for span in [[0.0, 1.0], [1.0, 0.0]] {
                let mut asked = asked;
                if span[0] > span[1] {
                    asked.reverse();
                }
                let problem = Problem::new(span, tableau, StepController::Fixed { step: 0.3 })
                    .save_at(asked)
                    .save_dense();
                let solution = solve(turning, [1.0, 0.2], &problem).unwrap();
                let curve = solution.dense.unwrap();
                assert_eq!(curve.at(span[0]), Some([1.0, 0.2]));
                assert_eq!(curve.at(span[1]), Some(solution.end));
                for (time, state) in asked.into_iter().zip(solution.states) {
                    assert_eq!(curve.at(time), Some(state), "{} at {time}", tableau.name);
                }
            }
        }
    }

    #[test]
    fn a_stage_used_again_saves_an_evaluation() {
        let problem = Problem::new([0.0, 1.0], &ADAPTIVE_HEUN, StepController::Fixed { step: 0.1 });
        let solution = solve(turning, [1.0, 0.0], &problem).unwrap();
        assert_eq!(solution.stats.evaluations, 1 + solution.stats.accepted);
    }
}
