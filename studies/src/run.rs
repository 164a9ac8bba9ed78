//! The course of a study: job after job, seed after seed.

use std::path::Path;
use std::time::Instant;

use serde::{Serialize, Serializer};
use train::progress::{Ended, Event, Facts, Watch};

use super::claim::Claim;
use super::error::{ReproduceError, StudyError};
use super::floor::Check;
use super::order::Order;
use super::output::write_all;
use super::pages::Pages;
use super::plan::{Plan, PlannedJob};
use super::results::Results;
use super::scale::Scale;
use super::store::{Kept, Store, result};
use super::study::Study;
use super::table::Tables;
use super::verdict::Judged;
use super::work::Work;

/// What came of a study.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reproduced {
    /// How much was done of what is in the tables.
    pub scale: Scale,
    /// The tables, as far as they came.
    pub tables: Tables,
    /// What holds; empty until every job is done, and in the quick form.
    pub claims: Vec<Judged>,
    /// What the quick form reaches; empty in the others.
    pub checks: Vec<Check>,
    /// Jobs that five seeds instead of three may be expected to decide something about.
    pub close: Vec<String>,
    /// Whether all its jobs are done; in JSON `interrupted`, whether they are not.
    #[serde(rename = "interrupted", serialize_with = "is_cancelled")]
    pub ended: Ended,
    /// How many jobs are not done: another share's, those of other rows, or those after an interrupt.
    pub left: usize,
    /// What the jobs took that were done now.
    pub seconds: f64,
}

impl Reproduced {
    pub(crate) fn of(pages: Pages<'_>, ended: Ended, seconds: f64) -> Self {
        let close = pages.close();
        let (scale, left) = (pages.results.scale, pages.results.left);
        let Pages { tables, claims, checks, .. } = pages;
        Self { scale, tables, claims, checks, close, ended, left, seconds }
    }
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde calls it so")]
fn is_cancelled<S: Serializer>(ended: &Ended, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_bool(ended.is_cancelled())
}

/// Makes a study's tables in a folder, and goes on with what is there.
///
/// Finished jobs are kept and not done again; the tables are written anew after each. `watch` hears how many are done, and
/// [within](Event::Within) them what each job tells, its trainings above all. Once it is [cancelled](train::progress::Cancel), the job at
/// hand ends, after a checkpoint where it trains, and is gone on with the next time.
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
    watch: &mut Watch<'_>,
) -> Result<Reproduced, ReproduceError> {
    let plan = study.plan(order.scale);
    let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    assert!(
        plan.ids().all(|id| id.chars().all(plain)),
        "reproduce: names of jobs: {:?}",
        plan.jobs
    );
    let known = |job: &&String| plan.ids().any(|id| id == job.as_str());
    if let Some(job) = order.only.iter().find(|job| !known(job)) {
        let known = plan.ids().collect::<Vec<_>>().join(", ");
        return Err(ReproduceError::UnknownJob { job: job.clone(), known });
    }
    let store = Store::open(out, &identity(study, &plan.settings, order), order.force)?;
    let kept = store.kept(plan.ids())?;
    for kept in &kept {
        let ours = [&order.provenance.version, &order.provenance.commit];
        same_build(&store.root().join(result(&kept.job, kept.seed)), kept, ours)?;
    }
    let claims = study.claims();
    StudyRunner { study, order, store, plan, claims, kept }.run(watch)
}

/// What all results of a folder have in common.
pub(crate) fn identity(study: &dyn Study, settings: &str, order: &Order<'_>) -> String {
    let (name, scale, data) = (study.name(), order.scale.name(), order.data_name());
    format!("study = {name}\nscale = {scale}\ndata = {data}\n{}\n", settings.trim_end())
}

/// That a result was made by the build that made the others: its version and its commit.
pub(crate) fn same_build(
    path: &Path,
    kept: &Kept,
    [version, commit]: [&String; 2],
) -> Result<(), ReproduceError> {
    for (field, found, expected) in
        [("version", &kept.version, version), ("commit", &kept.commit, commit)]
    {
        if found != expected {
            let (path, found, expected) = (path.to_owned(), found.clone(), expected.clone());
            return Err(ReproduceError::OtherBuild { path, field, found, expected });
        }
    }
    Ok(())
}

struct StudyRunner<'a> {
    study: &'a dyn Study,
    order: &'a Order<'a>,
    store: Store,
    plan: Plan,
    claims: Vec<Claim>,
    /// In the order of the jobs, then of the seeds.
    kept: Vec<Kept>,
}

