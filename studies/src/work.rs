//! One job as a study is handed it, and the training in it.

use std::path::Path;

use train::progress::{Event, Watch};
use train::{Compile, Configuration, Job, Provenance, RunError, RunFolder, System, train};

use super::error::StudyError;
use super::scale::Scale;

/// A job of one seed.
#[derive(Clone, Debug)]
pub struct Work<'a> {
    /// Which of the plan's [`jobs`](super::Plan::jobs).
    pub id: String,
    /// Seed of everything in it.
    pub seed: u64,
    /// How much is done.
    pub scale: Scale,
    /// A folder of its own, which stays: what was interrupted finds here what it had. It exists
    /// only once something is written.
    pub folder: &'a Path,
    /// Data that the user has, instead of what the study makes.
    pub data: Option<&'a Path>,
    /// What runs say about their making.
    pub provenance: &'a Provenance,
}

/// Parts of a job that are told apart.
const PARTS: f64 = 1000.0;

/// A model that a job trained.
#[derive(Debug)]
pub struct Trained<S> {
    /// The model after the last step. `Checkpoint::read(&run.best())` has the best.
    pub system: S,
    /// The folder of the training.
    pub run: RunFolder,
    /// Steps taken.
    pub steps: u64,
    /// Seconds of computing in the steps, of all parts of the training.
    pub seconds: f64,
}

impl Work<'_> {
    /// Says how far the job is, from 0 to 1, as an [`Event::Progress`] in thousandths.
    ///
    /// # Errors
    /// [`StudyError::Cancelled`] if it is to end.
    pub fn tell(
        &self,
        watch: &mut Watch<'_>,
        done: f64,
        text: impl Into<String>,
    ) -> Result<(), StudyError> {
        let done = (done.clamp(0.0, 1.0) * PARTS) as u64;
        watch.tell(&Event::Progress { done, total: PARTS as u64, text: text.into() });
        if watch.is_cancelled() { Err(StudyError::Cancelled) } else { Ok(()) }
    }

    /// A system as it is before its first step: what a floor must tell from a trained one.
    ///
    /// # Errors
    /// If files that it begins with cannot be read.
    pub fn untrained<S: System>(
        &self,
        config: &Configuration<S::Config>,
        data: &S::Data,
    ) -> Result<S, StudyError> {
        let mut system = S::new(&config.system, self.seed);
        system.init_from_data(data, None)?;
        Ok(system)
    }

    /// Trains a system in the job's folder, or goes on with the training that is there; one that
    /// is finished is only loaded. The seed of the configuration becomes that of the job.
    ///
    /// The bits of the result do not depend on interruptions.
    ///
    /// # Errors
    /// As [`train`](fn@train::train); [`StudyError::Cancelled`] if it is to end, after a checkpoint. A training that is there
    /// and cannot go on is an error too: it is never replaced.
    pub fn train<S: Compile>(
        &self,
        config: &Configuration<S::Config>,
        data: &S::Data,
        watch: &mut Watch<'_>,
    ) -> Result<Trained<S>, StudyError> {
        let mut config = config.clone();
        config.train.seed = self.seed;
        let (run, resume) = match RunFolder::resume(self.folder) {
            Ok(run) => (run, true),
            // What stopped before its first checkpoint is nothing.
            Err(RunError::NoRun { .. }) => (RunFolder::create(self.folder, true)?, false),
            Err(error) => return Err(error.into()),
        };
        let provenance = self.provenance;
        let job = Job { config: &config, data, run: &run, provenance, resume, from: None };
        let outcome = train(&job, watch)?;
        if outcome.ended.is_cancelled() {
            return Err(StudyError::Cancelled);
        }
        let seconds = run.seconds()?;
        Ok(Trained { system: outcome.system, run, steps: outcome.steps, seconds })
    }
}
