//! Adam and its relatives.

use crate::Real;
use crate::kernels::update::{self, AdamStep};
use crate::optim::{Method, Optimizer};

/// Adam:
///
/// ```text
/// g ← g + decay w      m ← β₁ m + (1 - β₁) g      v ← β₂ v + (1 - β₂) g²
/// w ← w - lr (m / (1 - β₁ᵗ)) / (sqrt(v / (1 - β₂ᵗ)) + ε)
/// ```
///
/// As `torch.optim.Adam`.
///
/// # References
/// Kingma and Ba 2015, *Adam: a method for stochastic optimization*, algorithm 1.
pub type Adam<F = f32> = Optimizer<AdamMethod, F>;

/// Adam whose weight decay does not pass through the moments: `w ← (1 - lr decay) w` first.
///
/// As `torch.optim.AdamW`; the decay is 0.01 unless set.
///
/// # References
/// Loshchilov and Hutter 2019, *Decoupled weight decay regularization*, algorithm 2.
pub type AdamW<F = f32> = Optimizer<AdamWMethod, F>;

/// Adam with one learning rate for all entries of a tensor:
///
/// ```text
/// w ← w - lr (m / (1 - β₁ᵗ)) / (max sqrt(v / (1 - β₂ᵗ)) + ε)
/// ```
///
/// Each entry having its own learning rate, Adam bends the direction of the step; for vertex
/// positions that undoes a preconditioned gradient's smoothness and depends on the axes.
///
/// # References
/// Nicolet et al. 2021, *Large steps in inverse rendering of geometry*, section 4 (the maximum
/// over the entries, as in the authors' `AdamUniform`).
pub type AdamUniform<F = f32> = Optimizer<AdamUniformMethod, F>;

/// The numbers of [`Adam`].
#[derive(Clone, Debug, PartialEq)]
pub struct AdamMethod {
    /// Decay of the mean of gradients.
    pub beta1: f64,
    /// Decay of the mean of squared gradients.
    pub beta2: f64,
    /// Keeps the division finite.
    pub epsilon: f64,
    /// Pull towards zero, added to the gradient.
    pub weight_decay: f64,
}

impl Default for AdamMethod {
    fn default() -> Self {
        Self { beta1: 0.9, beta2: 0.999, epsilon: 1e-8, weight_decay: 0.0 }
    }
}

/// The numbers of [`AdamW`].
#[derive(Clone, Debug, PartialEq)]
pub struct AdamWMethod {
    /// Decay of the mean of gradients.
    pub beta1: f64,
    /// Decay of the mean of squared gradients.
    pub beta2: f64,
    /// Keeps the division finite.
    pub epsilon: f64,
    /// Part of a weight that a step of length one takes away.
    pub weight_decay: f64,
}

impl Default for AdamWMethod {
    fn default() -> Self {
        Self { beta1: 0.9, beta2: 0.999, epsilon: 1e-8, weight_decay: 0.01 }
    }
}

/// The numbers of [`AdamUniform`].
#[derive(Clone, Debug, PartialEq)]
pub struct AdamUniformMethod {
    /// Decay of the mean of gradients.
    pub beta1: f64,
    /// Decay of the mean of squared gradients.
    pub beta2: f64,
    /// Keeps the division finite.
    pub epsilon: f64,
}

impl Default for AdamUniformMethod {
    fn default() -> Self {
        Self { beta1: 0.9, beta2: 0.999, epsilon: 1e-8 }
    }
}

impl<F: Real> Adam<F> {
    /// PyTorch's defaults; [`with`](Optimizer::with) changes them.
    pub fn new(lr: f64) -> Self {
        Self::with_method(AdamMethod::default(), lr)
    }
}

impl<F: Real> AdamW<F> {
    /// PyTorch's defaults; [`with`](Optimizer::with) changes them.
    pub fn new(lr: f64) -> Self {
        Self::with_method(AdamWMethod::default(), lr)
    }
}

impl<F: Real> AdamUniform<F> {
    /// The usual decays; [`with`](Optimizer::with) changes them.
    pub fn new(lr: f64) -> Self {
        Self::with_method(AdamUniformMethod::default(), lr)
    }
}

/// `1 - betaᵗ`, what the moments lack at the start.
fn correction(beta: f64, step: u64) -> f64 {
    1.0 - beta.powf(step as f64)
}

