//! The trainer: a training, from its first step to its last.

use std::path::Path;
use std::time::Instant;

use autodiff_lite::optim::{Schedule, clip_grad_norm};
use rayon::prelude::*;

use super::average::Average;
use super::checkpoint::{Checkpoint, TrainState, save};
use super::config::Configuration;
use super::draw::{Draw, order};
use super::error::{DataError, TrainError};
use super::optimizer::{AnyOptimizer, OptimizerState};
use super::progress::{Ended, Event, Step, TrainingStep, Watch};
use super::record::{Heading, Record};
use super::run::{Provenance, RunFolder};
use super::step::Tapes;
use super::step_info::StepInfo;
use super::subset::Subset;
use super::system::{Metric, System};

/// Weight of the past in the moving average of losses (Mesh R-CNN's 0.9).
const MEMORY: f64 = 0.9;

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
    /// there begins at random, and is told by an [`Event::Inherited`]; an encoder's own weights go over it.
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

/// Trains a system, or goes on training it, and keeps everything in the run's folder.
///
/// `watch` hears of every step; once it is [cancelled](super::progress::Cancel), a checkpoint is written after the step or the scoring that
/// goes on, and the function returns. The same configuration and data give the same parameters bit by bit, for any
/// number of threads, and whether or not the run was cancelled on the way.
///
/// # Errors
/// If an option is out of range, a file cannot be read or written, or a number becomes infinite or
/// NaN; the last checkpoint is then untouched. Where it is the scores that fail, the steps before them are saved.
pub fn train<S: System>(job: &Job<'_, S>, watch: &mut Watch<'_>) -> Result<Outcome<S>, TrainError> {
    let begun = Instant::now();
    let mut trainer = Trainer::prepare(job, watch)?;
    let ended = trainer.run()?;
    trainer.record.sync()?;
    trainer.digest()?;
    trainer.warn();
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
    system: S,
    optimizer: AnyOptimizer,
    average: Option<Average>,
    tapes: Tapes,
    record: Record<'j>,
    state: TrainState,
    schedule: Schedule,
    /// The order of the items in the present epoch.
    items: Vec<usize>,
    /// What was drawn for the next step.
    ahead: Option<Ahead<S::Sample>>,
    steps_per_epoch: u64,
    total: u64,
    metrics: Vec<Metric>,
    stop: bool,
    saved: (u64, Instant),
}

impl<'j, 'w, 'o, S: System> Trainer<'j, 'w, 'o, S> {
    fn prepare(job: &'j Job<'j, S>, watch: &'w mut Watch<'o>) -> Result<Self, TrainError> {
        let config = job.config;
        let train = &config.train;
        let problems = S::problems(config);
        if !problems.is_empty() {
            return Err(TrainError::Config(problems));
        }
        let summary = S::summary(&config.system);
        // What was killed before its first checkpoint goes on from its beginning.
        let last = if job.resume { job.run.checkpoint()? } else { None };
        let resume = last.is_some();
        let mut inherited = None;
        let (system, optimizer, average, state) = if let Some(last) = last {
            Checkpoint::read(&last)?.resume::<S>(config)?
        } else {
            let mut system = S::new(&config.system, train.seed);
            if system.epoch_len(job.data) == 0 {
                let text =
                    "there is nothing to train on: all of the data is for validation or test";
                return Err(DataError::Unfit(text.into()).into());
            }
            if let Some(path) = job.from {
                inherited = Some(Checkpoint::read(path)?.lend(&mut system)?);
            }
            system.init_from_data(job.data)?;
            let optimizer = AnyOptimizer::new(train, &system.rates());
            let average = train.ema_decay.map(|decay| Average::new(decay, &system));
            (system, optimizer, average, TrainState::default())
        };
        if system.couples_samples() && train.shards > 1 {
            let text = "`shards` is more than 1, but what this system computes for a sample depends on its whole batch";
            return Err(TrainError::Config(vec![text.into()]));
        }
        let per_step = (train.batch * train.accumulate) as u64;
        let steps_per_epoch = (system.epoch_len(job.data) as u64 / per_step).max(1);
        let all = train.epochs.saturating_mul(steps_per_epoch);
        let total = train.max_steps.map_or(all, |most| all.min(most));
        let heading = Heading {
            system: S::NAME,
            config,
            provenance: job.provenance,
            summary: &summary,
            data_hash: S::fingerprint(job.data),
            steps_per_epoch,
            total,
        };
        let record = if resume {
            Record::resume(job.run, &heading, state.step, state.pending)?
        } else {
            Record::begin(job.run, &heading)?
        };
        let mut trainer = Self {
            job,
            watch,
            system,
            optimizer,
            average,
            tapes: Tapes::new(train.shards),
            record,
            schedule: train.schedule(steps_per_epoch, total),
            items: Vec::new(),
            ahead: None,
            steps_per_epoch,
            total,
            metrics: Vec::new(),
            stop: false,
            saved: (state.step, Instant::now()),
            state,
        };
        if !resume {
            // Whatever happens from here on, the run can go on.
            trainer.write(&job.run.last())?;
        }
        let (trainable, done) = (summary.trainable as f64, trainer.state.step);
        let facts = [("trainable", trainable), ("steps_per_epoch", steps_per_epoch as f64)];
        trainer.tell(&Event::Started { job: "train", total, done, facts: facts.into() });
        if let Some(inherited) = inherited {
            trainer.tell(&Event::Inherited(inherited));
        }
        for text in S::data_summary(job.data).into_iter().flat_map(|summary| summary.warnings) {
            trainer.tell(&Event::Warned { text });
        }
        trainer.warn();
        Ok(trainer)
    }

