//! Runge-Kutta methods as data.

use super::{SolveError, State};

/// A Butcher tableau as printed in the books, and what turns its stages into a curve.
///
/// ```text
/// k_i = f(t + c_i h, y + h Σ_j a_ij k_j)        y' = y + h Σ b_i k_i        error = h Σ e_i k_i
/// ```
///
/// A method of your own is another constant. [`checked`](Self::checked) sees whether its numbers fit together when it is
/// compiled, and [`check`](Self::check) when a [`Problem`](super::Problem) is; whether it has the order that it claims is for tests.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tableau {
    /// Its name in messages and reports.
    pub name: &'static str,
    /// Order of the solution that goes on.
    pub order: u32,
    /// Row `i` weighs the stages before stage `i`; the first row is empty.
    pub a: &'static [&'static [f64]],
    /// Weights of the stages in the step.
    pub b: &'static [f64],
    /// Where in the step each stage lies.
    pub c: &'static [f64],
    /// `b` minus the weights of the embedded method, which is of one order less.
    pub error: Option<&'static [f64]>,
    /// What each stage adds, times `θ² (1 - θ)²`, to the cubic through both ends of a step.
    pub dense: Option<&'static [f64]>,
    /// Whether the last stage is taken for the first of the next step although it is not quite that
    /// ([`is_fsal`](Self::is_fsal) says whether it is).
    pub carries_last: bool,
    /// Where the numbers are from.
    pub reference: &'static str,
}

/// What one step gave, before it is judged.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Attempt<Y> {
    /// The state at the end.
    pub after: Y,
    /// The derivatives at the stages.
    pub derivatives: Vec<Y>,
    /// How often the field was evaluated.
    pub evaluations: usize,
}

impl Tableau {
    /// Number of stages.
    pub const fn stages(&self) -> usize {
        self.b.len()
    }

    /// Whether the last stage is the first of the next step, so that it costs nothing there.
    pub const fn is_fsal(&self) -> bool {
        let last = self.stages() - 1;
        if last == 0 || self.c[last] != 1.0 || self.b[last] != 0.0 {
            return false;
        }
        let mut i = 0;
        while i < last {
            if self.a[last][i] != self.b[i] {
                return false;
            }
            i += 1;
        }
        true
    }

    /// Evaluations of the field in each step but the first.
    pub const fn evaluations_per_step(&self) -> usize {
        self.stages() - (self.is_fsal() || self.carries_last) as usize
    }

    /// The same, if these are the numbers of an explicit method: a constant that is made so and is none does not compile.
    ///
    /// ```
    /// use ode_deform::solve::{HEUN, Tableau};
    ///
    /// const RALSTON: Tableau = Tableau {
    ///     name: "ralston",
    ///     a: &[&[], &[2.0 / 3.0]],
    ///     b: &[1.0 / 4.0, 3.0 / 4.0],
    ///     c: &[0.0, 2.0 / 3.0],
    ///     error: None,
    ///     ..HEUN
    /// }
    /// .checked();
    /// # assert_eq!(RALSTON.stages(), 2);
    /// ```
    ///
    /// ```compile_fail
    /// # use ode_deform::solve::{HEUN, Tableau};
    /// const HEAVY: Tableau = Tableau { b: &[0.5, 0.6], ..HEUN }.checked();
    /// # assert_eq!(HEAVY.stages(), 2);
    /// ```
    ///
    /// # Panics
    /// With what [`check`](Self::check) finds.
    #[must_use]
    pub const fn checked(self) -> Self {
        match self.misfit() {
            None => self,
            Some(what) => panic!("{}", what),
        }
    }

    /// Whether these are the numbers of an explicit method: lists of one length, rows of stages before, whose sums are
    /// where they lie, weights of sum 1 and those of the error of sum 0.
    ///
    /// # Errors
    /// What does not fit.
    pub const fn check(&self) -> Result<(), SolveError> {
        match self.misfit() {
            None => Ok(()),
            Some(what) => Err(SolveError::Tableau { method: self.name, what }),
        }
    }