/// Where a weight decay acts.
#[derive(Clone, Copy)]
enum Decay {
    /// On the gradient, hence on the moments.
    Coupled(f64),
    /// On the weights.
    Decoupled(f64),
}

/// The step that Adam and AdamW share.
fn step<F: Real>(
    [beta1, beta2, epsilon]: [f64; 3],
    decay: Decay,
    lr: f64,
    t: u64,
    [w, m, v]: [&mut [F]; 3],
    g: &[F],
) {
    let (coupled, shrink) = match decay {
        Decay::Coupled(decay) => (decay, 1.0),
        Decay::Decoupled(decay) => (0.0, 1.0 - lr * decay),
    };
    let step = AdamStep {
        beta1: F::from_f64(beta1),
        beta2: F::from_f64(beta2),
        rests: [beta1, beta2].map(|beta| F::from_f64(1.0 - beta)),
        step: F::from_f64(lr / correction(beta1, t)),
        correction: F::from_f64(correction(beta2, t).sqrt()),
        epsilon: F::from_f64(epsilon),
        coupled_decay: F::from_f64(coupled),
        shrink: F::from_f64(shrink),
    };
    update::adam(&step, w, g, m, v);
}

impl Method for AdamMethod {
    const MOMENTS: &'static [&'static str] = &["m", "v"];

    fn update<F: Real>(&self, lr: f64, t: u64, w: &mut [F], g: &[F], moments: &mut [Vec<F>]) {
        let [m, v] = moments else { unreachable!("the optimiser keeps two moments") };
        let decay = Decay::Coupled(self.weight_decay);
        step([self.beta1, self.beta2, self.epsilon], decay, lr, t, [w, m, v], g);
    }
}

impl Method for AdamWMethod {
    const MOMENTS: &'static [&'static str] = &["m", "v"];

    fn update<F: Real>(&self, lr: f64, t: u64, w: &mut [F], g: &[F], moments: &mut [Vec<F>]) {
        let [m, v] = moments else { unreachable!("the optimiser keeps two moments") };
        let decay = Decay::Decoupled(self.weight_decay);
        step([self.beta1, self.beta2, self.epsilon], decay, lr, t, [w, m, v], g);
    }
}

