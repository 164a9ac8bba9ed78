//! What studies that train share: configurations with changes, and their data.

use std::fmt::Write as _;

use datasets::ReadOptions;
use train::settings::{read_text, to_toml};
use train::{Compile, Configuration, DataError, Metric, Source, System};

use super::error::StudyError;
use super::plan::{Plan, PlannedJob};
use super::row::{Cell, Row};
use super::scale::Scale;
use super::work::{Trained, Work};
use crate::progress::Watch;

/// A setting over a preset.
pub(crate) type Change = (&'static str, &'static str);

/// A job: its name, the label of its row, what it trains.
pub(crate) type Planned<S> = (String, &'static str, Configuration<<S as System>::Config>);

/// A job's name, the label of its row, and its changes of a preset.
pub(crate) type Listed = (&'static str, &'static str, Vec<Change>);

/// Jobs over one preset, each with its own changes and then those of all.
pub(crate) fn over<S: System>(
    name: &str,
    jobs: impl IntoIterator<Item = Listed>,
    all: &[Change],
) -> Vec<Planned<S>> {
    let made = |(id, label, own): Listed| {
        (id.to_owned(), label, preset::<S>(name, &[&own[..], all].concat()))
    };
    jobs.into_iter().map(made).collect()
}

/// In a tenth of the steps, where the scale is that; all that is counted in steps or epochs comes as much earlier.
pub(crate) fn scaled<S: System>(scale: Scale, mut jobs: Vec<Planned<S>>) -> Vec<Planned<S>> {
    if scale == Scale::Tenth {
        for (.., config) in &mut jobs {
            let train = &mut config.train;
            match &mut train.max_steps {
                Some(steps) => *steps = tenth(*steps),
                None => train.epochs = tenth(train.epochs),
            }
            train.warmup = tenth(train.warmup);
            train.drop_every = tenth(train.drop_every);
            train.milestones.iter_mut().for_each(|epoch| *epoch = tenth(*epoch));
        }
    }
    jobs
}

/// A tenth of a count, or a little more.
pub(crate) fn tenth(count: u64) -> u64 {
    count.div_ceil(10)
}

/// A preset with changes. Both are ours and sound.
pub(crate) fn preset<S: System>(name: &str, changes: &[Change]) -> Configuration<S::Config> {
    let found = S::PRESETS.iter().find(|(preset, _)| *preset == name);
    let (_, text) = found.expect("a preset of this system");
    let changes: Vec<(String, String)> =
        changes.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect();
    read_text(name.as_ref(), text, &changes).expect("presets and their changes are sound")
}

/// These jobs, and all that decides their results.
pub(crate) fn plan<S: System>(jobs: &[Planned<S>]) -> Plan {
    let mut plan = Plan::default();
    for (job, label, config) in jobs {
        let length = config.train.max_steps.unwrap_or(config.train.epochs);
        plan.jobs.push(PlannedJob { id: job.clone(), label: (*label).to_owned(), length });
        for line in to_toml(config).lines() {
            let _ = writeln!(plan.settings, "{job}.{line}");
        }
    }
    plan
}

/// The job that is to be done.
pub(crate) fn planned<S: System>(jobs: Vec<Planned<S>>, work: &Work<'_>) -> Planned<S> {
    jobs.into_iter().find(|(id, ..)| *id == work.id).expect("one of the jobs")
}

/// The user's data, or what the configuration makes: drawn anew by each seed, as weights and order are, so that the spread is
/// that of the whole experiment.
pub(crate) fn open<S: System<ReadOptions = ReadOptions>>(
    work: &Work<'_>,
    config: &Configuration<S::Config>,
) -> Result<S::Data, DataError> {
    let options = ReadOptions::default();
    let source =
        Source { path: work.data, options: &options, seed: work.seed, progress: &|_, _| () };
    S::open(&config.system, &source)
}

/// Opens a job's data and trains its system, as far as scoring.
pub(crate) fn train_job<S: System<ReadOptions = ReadOptions> + Compile>(
    config: &Configuration<S::Config>,
    work: &Work<'_>,
    watch: &mut Watch<'_>,
) -> Result<(S::Data, Trained<S>), StudyError> {
    let data = open::<S>(work, config)?;
    let trained = work.train::<S>(config, &data, watch)?;
    work.tell(watch, 1.0, "scoring")?;
    Ok((data, trained))
}

/// A row with all of these scores.
pub(crate) fn scored(row: Row, metrics: &[Metric]) -> Row {
    metrics.iter().fold(row, |row, metric| {
        let decimals = if metric.name == "psnr" { 2 } else { 4 };
        row.with(Cell::of(metric, decimals))
    })
}
