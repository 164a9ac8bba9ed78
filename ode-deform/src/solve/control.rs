//! How long the steps are.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{SolveError, Tableau, Tolerance};

/// How long the steps are. Sizes are positive in either direction of time.
///
/// Another policy is a loop of your own over [`Tableau::attempt`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum StepController {
    /// All of the same size, but for the last.
    Fixed {
        /// The size.
        step: f64,
    },
    /// Each drawn evenly from `[low, high)`, as in training a deformation in continuous time.
    Random {
        /// Least size.
        low: f64,
        /// Greatest size.
        high: f64,
        /// Seed of the run and step of the training.
        seed: u64,
        /// Which sample: each draws from a stream of its own.
        sample: u64,
    },
    /// As long as the error allows.
    Pid(Pid),
}

/// Step sizes by a proportional-integral-derivative controller on the logarithm of the error.
///
/// ```text
/// next = h safety ε₀^(-(p + i + d) / order) ε₁^((p + 2 d) / order) ε₂^(-d / order)
/// ```
///
/// with `ε₀, ε₁, ε₂` the present error and those of the two steps accepted before.
///
/// # References
/// Söderlind 2003, *Digital filters in adaptive time-stepping*; Hairer, Nørsett, Wanner 1993, II.4.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pid {
    /// The error a step may have.
    pub tolerance: Tolerance,
    /// Weight of the change of the error. 0 by default; 0.4 with an integral of 0.3 damps oscillating sizes.
    pub proportional: f64,
    /// Weight of the error. 1 by default.
    pub integral: f64,
    /// Weight of the change of the change. 0 by default.
    pub derivative: f64,
    /// How much shorter than predicted, 0.9 by default.
    pub safety: f64,
    /// A step is never less than this times the one before, 0.2 by default.
    pub shrink: f64,
    /// Nor more than this times, 10 by default.
    pub grow: f64,
    /// Size of the first step; by default it is guessed from the field, for one more evaluation.
    pub first: Option<f64>,
}

impl Pid {
    /// With the default weights.
    pub const fn new(tolerance: Tolerance) -> Self {
        Self {
            tolerance,
            proportional: 0.0,
            integral: 1.0,
            derivative: 0.0,
            safety: 0.9,
            shrink: 0.2,
            grow: 10.0,
            first: None,
        }
    }
}

impl Pid {
    /// Limits and weights with which steps become smaller when rejected and never are no number.
    fn check(&self) -> Result<(), SolveError> {
        let within = |what, found: f64, low: f64, high: f64, expected| {
            let good = found > low && found <= high;
            if good { Ok(()) } else { Err(SolveError::Problem { what, found, expected }) }
        };
        let share = "a number above 0 and at most 1 expected";
        within("the safety factor", self.safety, 0.0, 1.0, share)?;
        let below = "a number above 0 and below 1 expected";
        within("the least factor of a step", self.shrink, 0.0, 1.0_f64.next_down(), below)?;
        let above = "a finite number of at least 1 expected";
        within("the greatest factor of a step", self.grow, 1.0_f64.next_down(), f64::MAX, above)?;
        for (what, weight) in [
            ("the proportional weight", self.proportional),
            ("the integral weight", self.integral),
            ("the derivative weight", self.derivative),
        ] {
            within(what, weight, f64::NEG_INFINITY, f64::MAX, "a finite number expected")?;
        }
        Ok(())
    }
}

impl StepController {
    /// [`Pid`] with the default weights.
    pub const fn adaptive(relative: f64, absolute: f64) -> Self {
        Self::Pid(Pid::new(Tolerance { relative, absolute }))
    }

    /// The error a step may have, if steps follow it.
    pub const fn tolerance(&self) -> Option<Tolerance> {
        match self {
            Self::Pid(pid) => Some(pid.tolerance),
            Self::Fixed { .. } | Self::Random { .. } => None,
        }
    }

