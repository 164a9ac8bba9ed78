//! What joins the processes of one training.

use std::fmt::Debug;

/// The processes that share a training, as MPI has them: each has a rank, and all of them call the same functions in the
/// same order. [`Solo`] is a process alone; the crate `unsphere` has those that `mpirun` or `srun` started (`Mpi`, feature `mpi`).
///
/// A call returns when all have called; one whose peer is gone does not return: it ends the process, as MPI does.
///
/// ```
/// use train::{Communicator, Solo};
///
/// let alone = Solo;
/// assert_eq!((alone.rank(), alone.size()), (0, 1));
/// assert_eq!(alone.all_gather(b"mine"), [b"mine"]);
/// ```
pub trait Communicator: Debug + Sync {
    /// Which of the processes this is, from 0. The first one writes and speaks for all.
    fn rank(&self) -> usize;

    /// How many there are.
    fn size(&self) -> usize;

    /// The bytes of every process, in the order of ranks. Lengths may differ.
    fn all_gather(&self, bytes: &[u8]) -> Vec<Vec<u8>>;

    /// Gives every process numbers of its own: those in `sent`, one block behind the other in the order of ranks, and takes
    /// those that the others have for this one, in the same order.
    ///
    /// # Shapes
    /// `sent` and `received` have as many numbers as their counts together, and those one count a rank; what a process
    /// counts for another, that other one counts of it.
    fn all_to_all(
        &self,
        sent: &[f32],
        sent_counts: &[usize],
        received: &mut [f32],
        received_counts: &[usize],
    );
}

/// A process alone.
#[derive(Clone, Copy, Debug, Default)]
pub struct Solo;

impl Communicator for Solo {
    fn rank(&self) -> usize {
        0
    }

    fn size(&self) -> usize {
        1
    }

    fn all_gather(&self, bytes: &[u8]) -> Vec<Vec<u8>> {
        vec![bytes.to_vec()]
    }

    fn all_to_all(&self, sent: &[f32], _: &[usize], received: &mut [f32], _: &[usize]) {
        received.copy_from_slice(sent);
    }
}

/// What failed first, by rank, if anything did anywhere: so that all end together, where one alone would leave the others
/// waiting for it. Each says what failed here; all must call it.
///
/// ```
/// use train::{Solo, first_failure};
///
/// assert_eq!(first_failure(&Solo, None), None);
/// assert_eq!(first_failure(&Solo, Some("no such file")), Some((0, "no such file".to_owned())));
/// ```
pub fn first_failure(
    communicator: &dyn Communicator,
    failed: Option<&str>,
) -> Option<(usize, String)> {
    // A first byte, since what failed may have nothing to say.
    let own = failed.map_or(Vec::new(), |text| format!("!{text}").into_bytes());
    let all = communicator.all_gather(&own);
    let first = all.iter().position(|said| !said.is_empty())?;
    Some((first, String::from_utf8_lossy(&all[first][1..]).into_owned()))
}
