//! Learning rates over time.

/// A factor for the learning rate as a function of the step: nothing to save, nothing to resume.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Schedule {
    /// Always 1.
    Constant,
    /// Times `gamma` after every `every` steps.
    Step {
        /// Steps between two drops.
        every: u64,
        /// What a drop multiplies by.
        gamma: f64,
    },
    /// Times `gamma` at each of these steps, given in ascending order.
    MultiStep {
        /// Steps at which to drop.
        milestones: Vec<u64>,
        /// What a drop multiplies by.
        gamma: f64,
    },
    /// Times `gamma` after each step.
    Exponential {
        /// What each step multiplies by.
        gamma: f64,
    },
    /// A straight rise over `warmup` steps, then half a cosine down to `floor` at step `total`,
    /// and `floor` ever after.
    Cosine {
        /// Steps of the rise; may be 0.
        warmup: u64,
        /// The step at which the floor is reached.
        total: u64,
        /// The smallest factor.
        floor: f64,
    },
}

impl Schedule {
    /// A cosine to zero after a warm-up.
    pub fn cosine(warmup: u64, total: u64) -> Self {
        Self::Cosine { warmup, total, floor: 0.0 }
    }

    /// The factor for step `step`, counted from 0.
    pub fn factor(&self, step: u64) -> f64 {
        match *self {
            Self::Constant => 1.0,
            Self::Step { every, gamma } => gamma.powf((step / every.max(1)) as f64),
            Self::MultiStep { ref milestones, gamma } => {
                let passed = milestones.iter().filter(|&&milestone| milestone <= step).count();
                gamma.powf(passed as f64)
            }
            Self::Exponential { gamma } => gamma.powf(step as f64),
            Self::Cosine { warmup, .. } if step < warmup => (step + 1) as f64 / warmup as f64,
            Self::Cosine { total, floor, .. } if step >= total => floor,
            Self::Cosine { warmup, total, floor } => {
                let phase = (step - warmup) as f64 / (total - warmup) as f64;
                floor + (1.0 - floor) * 0.5 * (1.0 + (std::f64::consts::PI * phase).cos())
            }
        }
    }
}

/// Drops the learning rate when a loss no longer falls. As `ReduceLROnPlateau` with a relative
/// threshold.
///
/// Its state is its public fields: save them with the run.
#[derive(Clone, Debug, PartialEq)]
pub struct Plateau {
    /// What a drop multiplies by.
    pub gamma: f64,
    /// Observations without improvement that are borne before a drop.
    pub patience: u64,
    /// An observation improves when it is below `best (1 - threshold)`.
    pub threshold: f64,
    /// Observations after a drop that do not count.
    pub cooldown: u64,
    /// The smallest factor.
    pub floor: f64,
    /// The present factor.
    pub factor: f64,
    /// The best observation so far.
    pub best: f64,
    /// Observations since the last improvement.
    pub waited: u64,
    /// Observations that still do not count.
    pub cooling: u64,
}

impl Plateau {
    /// Drops by `gamma` after more than `patience` observations without improvement.
    pub fn new(gamma: f64, patience: u64) -> Self {
        Self {
            gamma,
            patience,
            threshold: 1e-4,
            cooldown: 0,
            floor: 0.0,
            factor: 1.0,
            best: f64::INFINITY,
            waited: 0,
            cooling: 0,
        }
    }

    /// Takes in one observation and returns the factor from here on.
    pub fn observe(&mut self, loss: f64) -> f64 {
        if loss < self.best * (1.0 - self.threshold)
            || (self.best == f64::INFINITY && !loss.is_nan())
        {
            self.best = loss;
            self.waited = 0;
        } else {
            self.waited += 1;
        }
        if self.cooling > 0 {
            self.cooling -= 1;
            self.waited = 0;
        }
        if self.waited > self.patience {
            self.factor = (self.factor * self.gamma).max(self.floor);
            self.cooling = self.cooldown;
            self.waited = 0;
        }
        self.factor
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_factors(schedule: &Schedule, expected: &[(u64, f64)]) {
        for &(step, factor) in expected {
            assert!((schedule.factor(step) - factor).abs() < 1e-12, "{schedule:?} at {step}");
        }
    }

    #[test]
    fn factors_by_hand() {
        assert_factors(&Schedule::Constant, &[(0, 1.0), (1000, 1.0)]);
        let step = Schedule::Step { every: 3, gamma: 0.5 };
        assert_factors(&step, &[(0, 1.0), (2, 1.0), (3, 0.5), (6, 0.25)]);
        let multi = Schedule::MultiStep { milestones: vec![2, 5], gamma: 0.1 };
        assert_factors(&multi, &[(1, 1.0), (2, 0.1), (4, 0.1), (5, 0.01)]);
        assert_factors(&Schedule::Exponential { gamma: 0.9 }, &[(0, 1.0), (2, 0.81)]);
        // cos 60° = 1/2, cos 90° = 0, cos 120° = -1/2
        let cosine = Schedule::Cosine { warmup: 4, total: 10, floor: 0.2 };
        let expected = [(0, 0.25), (3, 1.0), (4, 1.0), (6, 0.8), (7, 0.6), (8, 0.4), (10, 0.2)];
        assert_factors(&cosine, &expected);
        assert_factors(&cosine, &[(99, 0.2)]);
    }

    #[test]
    fn a_plateau_waits_then_drops() {
        let mut plateau = Plateau { cooldown: 1, floor: 0.03, ..Plateau::new(0.1, 2) };
        // Improvement, then three without: the third is more than patience bears.
        let observed = [1.0, 0.5, 0.5, 0.49999, 0.6].map(|loss| plateau.observe(loss));
        assert_eq!(observed, [1.0, 1.0, 1.0, 1.0, 0.1]);
        // One cools down, three more until the floor.
        let observed = [0.6, 0.6, 0.6, 0.6].map(|loss| plateau.observe(loss));
        assert_eq!(observed, [0.1, 0.1, 0.1, 0.03]);
        // What is not a number is no improvement, and does not stand in the way of one.
        let mut plateau = Plateau::new(0.1, 2);
        let observed = [f64::NAN, 5.0, 4.0, 3.0, 2.0].map(|loss| plateau.observe(loss));
        assert_eq!(observed, [1.0; 5]);
    }
}