    pub(super) fn check(&self, tableau: &Tableau) -> Result<(), SolveError> {
        let positive = |what, found: f64| {
            let expected = "a positive, finite number expected";
            let good = found > 0.0 && found.is_finite();
            if good { Ok(()) } else { Err(SolveError::Problem { what, found, expected }) }
        };
        match *self {
            Self::Fixed { step } => positive("the step size", step),
            Self::Random { low, high, .. } => {
                positive("the least step size", low)?;
                positive("the greatest step size", high)?;
                let expected = "it must exceed the least";
                let what = "the greatest step size";
                if high > low {
                    Ok(())
                } else {
                    Err(SolveError::Problem { what, found: high, expected })
                }
            }
            Self::Pid(pid) => {
                let Tolerance { relative, absolute } = pid.tolerance;
                let none = tableau.error.is_none();
                if none {
                    return Err(SolveError::NoErrorEstimate { method: tableau.name });
                }
                if relative != 0.0 {
                    positive("the relative tolerance", relative)?;
                }
                positive("the absolute tolerance", absolute)?;
                pid.check()?;
                pid.first.map_or(Ok(()), |first| positive("the first step size", first))
            }
        }
    }
}

/// What a controller remembers.
#[derive(Clone, Debug)]
pub(super) enum Memory {
    Fixed(f64),
    Random { rng: Box<ChaCha8Rng>, low: f64, high: f64 },
    Pid { pid: Pid, order: f64, errors: [f64; 2], rejected: bool },
}

/// What becomes of a step, and how long the next attempt is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Verdict {
    Accept { next: f64 },
    Reject { retry: f64 },
}

impl Memory {
    pub(super) fn new(control: &StepController, order: u32) -> Self {
        match *control {
            StepController::Fixed { step } => Self::Fixed(step),
            StepController::Random { low, high, seed, sample } => {
                let mut rng = ChaCha8Rng::seed_from_u64(seed);
                rng.set_stream(sample);
                Self::Random { rng: Box::new(rng), low, high }
            }
            StepController::Pid(pid) => {
                Self::Pid { pid, order: order as f64, errors: [1.0; 2], rejected: false }
            }
        }
    }

    /// The size of the first step, if it does not take the field to know.
    pub(super) fn first(&mut self) -> Option<f64> {
        match self {
            Self::Fixed(step) => Some(*step),
            Self::Random { rng, low, high } => Some(rng.random_range(*low..*high)),
            Self::Pid { pid, .. } => pid.first,
        }
    }

    /// Judges a step of this size by its error, which is not a number where the step led nowhere.
    pub(super) fn judge(&mut self, size: f64, error: f64) -> Verdict {
        match self {
            Self::Fixed(step) => Verdict::Accept { next: *step },
            Self::Random { rng, low, high } => {
                Verdict::Accept { next: rng.random_range(*low..*high) }
            }
            Self::Pid { pid, .. } if !error.is_finite() => {
                let retry = size * pid.shrink;
                if let Self::Pid { rejected, .. } = self {
                    *rejected = true;
                }
                Verdict::Reject { retry }
            }
            Self::Pid { pid, order, errors, rejected } => {
                let (p, i, d) = (pid.proportional, pid.integral, pid.derivative);
                // A perfect step says nothing about how much longer it might have been.
                let present = error.max(1e-10);
                let factor = pid.safety
                    * present.powf(-(p + i + d) / *order)
                    * errors[0].powf((p + 2.0 * d) / *order)
                    * errors[1].powf(-d / *order);
                if error <= 1.0 {
                    let most = if *rejected { 1.0 } else { pid.grow };
                    *errors = [present, errors[0]];
                    *rejected = false;
                    Verdict::Accept { next: size * factor.clamp(pid.shrink.min(most), most) }
                } else {
                    *rejected = true;
                    let most = pid.safety.max(pid.shrink);
                    Verdict::Reject { retry: size * factor.clamp(pid.shrink, most) }
                }
            }
        }
    }
}