impl Method for AdamUniformMethod {
    const MOMENTS: &'static [&'static str] = &["m", "v"];

    fn update<F: Real>(&self, lr: f64, t: u64, w: &mut [F], g: &[F], moments: &mut [Vec<F>]) {
        let [m, v] = moments else { unreachable!("the optimiser keeps two moments") };
        let (beta1, beta2) = (F::from_f64(self.beta1), F::from_f64(self.beta2));
        let [rest1, rest2] = [self.beta1, self.beta2].map(|beta| F::from_f64(1.0 - beta));
        let mut largest = F::zero();
        for ((m, v), &g) in m.iter_mut().zip(v.iter_mut()).zip(g) {
            *m = beta1 * *m + rest1 * g;
            *v = beta2 * *v + rest2 * g * g;
            largest = if *v > largest { *v } else { largest };
        }
        let root = (largest.to_f64() / correction(self.beta2, t)).sqrt();
        let factor = F::from_f64(lr / correction(self.beta1, t) / (root + self.epsilon));
        for (w, &m) in w.iter_mut().zip(m.iter()) {
            *w -= factor * m;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs `steps` on w = (1, -2) with the gradient (2 w₀, 20 w₁) of w₀² + 10 w₁².
    fn run<M: Method>(mut optimizer: Optimizer<M, f64>, steps: usize) -> [f64; 2] {
        let mut w = [1.0, -2.0];
        for _ in 0..steps {
            let g = [2.0 * w[0], 20.0 * w[1]];
            optimizer.update("w", &mut w, &g);
        }
        w
    }

    fn assert_close(found: [f64; 2], expected: [f64; 2]) {
        for (f, e) in found.iter().zip(expected) {
            assert!((f - e).abs() < 1e-12, "{found:?} instead of {expected:?}");
        }
    }

    /// The first step of Adam has length lr whatever the gradient: m̂ = g, v̂ = g².
    #[test]
    fn the_first_step_by_hand() {
        assert_close(run(Adam::new(0.1).with(|m| m.epsilon = 0.0), 1), [0.9, -1.9]);
        // Decay 0.5 shrinks first: 0.95 * (1, -2).
        let adam_w = AdamW::new(0.1).with(|m| (m.epsilon, m.weight_decay) = (0.0, 0.5));
        assert_close(run(adam_w, 1), [0.85, -1.8]);
        // One length for all: the largest |g| is 40, so the steps are 0.1 * (2, -40) / 40.
        let uniform = AdamUniform::new(0.1).with(|m| m.epsilon = 0.0);
        assert_close(run(uniform, 1), [1.0 - 0.005, -2.0 + 0.1]);
    }

    /// The second step with β₁ = 0.5, β₂ = 0.75, ε = 0, lr = 0.1 on the first entry.
    /// t = 1: g = 2, m = 1, v = 1, w = 0.9.
    /// t = 2: g = 1.8, m = 0.5 + 0.9 = 1.4, v = 0.75 + 0.25 * 3.24 = 1.56;
    /// m̂ = 1.4 / 0.75, v̂ = 1.56 / 0.4375; w = 0.9 - 0.1 * 1.866666… / 1.888310…
    #[test]
    fn the_second_step_by_hand() {
        let adam = Adam::new(0.1).with(|m| (m.beta1, m.beta2, m.epsilon) = (0.5, 0.75, 0.0));
        let w = run(adam, 2);
        let expected = 0.9 - 0.1 * (1.4 / 0.75) / (1.56_f64 / 0.4375).sqrt();
        assert!((w[0] - expected).abs() < 1e-14);
        // The second entry: g = -40, then 20 * -1.9 = -38.
        let (m, v) = (0.5 * -20.0 + 0.5 * -38.0, 0.75 * 400.0 + 0.25 * 1444.0);
        let expected = -1.9 - 0.1 * (m / 0.75) / (v / 0.4375_f64).sqrt();
        assert!((w[1] - expected).abs() < 1e-14);
        // Uniform: t = 1 moves by 0.1 * (2, -40) / 40; then both divide by the second's root.
        let uniform = AdamUniform::new(0.1);
        let w = run(uniform.with(|m| (m.beta1, m.beta2, m.epsilon) = (0.5, 0.75, 0.0)), 2);
        let expected = 0.995 - 0.1 * ((0.5 + 0.5 * 1.99) / 0.75) / (v / 0.4375_f64).sqrt();
        assert!((w[0] - expected).abs() < 1e-14);
    }

    /// `1 - β₂` of rounded numbers is off by 1e-5 of itself; of the first step it is all there is.
    #[test]
    fn complements_keep_their_digits() {
        let moment = |beta2: f64| {
            let mut adam = Adam::<f32>::new(0.1).with(|m| m.beta2 = beta2);
            adam.update("w", &mut [1.0], &[1.0]);
            adam.states["w"].moments[1][0]
        };
        assert_eq!([0.999, 0.9999].map(moment), [0.001, 0.0001]);
    }

    /// Coupled decay passes through the moments: the first step still has length lr.
    #[test]
    fn coupled_decay() {
        let adam = Adam::new(0.1).with(|m| (m.epsilon, m.weight_decay) = (0.0, 3.0));
        assert_close(run(adam, 1), [0.9, -1.9]);
    }

    /// `ε` is added after the root is corrected: w = 1 - 0.1 * 2 / (2 + 1).
    #[test]
    fn epsilon_stands_where_pytorch_has_it() {
        let w = run(Adam::new(0.1).with(|m| m.epsilon = 1.0), 1);
        assert!((w[0] - (1.0 - 0.1 * 2.0 / 3.0)).abs() < 1e-14);
    }

    #[test]
    fn long_tensors_take_the_same_steps_as_short_ones() {
        let n = crate::kernels::elementwise::PARALLEL_FROM + 5;
        let gradient: Vec<f32> = (0..n).map(|k| (k as f32 * 0.3).sin()).collect();
        let (mut long, mut short) = (vec![1.0_f32; n], vec![1.0_f32; 100]);
        let (mut a, mut b) = (Adam::new(0.1), Adam::new(0.1));
        for _ in 0..3 {
            a.update("w", &mut long, &gradient);
            b.update("w", &mut short, &gradient[..100]);
        }
        assert_eq!(long[..100], short);
    }
}
