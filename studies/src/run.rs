//! The course of a study: job after job, seed after seed.

use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

use serde::Serialize;
use serde_json::json;

use super::digest::Digest;
use super::error::{ReproduceError, StudyError};
use super::markdown::markdown;
use super::order::Order;
use super::page::page;
use super::store::{Kept, Store};
use super::study::{Claim, Plan, Study};
use super::table::Tables;
use super::work::{Tick, Work};

/// What happened, in the order in which it does.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Event {
    /// Everything is ready.
    Started {
        /// Jobs of all seeds.
        jobs: usize,
        /// Those of them that were finished before.
        kept: usize,
    },
    /// A job goes on.
    Working {
        /// Jobs finished, the kept ones included.
        finished: usize,
        /// Jobs of all seeds.
        jobs: usize,
        /// The job.
        job: String,
        /// Its seed.
        seed: u64,
        /// How far it is.
        tick: Tick,
    },
    /// A job is done and kept, and the tables have it.
    Finished {
        /// Jobs finished, the kept ones included.
        finished: usize,
        /// The job.
        job: String,
        /// Its seed.
        seed: u64,
        /// What it took.
        seconds: f64,
    },
}

/// What came of a study.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reproduced {
    /// The tables, as far as they came.
    pub tables: Tables,
    /// What holds; empty until every job is done.
    pub claims: Vec<Claim>,
    /// Whether it was stopped before its end.
    pub interrupted: bool,
    /// What the jobs took that were done now.
    pub seconds: f64,
}

/// Makes a study's tables in a folder, and goes on with what is there.
///
/// Finished jobs are kept and not done again; the tables are written anew after each. `watch` is
/// asked again and again; when it answers [`ControlFlow::Break`], the job at hand stops and is gone on with
/// the next time.
///
/// # Errors
/// If the folder holds results of something else, a job fails, or a file cannot be read or written.
///
/// # Panics
/// If the study names a job with anything but small letters, digits and dashes.
pub fn reproduce(
    study: &dyn Study,
    out: &Path,
    order: &Order<'_>,
    watch: &mut dyn FnMut(Event) -> ControlFlow<()>,
) -> Result<Reproduced, ReproduceError> {
    let Plan { jobs, settings } = study.plan(order.scale);
    let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    assert!(jobs.iter().all(|id| id.chars().all(plain)), "reproduce: names of jobs: {jobs:?}");
    let store = Store::open(out, &identity(study, &settings, order), order.force)?;
    let kept = |job: &String| order.seeds.iter().map(|&seed| store.kept(job, seed)).collect();
    let results = jobs.iter().map(kept).collect::<Result<_, _>>()?;
    StudyRunner { study, order, store, jobs, results }.run(watch)
}

/// What all results of a folder have in common.
fn identity(study: &dyn Study, settings: &str, order: &Order<'_>) -> String {
    let data = order.data.map_or_else(|| "its own".to_owned(), |path| path.display().to_string());
    let (name, scale) = (study.name(), order.scale.name());
    format!("study = {name}\nscale = {scale}\ndata = {data}\n{}\n", settings.trim_end())
}

struct StudyRunner<'a> {
    study: &'a dyn Study,
    order: &'a Order<'a>,
    store: Store,
    jobs: Vec<String>,
    /// By job and seed.
    results: Vec<Vec<Option<Kept>>>,
}

impl StudyRunner<'_> {
    fn finished(&self) -> usize {
        self.results.iter().flatten().flatten().count()
    }

    fn run(
        &mut self,
        watch: &mut dyn FnMut(Event) -> ControlFlow<()>,
    ) -> Result<Reproduced, ReproduceError> {
        let start = Instant::now();
        let (jobs, kept) = (self.jobs.len() * self.order.seeds.len(), self.finished());
        let mut stopped = watch(Event::Started { jobs, kept }) == ControlFlow::Break(());
        'all: for (at, &seed) in self.order.seeds.iter().enumerate() {
            for (index, job) in self.jobs.clone().into_iter().enumerate() {
                if self.results[index][at].is_some() {
                    continue;
                }
                if stopped {
                    break 'all;
                }
                let finished = self.finished();
                let began = Instant::now();
                let folder = self.store.work(&job, seed);
                let work = Work {
                    id: job.clone(),
                    seed,
                    scale: self.order.scale,
                    folder: &folder,
                    data: self.order.data,
                    provenance: &self.order.provenance,
                };
                let mut tell = |tick| {
                    let job = job.clone();
                    let flow = watch(Event::Working { finished, jobs, job, seed, tick });
                    stopped |= flow == ControlFlow::Break(());
                    flow
                };
                let rows = match self.study.run(&work, &mut tell) {
                    Ok(rows) => rows,
                    Err(StudyError::Stopped) => {
                        stopped = true;
                        break 'all;
                    }
                    Err(error) => return Err(ReproduceError::Job { job, seed, error }),
                };
                let seconds = began.elapsed().as_secs_f64();
                let kept = self.store.keep((&job, seed), rows, seconds, &self.order.provenance)?;
                self.results[index][at] = Some(kept);
                self.digest()?;
                let finished = finished + 1;
                stopped |= watch(Event::Finished { finished, job, seed, seconds })
                    == ControlFlow::Break(());
            }
        }
        let (tables, claims) = self.digest()?;
        let interrupted = stopped && self.finished() < jobs;
        Ok(Reproduced { tables, claims, interrupted, seconds: start.elapsed().as_secs_f64() })
    }

    /// Writes the tables as they are now.
    fn digest(&self) -> Result<(Tables, Vec<Claim>), ReproduceError> {
        let kept: Vec<Kept> = self.results.iter().flatten().flatten().cloned().collect();
        let tables = Tables::of(&kept);
        let left = self.jobs.len() * self.order.seeds.len() - kept.len();
        let judged = left == 0;
        let claims = if judged { self.study.claims(&tables, self.order.scale) } else { Vec::new() };
        let Self { study, order, store, .. } = self;
        let (kept, study) = (&kept[..], *study);
        let digest = Digest { study, order, store, kept, tables: &tables, claims: &claims, left };
        store.write("table.md", markdown(&digest).as_bytes())?;
        store.write("report.html", page(&digest).as_bytes())?;
        let facts: serde_json::Map<String, serde_json::Value> =
            digest.facts().into_iter().map(|(name, fact)| (name.to_owned(), fact.into())).collect();
        let json = json!({
            "study": study.name(),
            "made": facts,
            "jobs_left": left,
            "tables": &tables,
            "claims": &claims,
        });
        let json = serde_json::to_string_pretty(&json).expect("plain figures serialise");
        store.write("results.json", (json + "\n").as_bytes())?;
        Ok((tables, claims))
    }
}
