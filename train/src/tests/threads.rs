//! A communicator whose processes are threads.

use std::sync::Mutex;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use crate::Communicator;

/// How long one waits for another before the test has failed.
const PATIENCE: Duration = Duration::from_secs(60);

/// One of the threads: whom it sends to, and whom it hears from, by rank.
#[derive(Debug)]
pub(super) struct Peer {
    rank: usize,
    to: Vec<Sender<Vec<u8>>>,
    from: Vec<Mutex<Receiver<Vec<u8>>>>,
}

impl Peer {
    /// Threads that know each other, in the order of ranks.
    pub(super) fn all(size: usize) -> Vec<Self> {
        let mut peers: Vec<Self> =
            (0..size).map(|rank| Self { rank, to: Vec::new(), from: Vec::new() }).collect();
        for sender in 0..size {
            for receiver in 0..size {
                let (to, from) = channel();
                peers[sender].to.push(to);
                peers[receiver].from.push(Mutex::new(from));
            }
        }
        peers
    }

    fn hear(&self, rank: usize) -> Vec<u8> {
        let from = self.from[rank].lock().unwrap();
        from.recv_timeout(PATIENCE).expect("the others are there")
    }
}

impl Communicator for Peer {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        self.to.len()
    }

    fn all_gather(&self, bytes: &[u8]) -> Vec<Vec<u8>> {
        self.to.iter().for_each(|to| to.send(bytes.to_vec()).unwrap());
        (0..self.size()).map(|rank| self.hear(rank)).collect()
    }

    fn all_to_all(
        &self,
        mut sent: &[f32],
        sent_counts: &[usize],
        mut received: &mut [f32],
        received_counts: &[usize],
    ) {
        for (to, &count) in self.to.iter().zip(sent_counts) {
            let block;
            (block, sent) = sent.split_at(count);
            to.send(block.iter().flat_map(|x| x.to_le_bytes()).collect()).unwrap();
        }
        assert!(sent.is_empty());
        for (rank, &count) in received_counts.iter().enumerate() {
            let block;
            (block, received) = received.split_at_mut(count);
            let bytes = self.hear(rank);
            let (numbers, _) = bytes.as_chunks::<4>();
            assert_eq!(numbers.len(), count);
            block.iter_mut().zip(numbers).for_each(|(x, bytes)| *x = f32::from_le_bytes(*bytes));
        }
        assert!(received.is_empty());
    }
}
