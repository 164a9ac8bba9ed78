//! Processes that MPI joins.

use std::fmt;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use mpi::Threading;
use mpi::datatype::{Partition, PartitionMut};
use mpi::environment::Universe;
use mpi::request::scope;
use mpi::traits::{Communicator as _, CommunicatorCollectives};

use train::Communicator;

/// How long a process that waits for others asks without a pause.
const EAGER: Duration = Duration::from_micros(200);
/// The pause between two questions afterwards: MPI's own waiting keeps a core busy that the others may need.
const PAUSE: Duration = Duration::from_micros(100);

/// The processes that `mpirun` or `srun` started: MPI's `COMM_WORLD`.
///
/// Dropped, it waits for the others to come to their ends too. A panic ends all of them (`MPI_Abort`): they would wait
/// forever for one that is gone.
pub struct Mpi {
    /// MPI is called by one thread at a time.
    universe: Mutex<Universe>,
    rank: usize,
    size: usize,
}

/// Why there is no [`Mpi`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MpiError {
    /// It may be begun once in the life of a process.
    #[error("MPI was begun already in this process")]
    Begun,
    /// The library takes calls of the thread that began it alone.
    #[error(
        "this MPI library takes no calls from threads (MPI_THREAD_SERIALIZED): build it with threads"
    )]
    Threads,
}

impl Mpi {
    /// Begins MPI, once in the life of a process. A process that was started by itself is alone.
    ///
    /// # Errors
    /// If it was begun before, or the library cannot be called from any thread.
    pub fn begin() -> Result<Self, MpiError> {
        let (universe, provided) =
            mpi::initialize_with_threading(Threading::Serialized).ok_or(MpiError::Begun)?;
        if provided < Threading::Serialized {
            return Err(MpiError::Threads);
        }
        let world = universe.world();
        let (rank, size) = (world.rank() as usize, world.size() as usize);
        drop(world);
        Ok(Self { universe: Mutex::new(universe), rank, size })
    }

    fn universe(&self) -> MutexGuard<'_, Universe> {
        self.universe.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl fmt::Debug for Mpi {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { rank, size, .. } = self;
        f.debug_struct("Mpi").field("rank", rank).field("size", size).finish_non_exhaustive()
    }
}

impl Drop for Mpi {
    fn drop(&mut self) {
        if thread::panicking() && self.size > 1 {
            self.universe().world().abort(1);
        }
    }
}

impl Communicator for Mpi {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        self.size
    }

    fn all_gather(&self, bytes: &[u8]) -> Vec<Vec<u8>> {
        let universe = self.universe();
        let world = universe.world();
        let mut lengths = vec![0_u64; self.size];
        let length = bytes.len() as u64;
        scope(|scope| {
            let mut request = world.immediate_all_gather_into(scope, &length, &mut lengths[..]);
            let begun = Instant::now();
            while let Err(unfinished) = request.test() {
                request = unfinished;
                if begun.elapsed() > EAGER {
                    thread::sleep(PAUSE);
                }
            }
        });
        // From here on all are there.
        let lengths: Vec<usize> = lengths.into_iter().map(|length| length as usize).collect();
        if lengths.iter().all(|&length| length == 0) {
            return vec![Vec::new(); self.size];
        }
        // An empty slice may stand at the address 1, which in Open MPI is the name of something else (MPI_IN_PLACE).
        let bytes = if bytes.is_empty() { &[0][..0] } else { bytes };
        let (counts, places) = (counts(&lengths), places(&lengths));
        let mut all = vec![0; lengths.iter().sum()];
        let mut received = PartitionMut::new(&mut all[..], &counts[..], &places[..]);
        world.all_gather_varcount_into(bytes, &mut received);
        let mut rest = &all[..];
        let parts = lengths.into_iter().map(|length| {
            let part;
            (part, rest) = rest.split_at(length);
            part.to_vec()
        });
        parts.collect()
    }

    fn all_to_all(
        &self,
        sent: &[f32],
        sent_counts: &[usize],
        received: &mut [f32],
        received_counts: &[usize],
    ) {
        let universe = self.universe();
        let (counts_out, places_out) = (counts(sent_counts), places(sent_counts));
        let (counts_in, places_in) = (counts(received_counts), places(received_counts));
        let sent = Partition::new(sent, &counts_out[..], &places_out[..]);
        let mut received = PartitionMut::new(received, &counts_in[..], &places_in[..]);
        universe.world().all_to_all_varcount_into(&sent, &mut received);
    }
}

/// MPI counts in C's `int`.
fn counts(lengths: &[usize]) -> Vec<i32> {
    let count = |&length| i32::try_from(length).expect("a message of less than 2^31 elements");
    lengths.iter().map(count).collect()
}

/// Where each block begins.
fn places(lengths: &[usize]) -> Vec<i32> {
    let mut end = 0;
    let begin = |&length: &usize| {
        end += length;
        end - length
    };
    counts(&lengths.iter().map(begin).collect::<Vec<_>>())
}