    /// Tells of an event. Only now it is asked whether to stop, so that within a step the answer is one.
    fn tell(&mut self, event: &Event) {
        self.watch.tell(event);
        self.stop |= self.watch.is_cancelled();
    }

    /// Passes on what a user should know.
    fn warn(&mut self) {
        for text in self.record.warnings() {
            self.tell(&Event::Warned { text });
        }
    }

    fn run(&mut self) -> Result<Ended, TrainError> {
        loop {
            if self.state.pending && !self.stop {
                let evaluated = self.score_epoch()?;
                self.state.pending = false;
                if evaluated || self.due() {
                    self.save()?;
                }
            }
            let ended = self.state.step >= self.total && !self.state.pending;
            if ended || self.stop {
                if self.saved.0 != self.state.step || self.stop {
                    self.save()?;
                }
                return Ok(Ended::early(!ended));
            }
            self.step()?;
            let step = self.state.step;
            self.state.pending = step.is_multiple_of(self.steps_per_epoch) || step >= self.total;
            if !self.state.pending && !self.stop && self.due() {
                self.save()?;
            }
        }
    }

    fn due(&self) -> bool {
        let train = &self.job.config.train;
        let (step, at) = self.saved;
        let steps = self.state.step - step;
        let minutes = at.elapsed().as_secs_f64() / 60.0;
        train.checkpoint_steps.is_some_and(|due| steps >= due)
            || train.checkpoint_minutes.is_some_and(|due| minutes >= due)
    }

