//! Gradients that are summed over processes, with the bits of one process.
//!
//! Sums of floating point depend on their order, so what each process computed must not be added up where it was: the sum is
//! taken shard by shard, as one process takes it. Every process does that for one slice of all parameters. It is given that
//! slice of each shard's gradient, adds them in the order of the shards, and gives the sum to all.
//!
//! For gradients of `G` bytes, `P` processes and `k` shards on each, a process sends `(k + 1) G (P - 1) / P` bytes a batch: with
//! one shard each twice the gradient at most, whatever `P` is, which is what a ring that adds in any order sends. To give
//! everybody everything would send `k G (P - 1)`; to pass a running sum along sends as little as this, and leaves all but one
//! waiting.

use std::ops::Range;

use autodiff_lite::{Gradients, Module, Param, Tape};

use super::ranks::Ranks;
use super::share::Share;

/// Numbers that are exchanged at once, over all slices: what is sent and received stays in the caches. The tests' systems are
/// small, and have several pieces too.
const PIECE: usize = if cfg!(test) { 250 } else { 1 << 20 };

/// The running sum of a step, and memory that serves all steps.
#[derive(Debug, Default)]
pub(super) struct Reduction {
    /// Where each trainable parameter ends, all laid one behind the other.
    ends: Vec<usize>,
    /// Which of them some shard had a gradient for.
    present: Vec<bool>,
    /// The sum of this process's slice; in the end all of them.
    sums: Vec<f32>,
    /// The gradients of this process's shards, one behind the other.
    own: Vec<f32>,
    sent: Vec<f32>,
    received: Vec<f32>,
}

impl Reduction {
    /// Begins the sum of a step.
    pub(super) fn begin(&mut self, module: &impl Module<f32>) {
        self.ends.clear();
        let (ends, mut end) = (&mut self.ends, 0);
        module.visit("", &mut |_: &str, param: &Param| {
            if param.trainable {
                end += param.len();
                ends.push(end);
            }
        });
        self.present.clear();
        self.present.resize(self.ends.len(), false);
        self.own.clear();
        self.sums.resize(end, 0.0);
    }

    /// Lays down the gradient of a shard of this process, the next in order, and says which parameters have none.
    pub(super) fn lay(&mut self, module: &impl Module<f32>, gradients: &Gradients) -> Vec<usize> {
        let (mut absent, mut index) = (Vec::new(), 0);
        module.visit("", &mut |_: &str, param: &Param| {
            if !param.trainable {
                return;
            }
            if let Some(gradient) = gradients.slice_of(param) {
                self.own.extend_from_slice(gradient);
            } else {
                absent.push(index);
                self.own.resize(self.own.len() + param.len(), 0.0);
            }
            index += 1;
        });
        absent
    }

    /// Adds the shards of a batch, `absent` of each of them all, in their order.
    pub(super) fn add(&mut self, share: &Share, absent: &[Vec<usize>], ranks: &mut Ranks<'_>) {
        let [rank, size] = ranks.place();
        let begins = self.begins(absent);
        for piece in 0..self.pieces() {
            self.sent.clear();
            let mut counts = [Vec::with_capacity(size), Vec::with_capacity(size)];
            for other in 0..size {
                let slice = self.slice(piece, other, size);
                for shard in self.own.chunks_exact(self.len().max(1)) {
                    self.sent.extend_from_slice(&shard[slice.clone()]);
                }
                counts[0].push(share.own_shards().len() * slice.len());
                counts[1].push(share.shards_of(other).len() * self.slice(piece, rank, size).len());
            }
            self.exchange(&counts, ranks);
            let slice = self.slice(piece, rank, size);
            for (shard, absent) in absent.iter().enumerate() {
                let first = shard * slice.len();
                let begins = |parameter: usize| begins[parameter] == Some(shard);
                self.add_shard(&slice, first, absent, begins);
            }
        }
        self.own.clear();
    }

    /// The shard that each parameter's sum begins with, if it begins in this batch.
    fn begins(&mut self, absent: &[Vec<usize>]) -> Vec<Option<usize>> {
        let mut begins = vec![None; self.present.len()];
        for (parameter, begin) in begins.iter_mut().enumerate() {
            if !self.present[parameter] {
                *begin = absent.iter().position(|absent| !absent.contains(&parameter));
                self.present[parameter] = begin.is_some();
            }
        }
        begins
    }

    /// Adds what was received of one shard, from `first` on, to a slice of the sum.
    fn add_shard(
        &mut self,
        slice: &Range<usize>,
        first: usize,
        absent: &[usize],
        begins: impl Fn(usize) -> bool,
    ) {
        // The first parameter that reaches into the slice.
        let mut parameter = self.ends.partition_point(|&end| end <= slice.start);
        let mut start = slice.start;
        while start < slice.end {
            let end = self.ends[parameter].min(slice.end);
            let from = first + start - slice.start;
            let numbers = &self.received[from..from + end - start];
            let sums = &mut self.sums[start..end];
            if begins(parameter) {
                sums.copy_from_slice(numbers);
            } else if !absent.contains(&parameter) {
                sums.iter_mut().zip(numbers).for_each(|(sum, number)| *sum += number);
            }
            start = end;
            parameter += 1;
        }
    }

    /// The sum, the same everywhere.
    pub(super) fn end(
        &mut self,
        module: &impl Module<f32>,
        tape: &Tape,
        ranks: &mut Ranks<'_>,
    ) -> Gradients {
        let [rank, size] = ranks.place();
        for piece in 0..self.pieces() {
            let own = self.slice(piece, rank, size);
            self.sent.clear();
            for _ in 0..size {
                self.sent.extend_from_slice(&self.sums[own.clone()]);
            }
            let slices: Vec<_> = (0..size).map(|other| self.slice(piece, other, size)).collect();
            let counts = [vec![own.len(); size], slices.iter().map(Range::len).collect()];
            self.exchange(&counts, ranks);
            let mut received = &self.received[..];
            for slice in slices {
                let numbers;
                (numbers, received) = received.split_at(slice.len());
                self.sums[slice].copy_from_slice(numbers);
            }
        }
        let (mut gradients, mut index, mut start) = (tape.gradients(), 0, 0);
        module.visit("", &mut |_: &str, param: &Param| {
            if param.trainable {
                if self.present[index] {
                    gradients.insert(param, &self.sums[start..self.ends[index]]);
                }
                start = self.ends[index];
                index += 1;
            }
        });
        gradients
    }

    fn exchange(&mut self, [sent, received]: &[Vec<usize>; 2], ranks: &mut Ranks<'_>) {
        self.received.resize(received.iter().sum(), 0.0);
        ranks.exchange((&self.sent, sent), (&mut self.received, received));
    }

    /// Numbers in all parameters.
    fn len(&self) -> usize {
        self.sums.len()
    }

    fn pieces(&self) -> usize {
        self.len().div_ceil(PIECE)
    }

    /// What a process sums of a piece.
    fn slice(&self, piece: usize, rank: usize, size: usize) -> Range<usize> {
        let start = piece * PIECE;
        let len = PIECE.min(self.len() - start);
        start + len * rank / size..start + len * (rank + 1) / size
    }
}