    /// What does not fit together.
    const fn misfit(&self) -> Option<&'static str> {
        let stages = self.b.len();
        if stages == 0 || self.a.len() != stages || self.c.len() != stages {
            return Some("a, b and c need one row for each stage, at least one");
        }
        let mut stage = 0;
        while stage < stages {
            if self.a[stage].len() > stage {
                return Some("a row of a weighs a stage that is not yet known");
            }
            if !near(sum(self.a[stage]), self.c[stage]) {
                return Some("a row of a does not add up to its c");
            }
            stage += 1;
        }
        if self.order == 0 || !near(sum(self.b), 1.0) {
            return Some("the weights b do not add up to 1, or the order is 0");
        }
        if !self.adds_nothing(self.error) || !self.adds_nothing(self.dense) {
            return Some(
                "weights of the error or between the ends do not add up to 0, one a stage",
            );
        }
        None
    }

    /// Whether weights, if there are any, are one a stage and of sum 0.
    const fn adds_nothing(&self, weights: Option<&[f64]>) -> bool {
        match weights {
            None => true,
            Some(weights) => weights.len() == self.b.len() && near(sum(weights), 0.0),
        }
    }

    /// One step from `t` to `next`: manual stepping.
    ///
    /// `first` is the derivative at `t`, if it is known. With `closing` false the derivative at the end of a step whose last
    /// stage is the first of the next is left out: the state does not depend on it.
    pub fn attempt<Y: State>(
        &self,
        field: &mut impl FnMut(f64, &Y) -> Y,
        [t, next]: [f64; 2],
        y: &Y,
        first: Option<Y>,
        closing: bool,
    ) -> Attempt<Y> {
        let (h, fsal) = (next - t, self.is_fsal());
        let mut evaluations = usize::from(first.is_none());
        let mut derivatives = Vec::with_capacity(self.stages());
        derivatives.push(first.unwrap_or_else(|| field(t, y)));
        for stage in 1..self.stages() {
            let at = shifted(y, h, self.a[stage], &derivatives);
            let last = fsal && stage + 1 == self.stages();
            if !last || closing {
                // Rounded otherwise than `next`, the last stage would not be the first of the next step.
                let time = if self.c[stage] == 1.0 { next } else { t + self.c[stage] * h };
                derivatives.push(field(time, &at));
                evaluations += 1;
            }
            if last {
                return Attempt { after: at, derivatives, evaluations };
            }
        }
        Attempt { after: shifted(y, h, self.b, &derivatives), derivatives, evaluations }
    }

    /// The estimated error of a step of size `h`, if the method has an estimate.
    pub fn error_of<Y: State>(&self, h: f64, derivatives: &[Y]) -> Option<Y> {
        let weights = self.error?;
        Some(Y::lincomb(&weighted(h, weights, derivatives)))
    }

    /// The state at `t + θ h`, `θ` in `[0, 1]`: the cubic through both ends with their derivatives, and for Dormand-Prince
    /// and Tsitouras their own quartics.
    ///
    /// `end` is the derivative at the end of the step; none is needed where the last stage lies there.
    ///
    /// # References
    /// Hairer, Nørsett, Wanner 1993, *Solving Ordinary Differential Equations I*, II.6.
    ///
    /// # Panics
    /// If the method needs `end` and has none.
    pub fn interpolate<Y: State>(
        &self,
        theta: f64,
        h: f64,
        before: &Y,
        derivatives: &[Y],
        end: Option<&Y>,
    ) -> Y {
        let rest = 1.0 - theta;
        let mut weights: Vec<f64> =
            self.b.iter().map(|b| b * theta * theta * (3.0 - 2.0 * theta)).collect();
        weights[0] += theta * rest * rest;
        if let Some(dense) = self.dense {
            for (w, d) in weights.iter_mut().zip(dense) {
                *w += d * (theta * rest).powi(2);
            }
        }
        let closing = -theta * theta * rest;
        if self.is_fsal() {
            weights[self.stages() - 1] += closing;
        }
        let mut terms = vec![(1.0, before)];
        terms.extend(weighted(h, &weights, derivatives));
        if !self.is_fsal() {
            terms.push((h * closing, end.expect("the derivative at the end of the step")));
        }
        Y::lincomb(&terms)
    }
}

const fn sum(weights: &[f64]) -> f64 {
    let (mut sum, mut i) = (0.0, 0);
    while i < weights.len() {
        sum += weights[i];
        i += 1;
    }
    sum
}

const fn near(sum: f64, value: f64) -> bool {
    (sum - value).abs() < 1e-12
}

/// `y + h Σ w k`.
fn shifted<Y: State>(y: &Y, h: f64, weights: &[f64], derivatives: &[Y]) -> Y {
    let mut terms = Vec::with_capacity(derivatives.len() + 1);
    terms.push((1.0, y));
    terms.extend(weighted(h, weights, derivatives));
    Y::lincomb(&terms)
}

/// Those terms `(h w, k)` whose weight is not zero.
fn weighted<'y, Y>(h: f64, weights: &[f64], derivatives: &'y [Y]) -> Vec<(f64, &'y Y)> {
    let all = weights.iter().zip(derivatives);
    all.filter(|(w, _)| **w != 0.0).map(|(w, k)| (h * w, k)).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::solve::{HEUN, Problem, StepController, solve};

    /// Each way in which numbers are no method is found before anything is integrated.
    #[test]
    fn what_is_no_method_is_refused() {
        const SHORT: Tableau = Tableau { c: &[0.0], ..HEUN };
        const IMPLICIT: Tableau = Tableau { a: &[&[0.5], &[0.5]], ..HEUN };
        const ELSEWHERE: Tableau = Tableau { c: &[0.0, 0.5], ..HEUN };
        const HEAVY: Tableau = Tableau { b: &[0.5, 0.6], ..HEUN };
        const WRONG: Tableau = Tableau { error: Some(&[0.5, 0.5]), ..HEUN };
        const NOTHING: Tableau = Tableau { a: &[], b: &[], c: &[], error: None, ..HEUN };
        for (tableau, what) in [
            (&SHORT, "one row for each stage"),
            (&IMPLICIT, "not yet known"),
            (&ELSEWHERE, "add up to its c"),
            (&HEAVY, "add up to 1"),
            (&WRONG, "add up to 0"),
            (&NOTHING, "at least one"),
        ] {
            let problem = Problem::new([0.0, 1.0], tableau, StepController::Fixed { step: 0.1 });
            let error = solve(|_, y: &f64| *y, 1.0, &problem).unwrap_err().to_string();
            assert!(
                error.starts_with("the method heun is none:") && error.contains(what),
                "{error}"
            );
        }
    }
}
