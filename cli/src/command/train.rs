//! `unsphere train`: a system, its data, and a run folder that can go on.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use models::predict::Predictor;
use serde::Serialize;
use train::progress::{Communication, Event, Step};
use train::report::counted;
use train::{
    CHANGEABLE, Checkpoint, CheckpointError, Communicator, Configuration, Job, Outcome, RunError,
    RunFolder, RunMetadata, Subset, System, TrainConfig, TrainError, settings, train_among,
};

use crate::args::{Global, Train};
use crate::checkpoint::{self, checkpoint_path, of_another_system};
use crate::configuration::configuration;
use crate::console::{Console, table};
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::memory;
use crate::processes::together;
use crate::progress::{Progress, spoken};
use crate::provenance::provenance;
use crate::views::open;

/// Steps and time after which the pace of a training is worth telling.
const PACE_KNOWN: (u64, Duration) = (3, Duration::from_secs(4));

/// The answer to Ctrl-C.
const STOPPING: &str = "stopping: after this step, or the scoring that goes on, a checkpoint is written; Ctrl-C again ends at once";

/// What is printed with `--json`.
#[derive(Debug, Serialize)]
struct Trained<'a> {
    #[serde(serialize_with = "train::path_text::serialize")]
    run: &'a Path,
    system: &'static str,
    steps: u64,
    interrupted: bool,
    seconds: f64,
    /// Bytes, of this process; none where the system does not tell.
    #[serde(skip_serializing_if = "Option::is_none")]
    peak_memory: Option<u64>,
    /// The last scores of validation.
    metrics: BTreeMap<String, f64>,
    best: Option<Best>,
    /// How many shared it.
    processes: usize,
    /// What that cost in a step of this part of the run, in the mean; none of a process alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    communication: Option<Communication>,
}

#[derive(Clone, Copy, Debug, Serialize)]
struct Best {
    value: f64,
    step: u64,
}

pub(crate) fn run<S: Predictor>(
    console: Console,
    global: Global,
    arguments: &Train,
    communicator: &dyn Communicator,
) -> Result<(), Failure> {
    Command { console, global, arguments, communicator }.run::<S>()
}

#[derive(Clone, Copy)]
struct Command<'a> {
    console: Console,
    global: Global,
    arguments: &'a Train,
    communicator: &'a dyn Communicator,
}

/// What is settled before any data is read.
struct Prepared<C> {
    /// The run that goes on, if one does.
    run: Option<RunFolder>,
    config: Configuration<C>,
    data: Option<PathBuf>,
}

impl Command<'_> {
    fn run<S: Predictor>(self) -> Result<(), Failure> {
        let Self { console, arguments, communicator, .. } = self;
        let start = Instant::now();
        let from = arguments.from.as_deref();
        let from = from.map(|path| checkpoint_path::<S>(path, false)).transpose();
        let from = together(communicator, from)?;
        let prepared = self.prepared::<S>(from.as_ref().map(|from| &*from.file));
        let Prepared { run, config, data } = together(communicator, prepared)?;
        let alone = communicator.size() == 1;
        let interrupt = if alone { Interrupt::listen(None) } else { Interrupt::listen_among(None) };
        let interrupt = together(communicator, interrupt)?;
        let opened = open::<S>(console, &config, data.as_deref(), &arguments.reading.options());
        let opened = together(communicator, opened)?;
        // Only now: what cannot be opened must not cost the run that it was to replace.
        let run = match run {
            Some(run) => Ok(run),
            None if self.is_first() => {
                RunFolder::create(self.place(), arguments.force).map_err(failed)
            }
            None => Ok(RunFolder::at(self.place())),
        };
        let run = together(communicator, run)?;
        interrupt.worthwhile_saying(STOPPING);
        let provenance = provenance(data.as_deref());
        let resume = arguments.resume.is_some();
        let from = from.as_ref().map(|from| &*from.file);
        let job = Job {
            config: &config,
            data: &opened,
            run: &run,
            provenance: &provenance,
            resume,
            from,
        };
        let (outcome, communication) = self.watched::<S>(&job, &interrupt)?;
        if !self.is_first() {
            return if outcome.ended.is_cancelled() {
                Err(Failure::Interrupted(String::new()))
            } else {
                Ok(())
            };
        }
        let trained = Trained {
            run: run.path(),
            system: S::NAME,
            steps: outcome.steps,
            interrupted: outcome.ended.is_cancelled(),
            seconds: start.elapsed().as_secs_f64(),
            peak_memory: memory::peak(),
            metrics: outcome.metrics.iter().map(|m| (m.name.clone(), m.value)).collect(),
            best: outcome.best.map(|(value, step)| Best { value, step }),
            processes: communicator.size(),
            communication,
        };
        console.result(&trained, describe)?;
        if trained.interrupted {
            let (name, run) = (S::NAME, run.path().display());
            let text = format!(
                "after {}; `unsphere train {name} --resume {run}` goes on",
                counted(trained.steps as usize, "step")
            );
            return Err(Failure::Interrupted(text));
        }
        Ok(())
    }
}

