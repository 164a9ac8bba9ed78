//! What the processes of a training have to agree on.

use std::time::Instant;

use autodiff_lite::{Module, Param};
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::communicator::{Communicator, first_failure};
use super::error::TrainError;
use super::fingerprint::Fingerprint;
use super::progress::Communication;

/// The processes of a training, as one of them sees them, and what it has said to the others.
#[derive(Debug)]
pub(super) struct Ranks<'c> {
    communicator: &'c dyn Communicator,
    said: Communication,
}

impl<'c> Ranks<'c> {
    pub(super) fn new(communicator: &'c dyn Communicator) -> Self {
        Self { communicator, said: Communication::default() }
    }

    /// The rank of this process and their number.
    pub(super) fn place(&self) -> [usize; 2] {
        [self.communicator.rank(), self.communicator.size()]
    }

    pub(super) fn is_alone(&self) -> bool {
        self.communicator.size() == 1
    }

    /// Whether this process writes and scores.
    pub(super) fn is_first(&self) -> bool {
        self.communicator.rank() == 0
    }

    /// What every process says, in the order of ranks. Who is early waits.
    pub(super) fn gather<T: Clone + Serialize + DeserializeOwned>(&mut self, own: &T) -> Vec<T> {
        if self.is_alone() {
            return vec![own.clone()];
        }
        let begun = Instant::now();
        let bytes = serde_json::to_vec(own).expect("plain values serialise");
        let all = self.communicator.all_gather(&bytes);
        self.said.bytes += self.to_others(bytes.len());
        self.said.waiting += begun.elapsed().as_secs_f64();
        let read = |bytes: Vec<u8>| {
            serde_json::from_slice(&bytes).expect("the other processes run the same program")
        };
        all.into_iter().map(read).collect()
    }

    /// What the first process says.
    pub(super) fn first<T: Clone + Serialize + DeserializeOwned>(&mut self, own: &T) -> T {
        self.gather(own).swap_remove(0)
    }

    /// A result, if all have one; else each has what failed here, or elsewhere.
    pub(super) fn together<T>(&mut self, result: Result<T, TrainError>) -> Result<T, TrainError> {
        if self.is_alone() {
            return result;
        }
        let text = result.as_ref().err().map(ToString::to_string);
        let begun = Instant::now();
        let first = first_failure(self.communicator, text.as_deref());
        self.said.waiting += begun.elapsed().as_secs_f64();
        match (result, first) {
            (Ok(_), Some((rank, message))) => Err(TrainError::Elsewhere { rank, message }),
            (result, _) => result,
        }
    }

    /// Refuses to go on with others that have not the same.
    pub(super) fn same(&mut self, what: &'static str, own: u64) -> Result<(), TrainError> {
        let all = self.gather(&own);
        match all.iter().position(|other| *other != all[0]) {
            Some(rank) => Err(TrainError::Apart { what, rank }),
            None => Ok(()),
        }
    }

    /// [`Communicator::all_to_all`].
    pub(super) fn exchange(
        &mut self,
        (sent, sent_counts): (&[f32], &[usize]),
        (received, received_counts): (&mut [f32], &[usize]),
    ) {
        let begun = Instant::now();
        self.communicator.all_to_all(sent, sent_counts, received, received_counts);
        let kept = sent_counts[self.communicator.rank()];
        self.said.bytes += (size_of_val(sent) - size_of::<f32>() * kept) as u64;
        self.said.seconds += begun.elapsed().as_secs_f64();
    }

    /// What was said since it was last asked; none of a process alone.
    pub(super) fn take_said(&mut self) -> Option<Communication> {
        let said = std::mem::take(&mut self.said);
        (!self.is_alone()).then_some(said)
    }

    fn to_others(&self, bytes: usize) -> u64 {
        (bytes * (self.communicator.size() - 1)) as u64
    }
}

/// A number that another value of any parameter changes.
pub(super) fn fingerprint(module: &impl Module<f32>) -> u64 {
    let (mut hash, mut bytes) = (Fingerprint::new(), Vec::new());
    module.visit("", &mut |_: &str, param: &Param| {
        bytes.clear();
        bytes.extend(param.as_slice().iter().flat_map(|x| x.to_le_bytes()));
        hash = hash.with(&bytes);
    });
    hash.value()
}
