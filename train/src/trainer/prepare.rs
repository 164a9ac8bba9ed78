//! What a training needs before its first step.

use std::time::Instant;

use super::{Job, Trainer};
use crate::average::Average;
use crate::checkpoint::{Checkpoint, TrainState};
use crate::config::Configuration;
use crate::error::{DataError, TrainError};
use crate::fingerprint::Fingerprint;
use crate::inherited::Inherited;
use crate::optimizer::AnyOptimizer;
use crate::progress::{Event, Watch};
use crate::ranks::Ranks;
use crate::record::{Heading, Record};
use crate::run::RunFolder;
use crate::settings::{Options, to_toml};
use crate::share::Share;
use crate::step::Tapes;
use crate::system::System;

/// What a training begins or goes on with.
struct Begun<S> {
    system: S,
    optimizer: AnyOptimizer,
    average: Option<Average>,
    state: TrainState,
    /// Whether it goes on.
    resumed: bool,
    inherited: Option<Inherited>,
}

impl<'j, 'w, 'o, S: System> Trainer<'j, 'w, 'o, S> {
    pub(super) fn prepare(
        job: &'j Job<'j, S>,
        mut ranks: Ranks<'j>,
        watch: &'w mut Watch<'o>,
    ) -> Result<Self, TrainError> {
        let config = job.config;
        let train = &config.train;
        let problems = S::problems(config);
        let sound = if problems.is_empty() { Ok(()) } else { Err(TrainError::Config(problems)) };
        ranks.together(sound)?;
        let summary = S::summary(&config.system);
        let begun = begin(job);
        let begun = ranks.together(begun)?;
        let shared = share(&begun.system, config, &ranks);
        let share = ranks.together(shared)?;
        let data_hash = S::fingerprint(job.data);
        ranks.same("options", Fingerprint::new().with(to_toml(config).as_bytes()).value())?;
        ranks.same("data", data_hash)?;
        ranks.same("steps", begun.state.step)?;
        let Begun { system, optimizer, average, state, resumed, inherited } = begun;
        let per_step = (train.batch * train.accumulate) as u64;
        let steps_per_epoch = (system.epoch_len(job.data) as u64 / per_step).max(1);
        let all = train.epochs.saturating_mul(steps_per_epoch);
        let total = train.max_steps.map_or(all, |most| all.min(most));
        let heading = Heading {
            system: S::NAME,
            config,
            provenance: job.provenance,
            summary: &summary,
            data_hash,
            steps_per_epoch,
            total,
            processes: ranks.place()[1],
        };
        let resumed_at = resumed.then_some(&state);
        let recorded = ranks.is_first().then(|| recorded(job.run, &heading, resumed_at));
        let record = ranks.together(recorded.transpose())?;
        let mut trainer = Self {
            job,
            watch,
            ranks,
            share,
            system,
            optimizer,
            average,
            tapes: Tapes::new(share),
            record,
            schedule: train.schedule(steps_per_epoch, total),
            items: Vec::new(),
            ahead: None,
            steps_per_epoch,
            total,
            metrics: Vec::new(),
            stop: false,
            due: false,
            saved: (state.step, Instant::now()),
            state,
        };
        trainer.compare()?;
        if !resumed {
            // Whatever happens from here on, the run can go on.
            let written = trainer.write(&job.run.last());
            trainer.ranks.together(written)?;
        }
        trainer.announce(summary.trainable, inherited);
        Ok(trainer)
    }

    /// Tells that it begins, and what a user should know of what it begins with.
    fn announce(&mut self, trainable: usize, inherited: Option<Inherited>) {
        let (total, done) = (self.total, self.state.step);
        let facts =
            [("trainable", trainable as f64), ("steps_per_epoch", self.steps_per_epoch as f64)];
        self.tell(&Event::Started { job: "train", total, done, facts: facts.into() });
        if let Some(inherited) = inherited {
            self.tell(&Event::Inherited(inherited));
        }
        for text in S::data_summary(self.job.data).into_iter().flat_map(|summary| summary.warnings)
        {
            self.tell(&Event::Warned { text });
        }
        self.warn();
    }
}

/// The system as its checkpoint has it, or a fresh one.
fn begin<S: System>(job: &Job<'_, S>) -> Result<Begun<S>, TrainError> {
    let (config, train) = (job.config, &job.config.train);
    // What was killed before its first checkpoint goes on from its beginning.
    let last = if job.resume { job.run.checkpoint()? } else { None };
    if let Some(last) = last {
        let (system, optimizer, average, state) = Checkpoint::read(&last)?.resume::<S>(config)?;
        return Ok(Begun { system, optimizer, average, state, resumed: true, inherited: None });
    }
    let mut system = S::new(&config.system, train.seed);
    if system.epoch_len(job.data) == 0 {
        let text = "there is nothing to train on: all of the data is for validation or test";
        return Err(DataError::Unfit(text.into()).into());
    }
    let inherited = match job.from {
        Some(path) => Some(Checkpoint::read(path)?.lend(&mut system)?),
        None => None,
    };
    system.init_from_data(job.data, inherited.as_ref())?;
    let optimizer = AnyOptimizer::new(train, &system.rates());
    let average = train.ema_decay.map(|decay| Average::new(decay, &system));
    let state = TrainState::default();
    Ok(Begun { system, optimizer, average, state, resumed: false, inherited })
}

/// The files of a run that begins, or of one that goes on from a state.
fn recorded<'j, C: Options>(
    run: &'j RunFolder,
    heading: &Heading<'_, C>,
    resumed_at: Option<&TrainState>,
) -> Result<Record<'j>, TrainError> {
    Ok(match resumed_at {
        Some(state) => Record::resume(run, heading, state.step, state.pending)?,
        None => Record::begin(run, heading)?,
    })
}

/// The part of each batch that is this process's.
fn share<S: System>(
    system: &S,
    config: &Configuration<S::Config>,
    ranks: &Ranks<'_>,
) -> Result<Share, TrainError> {
    let (train, [_, size]) = (&config.train, ranks.place());
    let refused = |text: String| Err(TrainError::Config(vec![text]));
    if let (Some(coupling), true) = (system.coupling(), train.shards.max(size) > 1) {
        let (what, found) = if size > 1 {
            ("there are", format!("{size} processes"))
        } else {
            ("`shards` is", train.shards.to_string())
        };
        return refused(format!(
            "{what} {found}, expected 1: what this system computes for a sample depends on its whole batch, which cannot be \
             cut: {coupling}"
        ));
    }
    let parts = Share::new(train.batch, train.shards, [0, 1]).parts();
    if size > parts {
        let (batch, shards) = (train.batch, train.shards);
        return refused(format!(
            "there are {size} processes, expected at most {parts}: a `batch` of {batch} with `shards` = {shards} falls into \
             {parts} shards, and each process computes at least one (--set shards={size} cuts it into more); results are the same \
             for any number of processes, but not for any number of shards"
        ));
    }
    Ok(Share::new(train.batch, train.shards, ranks.place()))
}
