//! Stochastic gradient descent with momentum.

use crate::Real;
use crate::kernels::update::{self, SgdStep};
use crate::optim::{Method, Optimizer};

/// Stochastic gradient descent:
///
/// ```text
/// g ← g + decay w        v ← momentum v + g        w ← w - lr v
/// ```
///
/// or `w ← w - lr (g + momentum v)` with Nesterov's look-ahead. As `torch.optim.SGD` with
/// `dampening = 0`.
///
/// # References
/// Sutskever et al. 2013, *On the importance of initialization and momentum in deep learning*.
pub type Sgd<F = f32> = Optimizer<SgdMethod, F>;

/// The numbers of [`Sgd`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SgdMethod {
    /// Part of the velocity that is kept, in `[0, 1)`.
    pub momentum: f64,
    /// Whether to look ahead along the velocity.
    pub nesterov: bool,
    /// Pull towards zero, added to the gradient.
    pub weight_decay: f64,
}

impl<F: Real> Sgd<F> {
    /// Plain descent; [`with`](Optimizer::with) adds momentum.
    pub fn new(lr: f64) -> Self {
        Self::with_method(SgdMethod::default(), lr)
    }
}

impl Method for SgdMethod {
    const MOMENTS: &'static [&'static str] = &["m"];

    fn update<F: Real>(&self, lr: f64, _: u64, w: &mut [F], g: &[F], moments: &mut [Vec<F>]) {
        let step = SgdStep {
            lr: F::from_f64(lr),
            momentum: F::from_f64(self.momentum),
            decay: F::from_f64(self.weight_decay),
            nesterov: self.nesterov,
        };
        update::sgd(&step, w, g, &mut moments[0]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values worked out by hand with w = 1, g = w² derivative 2w, lr = 0.1, momentum = 0.9,
    /// decay = 0.5:
    /// step 1: g = 2 + 0.5 = 2.5, v = 2.5, w = 0.75;
    /// step 2: g = 1.5 + 0.375 = 1.875, v = 2.25 + 1.875 = 4.125, w = 0.3375.
    #[test]
    fn by_hand() {
        let mut sgd = Sgd::<f64>::new(0.1).with(|m| (m.momentum, m.weight_decay) = (0.9, 0.5));
        let mut w = [1.0];
        for expected in [0.75, 0.3375] {
            let g = [2.0 * w[0]];
            sgd.update("w", &mut w, &g);
            assert!((w[0] - expected).abs() < 1e-15);
        }
    }

    /// With Nesterov: step 1: v = 2.5, w = 1 - 0.1 (2.5 + 0.9 * 2.5) = 0.525;
    /// step 2: g = 1.05 + 0.2625 = 1.3125, v = 2.25 + 1.3125 = 3.5625,
    /// w = 0.525 - 0.1 (1.3125 + 3.20625) = 0.073125.
    #[test]
    fn nesterov_by_hand() {
        let mut sgd = Sgd::<f64>::new(0.1).with(|m| {
            *m = SgdMethod { momentum: 0.9, weight_decay: 0.5, nesterov: true };
        });
        let mut w = [1.0];
        for expected in [0.525, 0.073125] {
            let g = [2.0 * w[0]];
            sgd.update("w", &mut w, &g);
            assert!((w[0] - expected).abs() < 1e-15);
        }
    }
}
