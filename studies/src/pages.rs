//! What becomes of results: tables, verdicts, and how all was made.

use std::collections::BTreeSet;
use std::path::Path;

use crate::claim::Claim;
use crate::floor::{Check, Floor};
use crate::results::{JobRecord, Results};
use crate::scale::Scale;
use crate::study::Study;
use crate::table::Tables;
use crate::verdict::{Judged, Verdict, judge};

/// Everything that the pages say, all of it from the results.
pub(crate) struct Pages<'a> {
    pub(crate) study: &'a dyn Study,
    pub(crate) results: &'a Results,
    pub(crate) tables: Tables,
    pub(crate) claims: Vec<Judged>,
    pub(crate) checks: Vec<Check>,
    /// Where the images are.
    pub(crate) root: &'a Path,
}

impl<'a> Pages<'a> {
    /// Tables and verdicts; these only where every job is done.
    pub(crate) fn of(study: &'a dyn Study, results: &'a Results, root: &'a Path) -> Self {
        let tables = Tables::of(results);
        let (mut claims, mut checks) = (Vec::new(), Vec::new());
        if results.left == 0 && results.scale == Scale::Quick {
            checks = study.floors().iter().flat_map(|floor: &Floor| floor.check(results)).collect();
        } else if results.left == 0 {
            claims = judge(&study.claims(), results);
        }
        Self { study, results, tables, claims, checks, root }
    }

    /// How the results were made: names and values.
    pub(crate) fn facts(&self) -> Vec<(&'static str, String)> {
        let results = self.results;
        let all = |value: &dyn Fn(&JobRecord) -> String| {
            let values: BTreeSet<String> = results.jobs.iter().map(value).collect();
            values.into_iter().filter(|v| !v.is_empty()).collect::<Vec<_>>().join(" and ")
        };
        let seeds: BTreeSet<u64> = results.jobs.iter().map(|job| job.seed).collect();
        let seeds: Vec<String> = seeds.iter().map(u64::to_string).collect();
        let seconds: f64 = results.jobs.iter().map(|job| job.seconds).sum();
        let data = if results.data == "its own" { String::new() } else { results.data.clone() };
        let facts = [
            ("command", results.command.clone()),
            ("scale", results.scale.name().to_owned()),
            ("seeds", seeds.join(", ")),
            ("data", data),
            ("cpu", all(&|job| job.cpu.clone())),
            ("machine", all(&|job| job.machine.clone())),
            ("threads", all(&|job| job.threads.to_string())),
            ("version", all(&|job| job.version.clone())),
            ("commit", all(&|job| job.commit.clone())),
            ("settings", results.settings.clone()),
            ("time", format!("{seconds:.0} s")),
        ];
        facts.into_iter().filter(|(_, value)| !value.is_empty()).collect()
    }

    /// The jobs that five seeds may decide something about, in the order of the plan.
    pub(crate) fn close(&self) -> Vec<String> {
        let close = |judged: &Judged| judged.verdict == Verdict::Undecided && judged.close;
        let texts: Vec<&str> =
            self.claims.iter().filter(|j| close(j)).map(|j| j.text.as_str()).collect();
        let claims: Vec<Claim> = self
            .study
            .claims()
            .into_iter()
            .filter(|claim| texts.contains(&claim.text.as_str()))
            .collect();
        let plan = self.study.plan(self.results.scale);
        let jobs = plan.jobs.into_iter().filter(|job| job.is_claimed(&claims));
        jobs.map(|job| job.id).collect()
    }
}
