//! What a study will take, before it begins.
//!
//! The seconds are those that rows took when they were made last, kept in `costs.txt`: a step of the training, and what a
//! job has to do beside it, which is making its data and scoring. Other machines and other settings take other times; a row that was
//! never made has none.

use std::fmt::Write as _;

use serde::Serialize;

use crate::order::Order;
use crate::results::Results;
use crate::study::Study;

const KNOWN: &str = include_str!("../costs.txt");

/// What a row will take.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Cost {
    /// Its job.
    pub job: String,
    /// With so many seeds.
    pub seeds: usize,
    /// Seconds with all of them; none where it was never made.
    pub seconds: Option<f64>,
}

/// What the jobs of a study will take, in their order.
pub fn costs(study: &dyn Study, order: &Order<'_>) -> Vec<Cost> {
    costs_by(KNOWN, study, order)
}

fn costs_by(known: &str, study: &dyn Study, order: &Order<'_>) -> Vec<Cost> {
    let claims = study.claims();
    let jobs = study.plan(order.scale).jobs.into_iter().filter(|job| order.asks_for(&job.id));
    jobs.map(|job| {
        let seeds = order.seeds.of(order.scale, job.is_claimed(&claims)).len();
        let one = known_of(known, study.name(), &job.id);
        let seconds = one.map(|[step, beside]| seeds as f64 * (step * job.length as f64 + beside));
        Cost { job: job.id, seeds, seconds }
    })
    .collect()
}

/// Seconds of a step, and beside the training.
fn known_of(known: &str, study: &str, job: &str) -> Option<[f64; 2]> {
    known.lines().find_map(|line| {
        let mut words = line.split_whitespace();
        let is = words.next() == Some(study) && words.next() == Some(job);
        let numbers = [words.next()?.parse().ok()?, words.next()?.parse().ok()?];
        is.then_some(numbers)
    })
}

/// The lines that results give for `costs.txt`, in the order of the jobs.
pub fn measured(study: &dyn Study, results: &Results) -> String {
    let mut text = String::new();
    for job in study.plan(results.scale).jobs {
        let of = || results.jobs.iter().filter(|record| record.job == job.id);
        let count = of().count().max(1) as f64;
        let training = of().map(|record| record.training).sum::<f64>() / count;
        let beside =
            of().map(|record| (record.seconds - record.training).max(0.0)).sum::<f64>() / count;
        if of().next().is_some() {
            let step = training / job.length.max(1) as f64;
            let _ = writeln!(text, "{} {} {step:.4} {beside:.1}", study.name(), job.id);
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Watch;
    use crate::{Plan, PlannedJob, Row, Scale, Seeds, StudyError, Work};

    struct Two;

    impl Study for Two {
        fn name(&self) -> &'static str {
            "two"
        }
        fn about(&self) -> &'static str {
            "two jobs"
        }
        fn plan(&self, scale: Scale) -> Plan {
            let length = if scale == Scale::Tenth { 10 } else { 100 };
            let job = |id: &str| PlannedJob { id: id.into(), label: id.into(), length };
            Plan { jobs: vec![job("one"), job("other")], settings: String::new() }
        }
        fn run(&self, _: &Work<'_>, _: &mut Watch<'_>) -> Result<Vec<Row>, StudyError> {
            Ok(Vec::new())
        }
    }

    #[test]
    fn steps_cost_what_they_took_and_what_is_unknown_is_said() {
        let known = "# comment\nthree one 9 9\ntwo one 0.5 20\n";
        let of = |order: &Order<'_>| {
            let costs = costs_by(known, &Two, order);
            costs.iter().map(|cost| (cost.seeds, cost.seconds)).collect::<Vec<_>>()
        };
        assert_eq!(of(&Order::default()), [(1, Some(70.0)), (1, None)]);
        let order = Order { scale: Scale::Tenth, ..Order::default() };
        assert_eq!(of(&order), [(2, Some(50.0)), (2, None)]);
        let order = Order {
            seeds: Seeds::Listed(vec![4, 5, 6]),
            only: vec!["one".into()],
            ..Order::default()
        };
        assert_eq!(of(&order), [(3, Some(210.0))]);
    }

    /// Every line of the table is of a job that there is.
    #[test]
    fn the_table_is_of_jobs_that_there_are() {
        for line in KNOWN.lines().filter(|line| !line.starts_with('#') && !line.is_empty()) {
            let words: Vec<&str> = line.split_whitespace().collect();
            let study = crate::studies().find(|study| study.name() == words[0]);
            let plan = study.map(|study| study.plan(Scale::Full)).unwrap_or_default();
            assert!(plan.ids().any(|id| id == words[1]), "{line}");
            assert!(known_of(KNOWN, words[0], words[1]).is_some(), "{line}");
        }
    }
}