impl StudyRunner<'_> {
    fn has(&self, job: &str, seed: u64) -> bool {
        self.kept.iter().any(|kept| kept.job == job && kept.seed == seed)
    }

    /// All jobs with their seeds, seed by seed, so that every row has its first before one has its second.
    fn wanted(&self) -> Vec<(String, u64)> {
        let of = |job: &PlannedJob| -> Vec<u64> {
            let claimed = job.is_claimed(&self.claims);
            if self.order.asks_for(&job.id) {
                return self.order.seeds.of(self.order.scale, claimed);
            }
            // What is not asked for now is still to be done as far as nothing is there.
            let none = self.kept.iter().all(|kept| kept.job != job.id);
            if none { super::Seeds::default().of(self.order.scale, claimed) } else { Vec::new() }
        };
        let all: Vec<(&String, Vec<u64>)> =
            self.plan.jobs.iter().map(|job| (&job.id, of(job))).collect();
        let most = all.iter().map(|(_, seeds)| seeds.len()).max().unwrap_or(0);
        let nth =
            |k: usize| all.iter().filter_map(move |(job, s)| Some(((*job).clone(), *s.get(k)?)));
        (0..most).flat_map(nth).collect()
    }

    fn run(&mut self, watch: &mut Watch<'_>) -> Result<Reproduced, ReproduceError> {
        let start = Instant::now();
        // Counted before it is parted: what is there already moves no job to another share.
        let asked = self.wanted().into_iter().filter(|(job, _)| self.order.asks_for(job));
        let own = asked.enumerate().filter(|(k, _)| self.order.shard.has(*k));
        let asked: Vec<(String, u64)> = own.map(|(_, asked)| asked).collect();
        let total = asked.len() as u64;
        let mut done = asked.iter().filter(|(job, seed)| self.has(job, *seed)).count() as u64;
        let facts = Facts::default();
        watch.tell(&Event::Started { job: "reproduce", total, done, facts });
        for (job, seed) in asked {
            if self.has(&job, seed) {
                continue;
            }
            if watch.is_cancelled() {
                break;
            }
            let Some(seconds) = self.job(&job, seed, &mut watch.within(&job, Some(seed)))? else {
                break;
            };
            done += 1;
            self.write()?;
            let text = format!("{job}, seed {seed}: done in {seconds:.1} s");
            watch.tell(&Event::Progress { done, total, text });
        }
        self.write()?;
        let results = self.results();
        let pages = Pages::of(self.study, &results, self.store.root());
        let (ended, seconds) = (Ended::early(done < total), start.elapsed().as_secs_f64());
        watch.tell(&Event::Finished { ended, done, seconds });
        Ok(Reproduced::of(pages, ended, seconds))
    }

    /// Does one job and keeps it; says what it took, or nothing if it was cancelled.
    fn job(
        &mut self,
        job: &str,
        seed: u64,
        watch: &mut Watch<'_>,
    ) -> Result<Option<f64>, ReproduceError> {
        let began = Instant::now();
        let folder = self.store.work(job, seed);
        let work = Work {
            id: job.to_owned(),
            seed,
            scale: self.order.scale,
            folder: &folder,
            data: self.order.data,
            provenance: &self.order.provenance,
        };
        let rows = match self.study.run(&work, watch) {
            Ok(rows) => rows,
            Err(StudyError::Cancelled) => return Ok(None),
            Err(error) => return Err(ReproduceError::Job { job: job.to_owned(), seed, error }),
        };
        let seconds = began.elapsed().as_secs_f64();
        let kept = self.store.keep((job, seed), rows, seconds, &self.order.provenance)?;
        self.kept.push(kept);
        let place = |id: &str| self.plan.ids().position(|other| other == id);
        let mut sorted = std::mem::take(&mut self.kept);
        sorted.sort_by_key(|kept| (place(&kept.job), kept.seed));
        self.kept = sorted;
        Ok(Some(seconds))
    }

    fn results(&self) -> Results {
        let missing = |(job, seed): &&(String, u64)| !self.has(job, *seed);
        let left = self.wanted().iter().filter(missing).count();
        Results::of(self.study.name(), &self.plan.settings, self.order, &self.kept, left)
    }

    /// Writes the tables as they are now.
    fn write(&self) -> Result<(), ReproduceError> {
        let results = self.results();
        write_all(&Pages::of(self.study, &results, self.store.root()), self.store.root())
    }
}