impl Command<'_> {
    /// Whether this process speaks and writes.
    fn is_first(&self) -> bool {
        self.communicator.rank() == 0
    }

    /// What is settled before any data is read; `from` are weights that a new run begins with.
    fn prepared<S: Predictor>(&self, from: Option<&Path>) -> Result<Prepared<S::Config>, Failure> {
        let Self { global, arguments, .. } = *self;
        if let Some(path) = &arguments.resume {
            return self.resumed::<S>(path);
        }
        let config = match from {
            Some(from) => {
                let read = Checkpoint::read(from).map_err(Failure::input)?;
                checkpoint::configuration::<S>(&read, &arguments.settings.set, global.seed)?
            }
            None => configuration::<S>(&arguments.settings, global)?,
        };
        if self.is_first() {
            RunFolder::examine(self.place(), arguments.force).map_err(failed)?;
        }
        Ok(Prepared { run: None, config, data: arguments.data.clone() })
    }

    /// Where a new run goes.
    fn place(&self) -> &Path {
        self.arguments.output.as_deref().unwrap_or_else(|| Path::new("run"))
    }

    /// What the configuration is called.
    fn called(&self) -> String {
        let Train { resume, from, settings, .. } = self.arguments;
        match (resume, from, &settings.config) {
            (Some(_), ..) => "resumed".to_owned(),
            (None, Some(path), _) => format!("from {}", path.display()),
            (None, None, Some(path)) => path.display().to_string(),
            (None, None, None) => format!("preset {}", settings.preset),
        }
    }

    /// The folder of a run that goes on, its configuration, and where its data is.
    fn resumed<S: System>(&self, path: &Path) -> Result<Prepared<S::Config>, Failure> {
        let run = if self.is_first() {
            RunFolder::resume(path).map_err(failed)?
        } else {
            RunFolder::at(path)
        };
        let set = &self.arguments.settings.set;
        for (key, value) in set {
            if !CHANGEABLE.contains(&key.replace('_', "-").as_str()) {
                let may = CHANGEABLE.join(", ");
                return Err(Failure::Usage(format!(
                    "--set {key}={value}: a run that goes on may only change {may}"
                )));
            }
        }
        // Settings of another system are unknown fields, and no setting is at fault.
        let config: Configuration<S::Config> = settings::read(Some(&run.config()), set)
            .map_err(|error| of_another_system::<S>(&run, path).unwrap_or_else(|| error.into()))?;
        if let Some(seed) = self.global.seed.filter(|&seed| seed != config.train.seed) {
            let text = format!("--seed {seed}: the run began with {}", config.train.seed);
            return Err(Failure::Usage(text));
        }
        let data = self.arguments.data.clone().or_else(|| RunMetadata::of(path).data);
        Ok(Prepared { run: Some(run), config, data })
    }

    /// Trains, and shows how it goes. Beside what came of it what a step's communication was in the mean.
    fn watched<S: Predictor>(
        &self,
        job: &Job<'_, S>,
        interrupt: &Interrupt,
    ) -> Result<(Outcome<S>, Option<Communication>), Failure> {
        let (console, called) = (self.console, self.called());
        let shown = console.unlogged();
        let progress = Progress::new(shown, "train");
        let (mut scores, mut pace, mut cost) = (String::new(), Pace::default(), Cost::default());
        let bar = |event: &Event| match event {
            Event::Started { total, done, facts, .. } => {
                let [trainable, steps_per_epoch] =
                    ["trainable", "steps_per_epoch"].map(|name| facts.get(name).unwrap_or(0.0));
                progress.set(*done as usize, *total as usize);
                if let Some(text) = over(*done, *total, &job.config.train) {
                    shown.warn(text);
                    return;
                }
                let from = if *done > 0 { format!(", from step {done} on") } else { String::new() };
                shown.remark(format_args!(
                    "training {}, {called}: {trainable} numbers, {} of {}, \
                         {steps_per_epoch} an epoch{from}\n{}",
                    S::NAME,
                    counted(*total as usize, "step"),
                    counted(job.config.train.batch * job.config.train.accumulate, "sample"),
                    circumstances(job)
                ));
                pace.begin(*done);
            }
            Event::Step(step) => {
                cost.add(step);
                progress.set(step.step as usize, step.total as usize);
                let terms = named(step.terms.iter().copied());
                progress.say(&format!("loss {:.4} ={terms}{scores}", step.loss));
                if let Some(text) = pace.told(step.step, step.total) {
                    shown.remark(text);
                }
            }
            Event::Evaluated { metrics, .. } => {
                scores = format!(";{}", named(metrics.iter().map(|m| (&*m.name, m.value))));
            }
            Event::Inherited(inherited) => {
                shown.remark(format_args!(
                    "taken from there: {}",
                    counted(inherited.taken, "array")
                ));
                inherited.remarks().into_iter().for_each(|text| shown.warn(text));
            }
            Event::Skipped { step, loss, average } => {
                shown.warn(format_args!(
                    "step {step} is left out: its loss {loss:.4} leapt from {average:.4}"
                ));
            }
            Event::Warned { text } => shown.warn(text),
            _ => {}
        };
        let outcome = train_among(job, self.communicator, &mut console.watch(interrupt, bar));
        let outcome = outcome.map_err(|error| match error {
            TrainError::Config(_) | TrainError::NoSuchMetric { .. } => {
                Failure::Usage(error.to_string())
            }
            TrainError::Checkpoint(CheckpointError::Save { .. }) => Failure::other(error),
            TrainError::Data(_) | TrainError::Checkpoint(_) => Failure::input(error),
            TrainError::Run(error) => failed(error),
            error => Failure::other(error),
        })?;
        Ok((outcome, cost.mean()))
    }
}

