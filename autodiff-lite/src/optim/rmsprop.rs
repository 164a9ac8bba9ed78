//! RMSprop: steps divided by the running size of the gradient.

use crate::Real;
use crate::kernels::update::{self, RmsPropStep};
use crate::optim::{Method, Optimizer};

/// RMSprop:
///
/// ```text
/// g ← g + decay w      v ← α v + (1 - α) g²      a ← α a + (1 - α) g
/// m ← momentum m + g / (sqrt(v - [centered] a²) + ε)                    w ← w - lr m
/// ```
///
/// As `torch.optim.RMSprop`, whose ε is outside of the root.
///
/// # References
/// Tieleman and Hinton 2012, *Lecture 6.5: rmsprop*; centred: Graves 2013, *Generating sequences with recurrent
/// neural networks*, section 4.2.
pub type RmsProp<F = f32> = Optimizer<RmsPropMethod, F>;

/// The numbers of [`RmsProp`].
#[derive(Clone, Debug, PartialEq)]
pub struct RmsPropMethod {
    /// Decay of the mean of squared gradients, `α`.
    pub alpha: f64,
    /// Keeps the division finite.
    pub epsilon: f64,
    /// Pull towards zero, added to the gradient.
    pub weight_decay: f64,
    /// Part of the velocity that is kept, in `[0, 1)`.
    pub momentum: f64,
    /// Whether the variance of the gradient stands for its mean square.
    pub centered: bool,
}

impl Default for RmsPropMethod {
    fn default() -> Self {
        Self { alpha: 0.99, epsilon: 1e-8, weight_decay: 0.0, momentum: 0.0, centered: false }
    }
}

impl<F: Real> RmsProp<F> {
    /// PyTorch's defaults; [`with`](Optimizer::with) changes them.
    pub fn new(lr: f64) -> Self {
        Self::with_method(RmsPropMethod::default(), lr)
    }
}

impl Method for RmsPropMethod {
    const MOMENTS: &'static [&'static str] = &["v", "m", "a"];

    fn update<F: Real>(&self, lr: f64, _: u64, w: &mut [F], g: &[F], moments: &mut [Vec<F>]) {
        let step = RmsPropStep {
            lr: F::from_f64(lr),
            alpha: F::from_f64(self.alpha),
            rest: F::from_f64(1.0 - self.alpha),
            epsilon: F::from_f64(self.epsilon),
            decay: F::from_f64(self.weight_decay),
            momentum: F::from_f64(self.momentum),
            centered: self.centered,
        };
        let [v, m, a] = moments else { unreachable!("as many as there are names") };
        update::rmsprop(&step, w, g, [v, m, a]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand with w = 1, g = 2w, lr = 0.1, α = 0.75, ε = 0:
    /// step 1: g = 2, v = 1, w = 1 - 0.1 · 2 = 0.8;
    /// step 2: g = 1.6, v = 0.75 + 0.64 = 1.39, w = 0.8 - 0.16 / sqrt(1.39).
    #[test]
    fn by_hand() {
        let mut optimizer = RmsProp::<f64>::new(0.1).with(|m| (m.alpha, m.epsilon) = (0.75, 0.0));
        let mut w = [1.0];
        for expected in [0.8, 0.8 - 0.16 / 1.39_f64.sqrt()] {
            let g = [2.0 * w[0]];
            optimizer.update("w", &mut w, &g);
            assert!((w[0] - expected).abs() < 1e-15);
        }
    }

    /// Long enough for the parallel path: each element as if it were alone.
    #[test]
    fn every_element_is_treated_alike() {
        let n = 200_003;
        let gradient: Vec<f64> = (0..n).map(|i| ((i % 17) as f64 - 8.0) / 5.0).collect();
        let all = |m: &mut RmsPropMethod| {
            (m.momentum, m.weight_decay, m.centered) = (0.9, 0.1, true);
        };
        let (mut many, mut one) = (RmsProp::new(0.01).with(all), RmsProp::new(0.01).with(all));
        let (mut w, mut last) = (vec![1.0; n], [1.0]);
        for _ in 0..3 {
            many.update("w", &mut w, &gradient);
            one.update("w", &mut last, &gradient[n - 1..]);
        }
        assert_eq!(w[n - 1], last[0]);
    }
}
