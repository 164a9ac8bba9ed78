//! Which part of each batch is a process's.

use std::ops::Range;

/// A batch is cut into shards, and the shards are dealt to the processes in blocks, in the order of ranks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Share {
    /// Samples in a batch.
    pub(super) batch: usize,
    /// Shards that a batch is to be cut into. It may fall into fewer.
    pub(super) shards: usize,
    rank: usize,
    size: usize,
}

impl Share {
    /// That of the process `rank` of `size`, which are at most [`parts`](Self::parts).
    pub(super) fn new(batch: usize, shards: usize, [rank, size]: [usize; 2]) -> Self {
        Self { batch, shards, rank, size }
    }

    /// Samples in a shard; the last may have fewer.
    pub(super) fn samples_each(&self) -> usize {
        self.batch.div_ceil(self.shards)
    }

    /// The shards that a batch falls into.
    pub(super) fn parts(&self) -> usize {
        self.batch.div_ceil(self.samples_each())
    }

    /// The shards of a process.
    pub(super) fn shards_of(&self, rank: usize) -> Range<usize> {
        rank * self.parts() / self.size..(rank + 1) * self.parts() / self.size
    }

    /// The shards of this process.
    pub(super) fn own_shards(&self) -> Range<usize> {
        self.shards_of(self.rank)
    }

    /// The samples of this process, by their place in the batch.
    pub(super) fn own_samples(&self) -> Range<usize> {
        let Range { start, end } = self.own_shards();
        let each = self.samples_each();
        start * each..(end * each).min(self.batch)
    }

    /// Places of this process's samples among those of a step of `accumulate` batches.
    pub(super) fn own_places(self, accumulate: usize) -> impl Iterator<Item = usize> {
        (0..accumulate).flat_map(move |k| self.own_samples().map(move |i| k * self.batch + i))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// However many share it, each sample is somebody's, in order, and nobody has none.
    #[test]
    fn a_batch_is_dealt_whole() {
        for batch in 1..12 {
            for shards in 1..=batch {
                let parts = Share::new(batch, shards, [0, 1]).parts();
                for size in 1..=parts {
                    let shares = (0..size).map(|rank| Share::new(batch, shards, [rank, size]));
                    let samples: Vec<usize> = shares
                        .clone()
                        .inspect(|share| assert!(!share.own_samples().is_empty()))
                        .flat_map(|share| share.own_samples())
                        .collect();
                    assert_eq!(samples, (0..batch).collect::<Vec<_>>());
                    let dealt: Vec<usize> = shares.flat_map(|share| share.own_shards()).collect();
                    assert_eq!(dealt, (0..parts).collect::<Vec<_>>());
                }
            }
        }
        let places = Share::new(5, 2, [1, 2]).own_places(2).collect::<Vec<_>>();
        assert_eq!(places, [3, 4, 8, 9]);
    }
}