/// What there is to say of a training that goes on and has nothing to do.
fn over(done: u64, total: u64, train: &TrainConfig) -> Option<String> {
    if done < total || done == 0 {
        return None;
    }
    let steps = counted(done as usize, "step");
    let most = train.max_steps.map_or_else(String::new, |most| format!(" and max-steps = {most}"));
    let place = if done > total {
        format!("beyond the {total} that epochs = {}{most} ask for", train.epochs)
    } else {
        format!("the last that epochs = {}{most} ask for", train.epochs)
    };
    Some(format!(
        "nothing is trained: the run has taken {steps} already, {place}; --set epochs=N, or --set max-steps=N, lets it go on"
    ))
}

/// What communication cost so far.
#[derive(Debug, Default)]
struct Cost {
    steps: u64,
    sum: Communication,
}

impl Cost {
    fn add(&mut self, step: &Step) {
        let told = step.training.and_then(|training| training.communication);
        if let Some(Communication { bytes, seconds, waiting }) = told {
            self.steps += 1;
            self.sum.bytes += bytes;
            self.sum.seconds += seconds;
            self.sum.waiting += waiting;
        }
    }

    /// Of a step.
    fn mean(&self) -> Option<Communication> {
        let Communication { bytes, seconds, waiting } = self.sum;
        let steps = self.steps as f64;
        (self.steps > 0).then(|| Communication {
            bytes: bytes / self.steps,
            seconds: seconds / steps,
            waiting: waiting / steps,
        })
    }
}

