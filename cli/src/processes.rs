//! The processes that run one command together.

#[cfg(feature = "mpi")]
mod mpi;

use train::{Communicator, Solo};

use crate::args::Command;
use crate::failure::Failure;

#[cfg(feature = "mpi")]
pub use self::mpi::{Mpi, MpiError};

/// How launchers tell a process how many they started: Open MPI's, those that speak PMI (MPICH), and Slurm's. By Slurm's alone
/// a program without MPI cannot know that they are to share anything.
const STARTED: &[&str] = &[
    "OMPI_COMM_WORLD_SIZE",
    "PMI_SIZE",
    #[cfg(feature = "mpi")]
    "SLURM_STEP_NUM_TASKS",
];

/// Those that `mpirun` or `srun` started together for a training, where the program was built with feature `mpi`; else this
/// process alone. The first one speaks for all.
///
/// It lasts until the last word is said: when it goes, it waits for the others.
#[derive(Debug, Default)]
pub(crate) struct Processes {
    #[cfg(feature = "mpi")]
    joined: Option<Mpi>,
}

impl Processes {
    /// Joins those that were started together for a command, if it is one that they can share.
    pub(crate) fn join(command: &Command) -> Result<Self, Failure> {
        let started = started(|name| std::env::var(name).ok());
        if !matches!(command, Command::Train(_)) || started < 2 {
            return Ok(Self::default());
        }
        Self::joined(started)
    }

    #[cfg(feature = "mpi")]
    fn joined(started: usize) -> Result<Self, Failure> {
        let joined = Mpi::begin().map_err(Failure::other)?;
        let found = joined.size();
        if found != started {
            return Err(Failure::Usage(format!(
                "{started} processes were started for one training, but MPI knows of {found}: start them with the `mpirun` of the \
                 library that the program was built with, or in Slurm with `srun --mpi=pmix` (docs/clusters.md)"
            )));
        }
        Ok(Self { joined: Some(joined) })
    }

    #[cfg(not(feature = "mpi"))]
    fn joined(started: usize) -> Result<Self, Failure> {
        Err(Failure::Usage(format!(
            "{started} processes were started for one training, but this program was built without MPI: build it with \
             `--features mpi` (docs/clusters.md), or start one"
        )))
    }

    #[cfg_attr(
        not(feature = "mpi"),
        expect(clippy::unused_self, reason = "without MPI all are alone")
    )]
    pub(crate) fn communicator(&self) -> &dyn Communicator {
        #[cfg(feature = "mpi")]
        if let Some(joined) = &self.joined {
            return joined;
        }
        &Solo
    }

    /// Whether this one speaks.
    pub(crate) fn is_first(&self) -> bool {
        self.communicator().rank() == 0
    }
}

/// How many were started together; `variable` reads the environment.
fn started(variable: impl Fn(&str) -> Option<String>) -> usize {
    let numbers = STARTED.iter().filter_map(|name| variable(name)?.parse().ok());
    numbers.max().unwrap_or(1)
}

/// What all have, or what failed first, here or elsewhere: one that left by itself would leave the others waiting.
pub(crate) fn together<T>(
    communicator: &dyn Communicator,
    result: Result<T, Failure>,
) -> Result<T, Failure> {
    let failed = result.as_ref().err().map(Failure::text);
    match (train::first_failure(communicator, failed), result) {
        (Some((rank, text)), Ok(_)) => Err(Failure::Other(format!("process {rank}: {text}"))),
        (_, result) => result,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn launchers_say_how_many_they_started() {
        let of = |name: &'static str, value: &'static str| {
            started(move |asked| (asked == name).then(|| value.to_owned()))
        };
        assert_eq!(of("PATH", "/bin"), 1);
        assert_eq!(of("OMPI_COMM_WORLD_SIZE", "4"), 4);
        assert_eq!(of("PMI_SIZE", "2"), 2);
        assert_eq!(of("PMI_SIZE", "many"), 1);
    }
}
