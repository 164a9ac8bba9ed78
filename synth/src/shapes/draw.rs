//! What a family draws its parameters from.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Random choices, a function of the seed alone.
#[derive(Debug)]
pub(super) struct Draw(ChaCha8Rng);

impl Draw {
    /// The draws of one object; `stream` keeps families with the same seed apart.
    pub(super) fn new(seed: u64, stream: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(stream);
        Self(rng)
    }

    /// Uniform between two bounds.
    pub(super) fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.random::<f64>()
    }

    /// True with this probability.
    pub(super) fn chance(&mut self, probability: f64) -> bool {
        self.0.random::<f64>() < probability
    }

    /// A whole number between two bounds, both possible.
    pub(super) fn count(&mut self, low: usize, high: usize) -> usize {
        low + self.0.random_range(0..=high - low)
    }

    /// One of several choices, all alike probable.
    pub(super) fn pick<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.0.random_range(0..choices.len())]
    }

    /// A colour of any hue, with saturation and value between bounds.
    pub(super) fn color(&mut self, saturation: [f64; 2], value: [f64; 2]) -> [f32; 3] {
        let hue = self.within(0.0, 1.0);
        hsv(hue, self.within(saturation[0], saturation[1]), self.within(value[0], value[1]))
    }
}

/// An sRGB colour of the given hue in turns, saturation and value, each in `[0, 1]`.
pub(super) fn hsv(hue: f64, saturation: f64, value: f64) -> [f32; 3] {
    [0.0, 2.0 / 3.0, 1.0 / 3.0].map(|shift| {
        let t = (hue + shift).rem_euclid(1.0) * 6.0;
        let ramp = ((t - 3.0).abs() - 1.0).clamp(0.0, 1.0);
        (value * (1.0 - saturation * (1.0 - ramp))) as f32
    })
}
