//! An initial value problem and solver options.

use super::{SolveError, StepController, Tableau};

/// From when to when, by which method, in which steps, and which times are asked for.
///
/// Time runs either way. Steps and times are `f64` whatever the state is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    /// First and last time; the last may be the lesser.
    pub span: [f64; 2],
    /// The method.
    pub tableau: &'static Tableau,
    /// The sizes of the steps.
    pub control: StepController,
    /// What the last step does.
    pub ending: Ending,
    /// When to give up.
    pub limits: Limits,
    /// Times at which the state is wanted besides the end, in the order in which they are passed. Steps do not depend
    /// on them: what lies within one is interpolated.
    pub save_at: Vec<f64>,
    /// Whether the solution is kept as a curve, to be asked for any time afterwards: see
    /// [`Solution::dense`](super::Solution::dense). Not by adjoints.
    pub dense: bool,
}

/// What the last step does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Ending {
    /// It is cut so that it ends at the last time exactly.
    #[default]
    Exact,
    /// It is as long as the others and steps past the last time, and while the last time is reached but not passed
    /// another follows: the loop published with the deformation of Pixel2Mesh in continuous time.
    Overshoot,
}

/// When to give up, and how long a step may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// The most attempts, 100,000 by default.
    pub steps: usize,
    /// The least size of a step that the error may ask for; never less than a few units in the last place of the time.
    /// 0 by default.
    pub least_step: f64,
    /// The greatest size of a step that the error may ask for, so that what happens in between is seen: a short pulse of the field, an
    /// [event](super::solve_until) and its reversal. Infinite by default.
    pub greatest_step: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { steps: 100_000, least_step: 0.0, greatest_step: f64::INFINITY }
    }
}

impl Problem {
    /// Ends exactly, and asks for no time in between.
    pub fn new(span: [f64; 2], tableau: &'static Tableau, control: StepController) -> Self {
        let (ending, limits) = (Ending::default(), Limits::default());
        Self { span, tableau, control, ending, limits, save_at: Vec::new(), dense: false }
    }

    /// The same problem, asking for the states at these times.
    #[must_use]
    pub fn save_at(mut self, times: impl IntoIterator<Item = f64>) -> Self {
        self.save_at = times.into_iter().collect();
        self
    }

    /// The same problem, whose solution is kept as a curve.
    #[must_use]
    pub fn save_dense(mut self) -> Self {
        self.dense = true;
        self
    }

    /// The same problem, whose last step goes past the end as the others fall.
    #[must_use]
    pub fn overshooting(mut self) -> Self {
        self.ending = Ending::Overshoot;
        self
    }

    /// 1 or -1.
    pub(crate) fn direction(&self) -> f64 {
        if self.span[1] < self.span[0] { -1.0 } else { 1.0 }
    }

    /// Whether its numbers make sense.
    ///
    /// # Errors
    /// The first one that does not.
    pub fn check(&self) -> Result<(), SolveError> {
        let fail = |what, found, expected| Err(SolveError::Problem { what, found, expected });
        for time in self.span {
            if !time.is_finite() {
                return fail("a time of the span", time, "a finite number expected");
            }
        }
        let mut before = self.span[0];
        for &time in &self.save_at {
            let passed = |a: f64, b: f64| (b - a) * self.direction() >= 0.0;
            if !passed(before, time) || !passed(time, self.span[1]) {
                let expected =
                    "times of save_at lie in the span, in the order in which they are passed";
                return fail("a time of save_at", time, expected);
            }
            before = time;
        }
        let greatest = self.limits.greatest_step;
        if greatest.is_nan() || greatest <= 0.0 {
            return fail("the greatest step", greatest, "a number above 0 expected");
        }
        self.tableau.check()?;
        self.control.check(self.tableau)
    }
}
