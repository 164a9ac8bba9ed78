//! Randomness as a function of seed and place, never carried along.

use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::step_info::StepInfo;

/// What a generator is for: two purposes never share a stream.
#[derive(Clone, Copy)]
enum Purpose {
    Order = 1,
    Sample = 2,
    Tape = 3,
    Loss = 4,
}

/// Which sample is wanted: everything random about it follows from this.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Draw {
    /// Seed of the run.
    pub seed: u64,
    /// Epoch, counted from 0.
    pub epoch: u64,
    /// Place in the epoch, counted from 0.
    pub index: u64,
    /// What stands there in the epoch's order: below [`System::epoch_len`](super::System::epoch_len). Each
    /// number is drawn at most once an epoch, and those beyond the last whole step are left out; an epoch shorter than a
    /// step goes through all of them again until the step is full.
    pub item: usize,
}

impl Draw {
    /// The seed of what a loss draws at a step, for its `part`-th purpose.
    pub fn for_loss(seed: u64, at: StepInfo, part: u64) -> u64 {
        generator(seed, Purpose::Loss, at.step, part).random()
    }

    /// A generator of this sample's own.
    pub fn rng(&self) -> ChaCha8Rng {
        generator(self.seed, Purpose::Sample, self.epoch, self.index)
    }
}

/// The order in which an epoch takes its items: a permutation of `0..len`.
pub(super) fn order(seed: u64, epoch: u64, len: usize) -> Vec<usize> {
    let mut items: Vec<usize> = (0..len).collect();
    items.shuffle(&mut generator(seed, Purpose::Order, epoch, 0));
    items
}

/// The seed of a tape: of the `part`-th one of a step.
pub(super) fn tape_seed(seed: u64, step: u64, part: u64) -> u64 {
    generator(seed, Purpose::Tape, step, part).random()
}

fn generator(seed: u64, purpose: Purpose, place: u64, stream: u64) -> ChaCha8Rng {
    let mut key = [0; 32];
    for (bytes, value) in key.chunks_exact_mut(8).zip([seed, purpose as u64, place, 0]) {
        bytes.copy_from_slice(&value.to_le_bytes());
    }
    let mut rng = ChaCha8Rng::from_seed(key);
    rng.set_stream(stream);
    rng
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_order_has_each_item_once_and_is_of_its_epoch() {
        let mut first = order(3, 0, 100);
        assert_eq!(first, order(3, 0, 100));
        assert_ne!(first, order(3, 1, 100));
        assert_ne!(first, order(4, 0, 100));
        first.sort_unstable();
        assert_eq!(first, (0..100).collect::<Vec<_>>());
    }

    #[test]
    fn every_place_has_numbers_of_its_own() {
        let draw = Draw { seed: 1, epoch: 2, index: 3, item: 0 };
        let number = |draw: Draw| draw.rng().random::<u64>();
        assert_eq!(number(draw), number(Draw { item: 5, ..draw }));
        assert_ne!(number(draw), number(Draw { index: 4, ..draw }));
        assert_ne!(number(draw), number(Draw { epoch: 3, ..draw }));
        assert_ne!(tape_seed(1, 2, 3), number(draw));
        let at = |step| StepInfo { step, epoch: 0 };
        let loss = Draw::for_loss(1, at(2), 3);
        assert_eq!(loss, Draw::for_loss(1, StepInfo { epoch: 5, ..at(2) }, 3));
        // Seeds that agree in their last sixteen bits, neighbours in step and part, other purposes.
        let others = [
            Draw::for_loss(65_537, at(2), 3),
            Draw::for_loss(1, at(3), 3),
            Draw::for_loss(1, at(2), 4),
            tape_seed(1, 2, 3),
        ];
        assert!(!others.contains(&loss));
    }
}
