//! What a run leaves in its folder while it goes.
//!
//! The log is what a run cannot go on without. All else is optional: what cannot be written, on a full disk say, is a
//! warning, once, and the training goes on.

use std::collections::BTreeSet;
use std::time::{SystemTime, UNIX_EPOCH};

use mesh_core::encode_png;
use serde_json::json;

use super::config::Configuration;
use super::error::DataError;
use super::error::{RunError, TrainError};
use super::log::{History, Line, Log};
use super::page;
use super::progress::{Step, TrainingStep};
use super::run::{Provenance, RunFolder};
use super::system::{Metric, Shown, Summary, System};
use super::tensorboard::Events;
use crate::report::sheet;
use crate::settings::{Options, to_toml};

const TABLE: &str = "metrics.csv";
const PAGE: &str = "report.html";

/// The open files of a run.
#[derive(Debug)]
pub(super) struct Record<'a> {
    run: &'a RunFolder,
    log: Log,
    events: Option<Events>,
    /// The last samples; none where an earlier part of the run drew them.
    shown: Option<Shown>,
    /// Whether the table and the page say all that is in the log.
    digested: bool,
    /// What could not be written so far.
    failed: BTreeSet<&'static str>,
    warnings: Vec<String>,
}

/// What the header of a run says.
pub(super) struct Heading<'a, C> {
    pub(super) system: &'static str,
    pub(super) config: &'a Configuration<C>,
    pub(super) provenance: &'a Provenance,
    pub(super) summary: &'a Summary,
    pub(super) data_hash: u64,
    pub(super) steps_per_epoch: u64,
    pub(super) total: u64,
    pub(super) processes: usize,
}

impl<C: Options> Heading<'_, C> {
    fn facts(&self) -> serde_json::Value {
        let Provenance { version, commit, cpu, machine, command, data } = self.provenance;
        let config = to_toml(self.config);
        let config_hash = super::fingerprint::Fingerprint::new().with(config.as_bytes()).value();
        json!({
            "kind": "run",
            "schema": 1,
            "system": self.system,
            "version": version,
            "commit": commit,
            "cpu": cpu,
            "machine": machine,
            "threads": rayon::current_num_threads(),
            "processes": self.processes,
            "command": command,
            "data": data,
            "data_hash": format!("{:016x}", self.data_hash),
            "seed": self.config.train.seed,
            "config_hash": format!("{config_hash:016x}"),
            "trainable": self.summary.trainable,
            "frozen": self.summary.frozen,
            "steps_per_epoch": self.steps_per_epoch,
            "total": self.total,
            "unix_seconds": wall_time() as u64,
        })
    }
}

pub(super) fn wall_time() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |t| t.as_secs_f64())
}

impl<'a> Record<'a> {
    /// Begins the files of a new run. The configuration comes last: a folder that has it has them all.
    pub(super) fn begin<C: Options>(
        run: &'a RunFolder,
        heading: &Heading<'_, C>,
    ) -> Result<Self, RunError> {
        let header = heading.facts();
        let provenance = serde_json::to_string_pretty(&header).expect("plain facts serialise");
        run.write("provenance.json", (provenance + "\n").as_bytes())?;
        let log = Log::begin(run.log(), &header)?;
        run.write("config.toml", to_toml(heading.config).as_bytes())?;
        Ok(Self::open(run, log, heading.config.train.tensorboard, 0))
    }

    /// Goes on with the files of a run, from a checkpoint on, and says what is odd about it.
    pub(super) fn resume<C: Options>(
        run: &'a RunFolder,
        heading: &Heading<'_, C>,
        step: u64,
        pending: bool,
    ) -> Result<Self, RunError> {
        let (then, kept) = History::kept(&run.log(), step, pending)?;
        let now = heading.facts();
        if now["data_hash"] != then["data_hash"] {
            return Err(RunError::OtherData { path: run.path().to_owned() });
        }
        let warnings = ["version", "commit"]
            .into_iter()
            .filter(|&field| now[field] != then[field])
            .map(|field| {
                format!(
                    "`{field}` is {}, and was {} when the run began: it goes on differently",
                    now[field], then[field]
                )
            })
            .collect();
        let config = to_toml(heading.config);
        let digested = is_digested(run, &config);
        let mut log = Log::resume(run.log(), kept)?;
        log.append(&Line::Resumed {
            step,
            unix_seconds: wall_time() as u64,
            threads: rayon::current_num_threads(),
            processes: heading.processes,
        })?;
        run.write("config.toml", config.as_bytes())?;
        let shown = (!run.path().join("samples").is_dir()).then(Shown::default);
        let record = Self::open(run, log, heading.config.train.tensorboard, step);
        Ok(Self { shown, digested, warnings, ..record })
    }

    fn open(run: &'a RunFolder, log: Log, tensorboard: bool, step: u64) -> Self {
        let mut record = Self {
            run,
            log,
            events: None,
            shown: Some(Shown::default()),
            digested: false,
            failed: BTreeSet::new(),
            warnings: Vec::new(),
        };
        if tensorboard {
            let events = Events::create(&run.path().join("tensorboard"), wall_time(), step);
            record.events = record.optional("the file for TensorBoard", events);
        }
        record
    }

