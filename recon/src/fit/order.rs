//! Which views a step looks at.

use rand::{SeedableRng, seq::SliceRandom};
use rand_chacha::ChaCha8Rng;

use super::config::FitConfig;

/// The views of each step: all, or the next of a shuffled pass.
pub(super) struct Order {
    views: Vec<usize>,
    next: usize,
    per_step: usize,
    seed: u64,
    pass: u64,
}

impl Order {
    pub(super) fn new(count: usize, config: &FitConfig) -> Self {
        let per_step = config.views_per_step.map_or(count, |views| views.min(count));
        let mut order =
            Self { views: (0..count).collect(), next: 0, per_step, seed: config.seed, pass: 0 };
        order.shuffle();
        order
    }

    pub(super) fn is_whole(&self) -> bool {
        self.per_step == self.views.len()
    }

    fn shuffle(&mut self) {
        if !self.is_whole() {
            let mut random = ChaCha8Rng::seed_from_u64(self.seed);
            random.set_stream(self.pass);
            self.views.sort_unstable();
            self.views.shuffle(&mut random);
        }
    }

    pub(super) fn next(&mut self) -> &[usize] {
        if self.next + self.per_step > self.views.len() {
            self.next = 0;
            self.pass += 1;
            self.shuffle();
        }
        let from = self.next;
        self.next += self.per_step;
        &self.views[from..from + self.per_step]
    }
}
