//! When a deformation starts, and the sizes of its steps.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::solve::{Problem, StepController, Tableau};

/// Random starts and step sizes, as the deformation in continuous time is trained with, and what stands for them where
/// nothing may be random.
///
/// Training draws the start from `U(start)` and each step from `U(step)`. The paper does not say how it tests; the
/// numbers of steps that it reports are those of the same draws. Here the deterministic protocol is: start in the middle
/// of its range, and steps of the mean size, the last one cut so that it ends at 1.
///
/// ```
/// use ode_deform::deform::Schedule;
/// use ode_deform::solve::{EULER, StepController};
///
/// let problem = Schedule::DEEP.fixed(&EULER);
/// assert_eq!((problem.span, problem.control), ([0.125, 1.0], StepController::Fixed { step: 0.125 }));
/// assert_eq!(Schedule::DEEP.random(&EULER, 7, 3), Schedule::DEEP.random(&EULER, 7, 3));
/// ```
///
/// # References
/// The paper on neural ODEs for Pixel2Mesh, algorithm 1 and section 4.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Schedule {
    /// Least and greatest start, before 1.
    pub start: [f64; 2],
    /// Least and greatest step.
    pub step: [f64; 2],
}

impl Schedule {
    /// The paper's deep setting: start in U(0, 0.25), steps in U(0.05, 0.2), about 7.5 of them.
    pub const DEEP: Self = Self { start: [0.0, 0.25], step: [0.05, 0.2] };
    /// The paper's shallow setting: steps in U(0.2, 0.3), about 4 of them.
    pub const SHALLOW: Self = Self { start: [0.0, 0.25], step: [0.2, 0.3] };

    /// As in training: the start and the seed of the steps follow from `seed` and `draw`.
    pub fn random(&self, tableau: &'static Tableau, seed: u64, draw: u64) -> Problem {
        let [low, high] = self.step;
        if high <= low {
            return Problem { span: [self.drawn(seed, draw), 1.0], ..self.fixed(tableau) };
        }
        let control = StepController::Random { low, high, seed, sample: draw };
        Problem::new([self.drawn(seed, draw), 1.0], tableau, control)
    }

    /// The deterministic protocol.
    pub fn fixed(&self, tableau: &'static Tableau) -> Problem {
        let middle = |[low, high]: [f64; 2]| f64::midpoint(low, high);
        let control = StepController::Fixed { step: middle(self.step) };
        Problem::new([middle(self.start), 1.0], tableau, control)
    }

    fn drawn(&self, seed: u64, draw: u64) -> f64 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        // The steps take the stream of this number: the start takes one from the other end.
        rng.set_stream(!draw);
        self.start[0] + (self.start[1] - self.start[0]) * rng.random::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve::{EULER, solve};

    /// The published counts of steps, 7.55 and 4.01, are those of the published loop, which takes a last step past 1.
    #[test]
    fn as_many_steps_as_published() {
        for (schedule, published) in [(Schedule::DEEP, 7.55), (Schedule::SHALLOW, 4.01)] {
            let draws = 4000;
            let steps = |draw| {
                let problem = schedule.random(&EULER, 5, draw).overshooting();
                assert!(problem.span[0] >= 0.0 && problem.span[0] < 0.25);
                let solution =
                    solve(|_: f64, _: &f64| 0.0, 0.0_f64, &problem).expect("fixed steps");
                solution.stats.accepted
            };
            let mean = (0..draws).map(steps).sum::<usize>() as f64 / draws as f64;
            assert!((mean - published).abs() < 0.12, "{mean} for {published}");
        }
    }

    #[test]
    fn starts_fill_their_range() {
        let starts: Vec<f64> =
            (0..2000).map(|i| Schedule::DEEP.random(&EULER, 1, i).span[0]).collect();
        let mean = starts.iter().sum::<f64>() / 2000.0;
        assert!((mean - 0.125).abs() < 0.007, "{mean}");
        let still = Schedule { start: [0.0, 0.0], step: [0.1, 0.1] };
        assert_eq!(still.random(&EULER, 1, 2), still.fixed(&EULER));
    }
}