    /// What a user should know, said once.
    pub(super) fn warnings(&mut self) -> Vec<String> {
        std::mem::take(&mut self.warnings)
    }

    /// Brings the log to the disk: before a checkpoint is, so that none is ahead of it.
    pub(super) fn sync(&mut self) -> Result<(), RunError> {
        self.log.sync()
    }

    /// A result without which the training goes on.
    fn optional<T>(&mut self, what: &'static str, result: Result<T, RunError>) -> Option<T> {
        match result {
            Ok(value) => Some(value),
            Err(error) => {
                if self.failed.insert(what) {
                    let text = format!("{what} cannot be written: {error}; the training goes on");
                    self.warnings.push(text);
                }
                None
            }
        }
    }

    /// Writes to TensorBoard's file. What follows a record that was cut off cannot be read: it ends with that.
    fn tensorboard(&mut self, write: impl FnOnce(&mut Events) -> Result<(), RunError>) {
        if let Some(mut events) = self.events.take() {
            let written = write(&mut events);
            let sound = self.optional("the file for TensorBoard", written).is_some();
            self.events = sound.then_some(events);
        }
    }

    /// A line of the log. One that does not fit waits until the next, at the latest until the next checkpoint.
    fn log(&mut self, line: &Line) {
        self.digested = false;
        let appended = self.log.append(line);
        self.optional("the log", appended);
    }

    pub(super) fn step(&mut self, step: &Step, training: TrainingStep) {
        let TrainingStep { epoch, learning_rate, gradient_norm, seconds, communication } = training;
        let terms: Vec<(String, f64)> =
            step.terms.iter().map(|&(name, value)| (name.to_owned(), value)).collect();
        self.tensorboard(|events| {
            let mut values = vec![
                ("loss".to_owned(), step.loss),
                ("learning_rate".to_owned(), learning_rate),
                ("gradient_norm".to_owned(), gradient_norm),
            ];
            values.extend(terms.iter().map(|(name, value)| (format!("term/{name}"), *value)));
            events.scalars(wall_time(), step.step, &values)
        });
        self.log(&Line::Step {
            step: step.step,
            epoch,
            loss: step.loss,
            terms,
            learning_rate,
            gradient_norm,
            seconds,
            communication,
        });
    }

    pub(super) fn skipped(&mut self, [step, epoch]: [u64; 2], loss: f64, average: f64) {
        self.log(&Line::Skipped { step, epoch, loss, average });
    }

    pub(super) fn validation(&mut self, [step, epoch]: [u64; 2], metrics: &[Metric], best: bool) {
        let metrics: Vec<(String, f64)> =
            metrics.iter().map(|metric| (metric.name.clone(), metric.value)).collect();
        self.tensorboard(|events| {
            let values: Vec<_> = metrics
                .iter()
                .map(|(name, value)| (format!("validation/{name}"), *value))
                .collect();
            events.scalars(wall_time(), step, &values)
        });
        self.log(&Line::Validation { step, epoch, metrics, best });
    }

    /// Keeps a sheet of samples of this epoch.
    pub(super) fn samples(&mut self, [step, epoch]: [u64; 2], shown: Shown) {
        if let Some(sheet) = sheet(&shown.views) {
            let png = encode_png(&sheet);
            let written = self.run.write_derived(&format!("samples/epoch-{epoch:05}.png"), &png);
            self.optional("the sheet of samples", written);
            self.tensorboard(|events| {
                let size = [sheet.height, sheet.width];
                events.picture(wall_time(), step, "samples", size, &png)
            });
        }
        self.shown = Some(shown);
    }

    /// Writes the table and the page, from the log, if they do not say all of it. The page shows the last samples; those
    /// that an earlier part of the run drew are drawn again, by `show`.
    pub(super) fn digest<S: System>(
        &mut self,
        config: &Configuration<S::Config>,
        show: impl FnOnce() -> Result<Shown, DataError>,
    ) -> Result<(), TrainError> {
        if self.digested {
            return Ok(());
        }
        let shown = match self.shown.take() {
            Some(shown) => shown,
            None => show()?,
        };
        let history = History::read(&self.run.log())?;
        let table = self.run.write_derived(TABLE, history.to_csv().as_bytes());
        let table = self.optional("the table", table);
        let page = page::report(S::NAME, &to_toml(config), &history, &shown).to_html();
        let page = self.run.write_derived(PAGE, page.as_bytes());
        let page = self.optional("the report", page);
        self.digested = table.is_some() && page.is_some();
        self.shown = Some(shown);
        Ok(())
    }
}

/// Whether a run's table and page are whole, and say all that is in its log and this configuration. The page is written
/// behind the table.
fn is_digested(run: &RunFolder, config: &str) -> bool {
    let read = |path| std::fs::read(path).unwrap_or_default();
    let (table, page) = (read(run.path().join(TABLE)), read(run.path().join(PAGE)));
    read(run.config()) == config.as_bytes()
        && page.trim_ascii_end().ends_with(b"</html>")
        && History::read(&run.log()).is_ok_and(|log| log.to_csv().as_bytes() == table)
}
