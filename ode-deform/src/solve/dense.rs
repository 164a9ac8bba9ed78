//! A solution as a curve.

use super::{State, Tableau};

/// A solution at every time of its span: the curves that the method has between the ends of its steps.
///
/// ```
/// use ode_deform::solve::{Problem, StepController, TSIT5, solve};
///
/// let problem = Problem::new([0.0, 3.0], &TSIT5, StepController::adaptive(1e-8, 1e-8)).save_dense();
/// let solution = solve(|_, y: &f64| -y, 1.0, &problem)?;
/// let curve = solution.dense.expect("asked for");
/// assert!((curve.at(1.234).expect("within") - (-1.234_f64).exp()).abs() < 1e-7);
/// assert_eq!(curve.at(3.0), Some(solution.end));
/// assert_eq!(curve.at(3.1), None);
/// # Ok::<(), ode_deform::solve::SolveError>(())
/// ```
///
/// It keeps the states at both ends and the derivatives at all stages of each step. Methods whose last stage is not the
/// first of the next step cost one evaluation more in all, at the end.
#[derive(Clone, Debug, PartialEq)]
pub struct Dense<Y> {
    tableau: &'static Tableau,
    pieces: Vec<Piece<Y>>,
    /// When it ends: within the last piece, where an event did.
    last: f64,
}

/// A step, as a curve.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Piece<Y> {
    pub(super) times: [f64; 2],
    pub(super) before: Y,
    pub(super) after: Y,
    pub(super) derivatives: Vec<Y>,
    pub(super) end: Option<Y>,
}

impl<Y: State> Dense<Y> {
    pub(super) fn new(tableau: &'static Tableau, pieces: Vec<Piece<Y>>) -> Option<Self> {
        let last = pieces.last()?.times[1];
        Some(Self { tableau, pieces, last })
    }

    /// Ends it at a time of its last piece.
    pub(super) fn cut(&mut self, last: f64) {
        self.last = last;
    }

    /// When it begins and ends.
    pub fn span(&self) -> [f64; 2] {
        [self.pieces.first().map_or(self.last, |piece| piece.times[0]), self.last]
    }

    /// The state at a time, none outside of the span. `O(log steps)` and one linear combination.
    pub fn at(&self, time: f64) -> Option<Y> {
        let [first, last] = self.span();
        let direction = if last < first { -1.0 } else { 1.0 };
        let passed = |a: f64, b: f64| (b - a) * direction >= 0.0;
        if !passed(first, time) || !passed(time, last) {
            return None;
        }
        let piece = self.pieces.partition_point(|piece| !passed(time, piece.times[1]));
        let Piece { times: [from, to], before, after, derivatives, end } =
            self.pieces.get(piece)?;
        if time == *from {
            return Some(before.clone());
        }
        if time == *to {
            return Some(after.clone());
        }
        let theta = (time - from) / (to - from);
        Some(self.tableau.interpolate(theta, to - from, before, derivatives, end.as_ref()))
    }
}
