//! What a run leaves in its folder while it goes.

use std::time::{SystemTime, UNIX_EPOCH};

use mesh_core::encode_png;
use serde::Serialize;
use serde_json::json;

use super::config::Configuration;
use super::error::RunError;
use super::event::Step;
use super::log::{History, Line, Log};
use super::page;
use super::run::{Provenance, RunFolder};
use super::system::{Metric, Shown, Summary, System};
use super::tensorboard::Events;
use crate::report::sheet;
use crate::settings::to_toml;

/// The open files of a run.
#[derive(Debug)]
pub(super) struct Record<'a> {
    run: &'a RunFolder,
    log: Log,
    events: Option<Events>,
    shown: Shown,
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
}

impl<C: Serialize> Heading<'_, C> {
    fn facts(&self) -> serde_json::Value {
        let Provenance { version, commit, cpu, machine, command, data } = self.provenance;
        let config = to_toml(self.config);
        let config_hash = super::run::Fingerprint::new().with(config.as_bytes()).value();
        json!({
            "kind": "run",
            "schema": 1,
            "system": self.system,
            "version": version,
            "commit": commit,
            "cpu": cpu,
            "machine": machine,
            "threads": rayon::current_num_threads(),
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
    /// Begins the files of a new run.
    pub(super) fn begin<C: Serialize>(
        run: &'a RunFolder,
        heading: &Heading<'_, C>,
    ) -> Result<Self, RunError> {
        let header = heading.facts();
        let provenance = serde_json::to_string_pretty(&header).expect("plain facts serialise");
        run.write("config.toml", to_toml(heading.config).as_bytes())?;
        run.write("provenance.json", (provenance + "\n").as_bytes())?;
        let history = History { header, lines: Vec::new() };
        Self::open(run, heading.config.train.tensorboard, &history, 0)
    }

    /// Goes on with the files of a run, from a checkpoint on. Returns what is odd about it.
    pub(super) fn resume<C: Serialize>(
        run: &'a RunFolder,
        heading: &Heading<'_, C>,
        step: u64,
        pending: bool,
    ) -> Result<(Self, Vec<String>), RunError> {
        let mut history = History::read(&run.log())?;
        history.rewind(step, pending);
        let (now, then) = (heading.facts(), &history.header);
        let warnings = ["data_hash", "version", "commit"]
            .into_iter()
            .filter(|&field| now[field] != then[field])
            .map(|field| {
                format!(
                    "`{field}` is {}, and was {} when the run began: it goes on differently",
                    now[field], then[field]
                )
            })
            .collect();
        history.lines.push(Line::Resumed {
            step,
            unix_seconds: wall_time() as u64,
            threads: rayon::current_num_threads(),
        });
        run.write("config.toml", to_toml(heading.config).as_bytes())?;
        Ok((Self::open(run, heading.config.train.tensorboard, &history, step)?, warnings))
    }

    fn open(
        run: &'a RunFolder,
        tensorboard: bool,
        history: &History,
        step: u64,
    ) -> Result<Self, RunError> {
        let log = Log::open(run.log(), history)?;
        let folder = run.path().join("tensorboard");
        let events = tensorboard.then(|| Events::create(&folder, wall_time(), step)).transpose()?;
        Ok(Self { run, log, events, shown: Shown::default() })
    }

    pub(super) fn step(&mut self, step: &Step) -> Result<(), RunError> {
        let terms: Vec<(String, f64)> =
            step.terms.iter().map(|&(name, value)| (name.to_owned(), value)).collect();
        if let Some(events) = &mut self.events {
            let mut values = vec![
                ("loss".to_owned(), step.loss),
                ("learning_rate".to_owned(), step.learning_rate),
                ("gradient_norm".to_owned(), step.gradient_norm),
            ];
            values.extend(terms.iter().map(|(name, value)| (format!("term/{name}"), *value)));
            events.scalars(wall_time(), step.step, &values)?;
        }
        self.log.append(&Line::Step {
            step: step.step,
            epoch: step.epoch,
            loss: step.loss,
            terms,
            learning_rate: step.learning_rate,
            gradient_norm: step.gradient_norm,
            seconds: step.seconds,
        })
    }

    pub(super) fn skipped(
        &mut self,
        [step, epoch]: [u64; 2],
        loss: f64,
        average: f64,
    ) -> Result<(), RunError> {
        self.log.append(&Line::Skipped { step, epoch, loss, average })
    }

    pub(super) fn evaluation(
        &mut self,
        [step, epoch]: [u64; 2],
        metrics: &[Metric],
        best: bool,
    ) -> Result<(), RunError> {
        let metrics: Vec<(String, f64)> =
            metrics.iter().map(|metric| (metric.name.clone(), metric.value)).collect();
        if let Some(events) = &mut self.events {
            let values: Vec<_> =
                metrics.iter().map(|(name, value)| (format!("score/{name}"), *value)).collect();
            events.scalars(wall_time(), step, &values)?;
        }
        self.log.append(&Line::Evaluation { step, epoch, metrics, best })
    }

    /// Keeps a sheet of samples of this epoch.
    pub(super) fn samples(
        &mut self,
        [step, epoch]: [u64; 2],
        shown: Shown,
    ) -> Result<(), RunError> {
        if let Some(sheet) = sheet(&shown.views) {
            let png = encode_png(&sheet);
            self.run.write(&format!("samples/epoch-{epoch:05}.png"), &png)?;
            if let Some(events) = &mut self.events {
                let size = [sheet.height, sheet.width];
                events.picture(wall_time(), step, "samples", size, &png)?;
            }
        }
        self.shown = shown;
        Ok(())
    }

    /// Writes the table and the page, from the log.
    pub(super) fn digest<S: System>(
        &self,
        config: &Configuration<S::Config>,
    ) -> Result<(), RunError> {
        let history = History::read(&self.run.log())?;
        self.run.write("metrics.csv", history.to_csv().as_bytes())?;
        let page = page::report(S::NAME, &to_toml(config), &history, &self.shown).to_html();
        self.run.write("report.html", page.as_bytes())
    }
}