/// What a training is given and where it goes, a line each.
fn circumstances<S: Predictor>(job: &Job<'_, S>) -> String {
    let data = match job.provenance.data.as_str() {
        "" => format!("made by the system, seed {}", job.config.train.seed),
        path => path.to_owned(),
    };
    let parts = S::data_summary(job.data).map(|parts| ("parts", parts.to_string()));
    let rows = [("input", S::input(&job.config.system)), ("data", data)];
    let run = ("run", job.run.path().display().to_string());
    table(rows.into_iter().chain(parts).chain([run])).trim_end().to_owned()
}

/// How fast the steps go.
#[derive(Debug, Default)]
struct Pace {
    begun: Option<(Instant, u64)>,
    told: bool,
}

impl Pace {
    fn begin(&mut self, done: u64) {
        self.begun = Some((Instant::now(), done));
    }

    /// Once, when it is known and much is left: how long it will take.
    fn told(&mut self, step: u64, total: u64) -> Option<String> {
        let (begun, from) = self.begun.filter(|_| !self.told)?;
        let (steps, spent) = (step.saturating_sub(from), begun.elapsed());
        if steps < PACE_KNOWN.0 || spent < PACE_KNOWN.1 {
            return None;
        }
        self.told = true;
        let each = spent.as_secs_f64() / steps as f64;
        let left = Duration::try_from_secs_f64(each * total.saturating_sub(step) as f64).ok()?;
        let text = || format!("a step takes {each:.2} s: about {} are left", spoken(left));
        (left > 2 * PACE_KNOWN.1).then(text)
    }
}

/// Names and values in one line.
fn named<'a>(values: impl Iterator<Item = (&'a str, f64)>) -> String {
    values.fold(String::new(), |text, (name, value)| text + &format!(" {name} {value:.4}"))
}

fn failed(error: RunError) -> Failure {
    match error {
        RunError::NoRun { .. } | RunError::Lost { .. } | RunError::Log { .. } => {
            Failure::input(error)
        }
        error => Failure::other(error),
    }
}

fn describe(trained: &Trained<'_>) -> String {
    let scores = trained.metrics.iter().map(|(name, value)| (&**name, format!("{value:.4}")));
    let mut rows: Vec<(&str, String)> = scores.collect();
    let unscored = trained.metrics.is_empty();
    let scored = if unscored { "not yet".to_owned() } else { Subset::Validation.to_string() };
    rows.push(("scored", scored));
    if let Some(best) = trained.best {
        rows.push(("best", format!("{:.4} at step {}", best.value, best.step)));
    }
    let memory = memory::said(trained.peak_memory);
    rows.push(("steps", format!("{} in {:.1} s{memory}", trained.steps, trained.seconds)));
    if let Some(Communication { bytes, seconds, waiting }) = trained.communication {
        let (megabytes, exchanged) = (bytes as f64 / 1e6, 1e3 * seconds);
        let (processes, waited) = (trained.processes, 1e3 * waiting);
        rows.push((
            "processes",
            format!(
                "{processes}; the first sent {megabytes:.2} MB a step, which took {exchanged:.1} ms, and waited {waited:.1} ms"
            ),
        ));
    }
    rows.push(("run", trained.run.display().to_string()));
    table(rows)
}
