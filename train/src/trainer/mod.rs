//! The trainer: a training, from its first step to its last.

use std::path::Path;
use std::time::Instant;

use autodiff_lite::optim::{Schedule, clip_grad_norm};
use rayon::prelude::*;

use crate::average::Average;
use crate::checkpoint::{TrainState, save};
use crate::communicator::Communicator;
use crate::config::Configuration;
use crate::draw::{Draw, order};
use crate::error::TrainError;
use crate::optimizer::{AnyOptimizer, OptimizerState};
use crate::progress::{Ended, Event, Step, TrainingStep, Watch};
use crate::ranks::{Ranks, fingerprint};
use crate::record::Record;
use crate::run::{Provenance, RunFolder};
use crate::share::Share;
use crate::step::{StepGradient, Tapes};
use crate::step_info::StepInfo;
use crate::system::{Metric, System};

mod prepare;
mod score;

/// Weight of the past in the moving average of losses (Mesh R-CNN's 0.9).
const MEMORY: f64 = 0.9;
/// Steps in a row that are left out as spikes at most: as many as the average remembers.
const SPIKES: u64 = 10;
/// Steps between two comparisons of the processes' parameters.
const COMPARED_EVERY: u64 = 100;

/// A training to be done.
#[derive(Debug)]
pub struct Job<'a, S: System> {
    /// All options.
    pub config: &'a Configuration<S::Config>,
    /// What samples are drawn from.
    pub data: &'a S::Data,
    /// Where everything is kept.
    pub run: &'a RunFolder,
    /// What the run's folder says about its making.
    pub provenance: &'a Provenance,
    /// Whether the folder's run goes on, instead of beginning anew.
    pub resume: bool,
    /// A checkpoint of the same system whose weights a new run begins with, those of the averages where it has any. What is not
    /// there begins at random, and is told by an [`Event::Inherited`].
    pub from: Option<&'a Path>,
}

/// What a training came to.
#[derive(Debug)]
pub struct Outcome<S> {
    /// The system as it is now, with averaged weights where there are any.
    pub system: S,
    /// Steps taken, in all parts of the run together.
    pub steps: u64,
    /// Whether it came to its end.
    pub ended: Ended,
    /// The last scores of validation, of this part of the run.
    pub metrics: Vec<Metric>,
    /// The best value of the chosen metric and the step that had it.
    pub best: Option<(f64, u64)>,
}

/// The whole training; see [`train_among`](crate::train_among).
pub(crate) fn run<S: System>(
    job: &Job<'_, S>,
    communicator: &dyn Communicator,
    watch: &mut Watch<'_>,
) -> Result<Outcome<S>, TrainError> {
    let begun = Instant::now();
    let mut trainer = Trainer::prepare(job, Ranks::new(communicator), watch)?;
    let ended = trainer.run()?;
    trainer.end()?;
    let (done, seconds) = (trainer.state.step, begun.elapsed().as_secs_f64());
    trainer.tell(&Event::Finished { ended, done, seconds });
    // What predicts.
    trainer.exchange();
    Ok(Outcome {
        system: trainer.system,
        steps: trainer.state.step,
        ended,
        metrics: trainer.metrics,
        best: trainer.state.best,
    })
}

/// The samples of a step, drawn beside the step before it: they follow from their place alone, so
/// that it makes no difference when. An error waits for its step.
struct Ahead<T> {
    step: u64,
    samples: Result<Vec<T>, TrainError>,
}

struct Trainer<'j, 'w, 'o, S: System> {
    job: &'j Job<'j, S>,
    watch: &'w mut Watch<'o>,
    ranks: Ranks<'j>,
    share: Share,
    system: S,
    optimizer: AnyOptimizer,
    average: Option<Average>,
    tapes: Tapes,
    /// The files, of the first process.
    record: Option<Record<'j>>,
    state: TrainState,
    schedule: Schedule,
    /// The order of the items in the present epoch.
    items: Vec<usize>,
    /// What was drawn for the next step.
    ahead: Option<Ahead<S::Sample>>,
    steps_per_epoch: u64,
    total: u64,
    metrics: Vec<Metric>,
    /// Whether to end here, and whether a checkpoint is due: as all processes agreed.
    stop: bool,
    due: bool,
    saved: (u64, Instant),
}