    fn step(&mut self) -> Result<(), TrainError> {
        let start = Instant::now();
        let train = &self.job.config.train;
        let at = StepInfo { step: self.state.step, epoch: self.state.step / self.steps_per_epoch };
        self.enter(at);
        // The whole step in the pool of threads: each entry from outside would cost a hop.
        let (system, tapes) = (&mut self.system, &mut self.tapes);
        let (items, data, seed) = (&self.items, self.job.data, train.seed);
        let (per_step, steps_per_epoch) = (train.batch * train.accumulate, self.steps_per_epoch);
        let ahead = self.ahead.take().filter(|ahead| ahead.step == at.step);
        // Not beyond the epoch: the next one may change the system, and is scored first.
        let next = StepInfo { step: at.step + 1, ..at };
        let follows = !next.step.is_multiple_of(steps_per_epoch) && next.step < self.total;
        let mut drawn = None;
        let gradient = in_pool(|| -> Result<_, TrainError> {
            let draw = |system: &S, at: StepInfo| {
                draw(system, data, items, seed, at, steps_per_epoch, per_step)
            };
            let samples = ahead.map_or_else(|| draw(system, at), |ahead| ahead.samples)?;
            tapes.gradient(system, &samples, train.batch, at, seed, |system| {
                drawn = follows.then(|| draw(system, next));
            })
        });
        self.ahead = drawn.map(|samples| Ahead { step: next.step, samples });
        let mut gradient = gradient?;
        self.state.step += 1;
        let (step, loss) = (self.state.step, gradient.loss());
        let average = self.state.average;
        if let (Some(average), Some(spike)) = (average, train.skip_spikes)
            && loss > spike * average
        {
            self.record.skipped([step, at.epoch], loss, average);
            self.warn();
            self.tell(&Event::Skipped { step, loss, average });
            return Ok(());
        }
        self.state.average = Some(average.map_or(loss, |a| MEMORY * a + (1.0 - MEMORY) * loss));
        let factor = self.schedule.factor(at.step);
        let (system, optimizer, average) =
            (&mut self.system, &mut self.optimizer, &mut self.average);
        in_pool(|| {
            if let Some(limit) = train.clip_norm.filter(|&limit| gradient.norm > limit) {
                clip_grad_norm(&mut gradient.gradients, limit);
            }
            optimizer.step(system, &gradient.gradients, factor);
            if let Some(average) = average {
                average.update(system, step);
            }
        });
        let training = TrainingStep {
            epoch: at.epoch,
            learning_rate: train.learning_rate * factor,
            gradient_norm: gradient.norm,
            seconds: start.elapsed().as_secs_f64(),
        };
        let terms = std::mem::take(&mut gradient.terms);
        let report = Step { training: Some(training), ..Step::of(step, self.total, terms) };
        drop(gradient);
        self.record.step(&report, training);
        self.warn();
        self.tell(&Event::Step(report));
        Ok(())
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

    /// [`end_epoch`](Self::end_epoch), and where it fails a checkpoint: the steps are good, and who goes on makes up for the
    /// scores.
    fn score_epoch(&mut self) -> Result<bool, TrainError> {
        let best = self.state.best;
        self.end_epoch().inspect_err(|_| {
            self.state.best = best;
            // What has failed is told, not what is made of it.
            let _ = self.save();
        })
    }

    /// Scores and samples of validation, and the best checkpoint; whether it was the turn of scores.
    fn end_epoch(&mut self) -> Result<bool, TrainError> {
        let train = &self.job.config.train;
        let step = self.state.step;
        let epoch = step.div_ceil(self.steps_per_epoch);
        let last = step >= self.total;
        let turn =
            |every: Option<u64>| last || every.is_some_and(|every| epoch.is_multiple_of(every));
        let place = [step, epoch];
        if turn(train.validation_every) {
            let data = self.job.data;
            self.metrics =
                self.averaged(|system| in_pool(|| system.evaluate(data, Subset::Validation)))?;
            let best = self.is_best()?;
            self.record.validation(place, &self.metrics, best);
            if best {
                let path = self.job.run.best();
                self.write(&path)?;
            }
            let metrics = self.metrics.clone();
            let (epoch, best) = (Some(epoch), Some(best));
            self.tell(&Event::Evaluated { step, epoch, metrics, best });
        }
        if turn(train.samples_every) {
            let data = self.job.data;
            let shown =
                self.averaged(|system| in_pool(|| system.show(data, Subset::Validation)))?;
            self.record.samples(place, shown);
        }
        let evaluated = turn(train.validation_every);
        if evaluated {
            self.digest()?;
        }
        self.warn();
        Ok(evaluated)
    }

    /// Writes the table and the page, if something is to be added.
    fn digest(&mut self) -> Result<(), TrainError> {
        self.exchange();
        let (system, data) = (&self.system, self.job.data);
        let digested = self
            .record
            .digest::<S>(self.job.config, || in_pool(|| system.show(data, Subset::Validation)));
        self.exchange();
        digested
    }

    /// What `f` makes of the system that predicts: with averaged weights, where there are any.
    fn averaged<R>(&mut self, f: impl FnOnce(&S) -> R) -> R {
        self.exchange();
        let made = f(&self.system);
        self.exchange();
        made
    }

    /// Puts averaged weights in the place of the trained ones, or these back.
    fn exchange(&mut self) {
        if let Some(average) = &mut self.average {
            average.swap(&mut self.system);
        }
    }

    fn is_best(&mut self) -> Result<bool, TrainError> {
        let name = self.job.config.train.best.as_deref().unwrap_or(S::BEST);
        let Some(metric) = self.metrics.iter().find(|metric| metric.name == name) else {
            let metrics = self.metrics.iter().map(|metric| metric.name.clone()).collect();
            return Err(TrainError::NoSuchMetric { name: name.to_owned(), metrics });
        };
        let best = match self.state.best {
            _ if metric.value.is_nan() => false,
            None => true,
            Some((value, _)) => metric.better.improves(metric.value, value),
        };
        if best {
            self.state.best = Some((metric.value, self.state.step));
        }
        Ok(best)
    }

    fn save(&mut self) -> Result<(), TrainError> {
        let path = self.job.run.last();
        self.record.sync()?;
        self.write(&path)?;
        self.saved = (self.state.step, Instant::now());
        self.tell(&Event::Saved { step: self.state.step, path });
        Ok(())
    }

    fn write(&self, path: &Path) -> Result<(), TrainError> {
        let job = self.job;
        let kept = (&self.optimizer, self.average.as_ref());
        Ok(save(path, &self.system, kept, &self.state, job.config)?)
    }
}

/// The samples of a step. An epoch that is shorter than a step begins again.
fn draw<S: System>(
    system: &S,
    data: &S::Data,
    items: &[usize],
    seed: u64,
    at: StepInfo,
    steps_per_epoch: u64,
    count: usize,
) -> Result<Vec<S::Sample>, TrainError> {
    let first = (at.step % steps_per_epoch) as usize * count;
    let samples = (first..first + count)
        .into_par_iter()
        .map(|index| {
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