impl<S: System> Trainer<'_, '_, '_, S> {
    fn tell(&mut self, event: &Event) {
        self.watch.tell(event);
    }

    /// Passes on what a user should know.
    fn warn(&mut self) {
        for text in self.record.as_mut().map(Record::warnings).unwrap_or_default() {
            self.tell(&Event::Warned { text });
        }
    }

    /// Decides with the others what follows: who is cancelled ends all, and the first process has the clock.
    fn agree(&mut self) {
        let wishes = self.ranks.gather(&(self.watch.is_cancelled(), self.is_due()));
        self.stop |= wishes.iter().any(|&(cancelled, _)| cancelled);
        self.due = wishes[0].1;
    }

    /// Makes sure that all processes have the same parameters.
    fn compare(&mut self) -> Result<(), TrainError> {
        if self.ranks.is_alone() {
            return Ok(());
        }
        self.ranks.same("parameters", fingerprint(&self.system))
    }

    fn run(&mut self) -> Result<Ended, TrainError> {
        self.agree();
        loop {
            if self.state.pending && !self.stop {
                let evaluated = self.score_epoch()?;
                self.state.pending = false;
                self.agree();
                if evaluated || self.due {
                    self.save()?;
                }
            }
            let whole = self.state.step >= self.total || self.is_stale();
            let ended = whole && !self.state.pending;
            if ended || self.stop {
                if self.saved.0 != self.state.step || self.stop {
                    self.save()?;
                }
                if ended && self.state.step < self.total {
                    let (step, total) = (self.state.step, self.total);
                    let text = format!(
                        "ended at step {step} of {total}: validation has not been better for as long as `patience` says"
                    );
                    self.tell(&Event::Warned { text });
                }
                return Ok(Ended::early(!ended));
            }
            self.step()?;
            let step = self.state.step;
            self.state.pending = step.is_multiple_of(self.steps_per_epoch) || step >= self.total;
            self.agree();
            if step.is_multiple_of(COMPARED_EVERY) {
                self.compare()?;
            }
            if !self.state.pending && !self.stop && self.due {
                self.save()?;
            }
        }
    }

    /// Whether validation's best is as old as the patience: known from its step, so that runs that go on know it too.
    pub(super) fn is_stale(&self) -> bool {
        let train = &self.job.config.train;
        let (Some(patience), Some(every)) = (train.patience, train.validation_every) else {
            return false;
        };
        let age = self.state.best.map_or(0, |(_, step)| self.state.step - step);
        age >= patience.saturating_mul(every).saturating_mul(self.steps_per_epoch)
    }

    fn is_due(&self) -> bool {
        let train = &self.job.config.train;
        let (step, at) = self.saved;
        let steps = self.state.step - step;
        let minutes = at.elapsed().as_secs_f64() / 60.0;
        train.checkpoint_steps.is_some_and(|due| steps >= due)
            || train.checkpoint_minutes.is_some_and(|due| minutes >= due)
    }

    fn step(&mut self) -> Result<(), TrainError> {
        let start = Instant::now();
        let _between_steps = self.ranks.take_said();
        let train = &self.job.config.train;
        let at = StepInfo { step: self.state.step, epoch: self.state.step / self.steps_per_epoch };
        self.enter(at);
        let mut gradient = self.gradient(at)?;
        self.state.step += 1;
        let (step, loss) = (self.state.step, gradient.loss());
        if let (Some(average), Some(spike)) = (self.state.average, train.skip_spikes)
            && average > 0.0
            && loss > spike * average
            && self.state.skipped < SPIKES
        {
            self.state.skipped += 1;
            if let Some(record) = &mut self.record {
                record.skipped([step, at.epoch], loss, average);
            }
            self.warn();
            self.tell(&Event::Skipped { step, loss, average });
            return Ok(());
        }
        // After so many it is no spike but another level.
        let average = self.state.average.filter(|_| self.state.skipped < SPIKES);
        self.state.average = Some(average.map_or(loss, |a| MEMORY * a + (1.0 - MEMORY) * loss));
        self.state.skipped = 0;
        let factor = self.schedule.factor(at.step);
        self.update(&mut gradient, factor);
        let training = TrainingStep {
            epoch: at.epoch,
            learning_rate: train.learning_rate * factor,
            gradient_norm: gradient.norm,
            seconds: start.elapsed().as_secs_f64(),
            communication: self.ranks.take_said(),
        };
        let terms = std::mem::take(&mut gradient.terms);
        let report = Step { training: Some(training), ..Step::of(step, self.total, terms) };
        drop(gradient);
        if let Some(record) = &mut self.record {
            record.step(&report, training);
        }
        self.warn();
        self.tell(&Event::Step(report));
        Ok(())
    }

    /// What a step's samples amount to. Those of the next step are drawn beside it.
    fn gradient(&mut self, at: StepInfo) -> Result<StepGradient, TrainError> {
        let (system, tapes, ranks) = (&self.system, &mut self.tapes, &mut self.ranks);
        let train = &self.job.config.train;
        let (items, data, seed) = (&self.items, self.job.data, train.seed);
        let (share, accumulate) = (self.share, train.accumulate);
        let steps_per_epoch = self.steps_per_epoch;
        let ahead = self.ahead.take().filter(|ahead| ahead.step == at.step);
        // Not beyond the epoch: the next one may change the system, and is scored first.
        let next = StepInfo { step: at.step + 1, ..at };
        let follows = !next.step.is_multiple_of(steps_per_epoch) && next.step < self.total;
        let mut drawn = None;
        // All of it in the pool of threads: each entry from outside would cost a hop.
        let gradient = in_pool(|| -> Result<_, TrainError> {
            let draw = |system: &S, at: StepInfo| {
                draw(system, data, items, seed, at, steps_per_epoch, (share, accumulate))
            };
            let samples = ahead.map_or_else(|| draw(system, at), |ahead| ahead.samples);
            let samples = ranks.together(samples)?;
            tapes.gradient(system, &samples, (at, seed), ranks, |system| {
                drawn = follows.then(|| draw(system, next));
            })
        });
        self.ahead = drawn.map(|samples| Ahead { step: next.step, samples });
        gradient
    }

    /// Moves running statistics, parameters and their averages; `factor` is that of the learning rate.
    fn update(&mut self, gradient: &mut StepGradient, factor: f64) {
        let (limit, step) = (self.job.config.train.clip_norm, self.state.step);
        let (system, optimizer, average) =
            (&mut self.system, &mut self.optimizer, &mut self.average);
        in_pool(|| {
            gradient.update(system);
            if let Some(limit) = limit.filter(|&limit| gradient.norm > limit) {
                clip_grad_norm(&mut gradient.gradients, limit);
            }
            optimizer.step(system, &gradient.gradients, factor);
            if let Some(average) = average {
                average.update(system, step);
            }
        });
    }

    /// Tells the system of a new epoch and draws its order.
    fn enter(&mut self, at: StepInfo) {
        if self.state.epochs_begun <= at.epoch {
            self.system.begin_epoch(at.epoch, &mut OptimizerState(&mut self.optimizer));
            self.state.epochs_begun = at.epoch + 1;
            self.items.clear();
        }
        if self.items.is_empty() {
            let len = self.system.epoch_len(self.job.data);
            self.items = order(self.job.config.train.seed, at.epoch, len);
        }
    }

    fn save(&mut self) -> Result<(), TrainError> {
        self.compare()?;
        let path = self.job.run.last();
        let synced = self.record.as_mut().map_or(Ok(()), Record::sync);
        let written = synced.map_err(TrainError::from).and_then(|()| self.write(&path));
        self.ranks.together(written)?;
        self.saved = (self.state.step, Instant::now());
        if self.ranks.is_first() {
            self.tell(&Event::Saved { step: self.state.step, path });
        }
        self.agree();
        Ok(())
    }

    /// Writes a checkpoint, which the first process does.
    fn write(&self, path: &Path) -> Result<(), TrainError> {
        if !self.ranks.is_first() {
            return Ok(());
        }
        let job = self.job;
        let kept = (&self.optimizer, self.average.as_ref());
        Ok(save(path, &self.system, kept, &self.state, job.config)?)
    }

    /// What is left to be written.
    fn end(&mut self) -> Result<(), TrainError> {
        let synced = self.record.as_mut().map_or(Ok(()), Record::sync);
        let written = synced.map_err(TrainError::from).and_then(|()| self.digest());
        self.ranks.together(written)?;
        self.warn();
        Ok(())
    }
}

/// The samples of a step that are this process's. An epoch that is shorter than a step begins again.
fn draw<S: System>(
    system: &S,
    data: &S::Data,
    items: &[usize],
    seed: u64,
    at: StepInfo,
    steps_per_epoch: u64,
    (share, accumulate): (Share, usize),
) -> Result<Vec<S::Sample>, TrainError> {
    let first = (at.step % steps_per_epoch) as usize * share.batch * accumulate;
    let places: Vec<usize> = share.own_places(accumulate).collect();
    let samples = places
        .into_par_iter()
        .map(|place| {
            let index = first + place;
            let item = items[index % items.len()];
            system.draw(data, &Draw { seed, epoch: at.epoch, index: index as u64, item })
        })
        // All, so that the first failure is the same for any number of threads.
        .collect::<Vec<_>>();
    Ok(samples.into_iter().collect::<Result<_, _>>()?)
}

/// Runs `f` on a thread of the present pool.
fn in_pool<R: Send>(f: impl FnOnce() -> R + Send) -> R {
    rayon::scope(|_| f())
}
