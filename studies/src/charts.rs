//! The courses of a study's trainings as charts.

use train::report::{Chart, Series};

use crate::curves::LOSS;
use crate::results::Results;

/// Lines of a chart, so that each can be told from the others and named.
const LINES: usize = 3;

/// Charts of the first seed of each job, one figure a chart: scores of validation, then the losses.
pub(crate) fn charts(results: &Results) -> Vec<Chart> {
    let mut names: Vec<&str> = Vec::new();
    for curve in &results.curves {
        if !names.contains(&curve.name.as_str()) {
            names.push(&curve.name);
        }
    }
    names.sort_by_key(|name| *name == LOSS);
    names.into_iter().flat_map(|name| charts_of(results, name)).collect()
}

fn charts_of(results: &Results, name: &str) -> Vec<Chart> {
    let mut series: Vec<Series> = Vec::new();
    for curve in results.curves.iter().filter(|curve| curve.name == name) {
        if series.iter().all(|known| known.name != curve.job) {
            let points = curve.points.iter().map(|&[step, value]| (step, value)).collect();
            series.push(Series::new(&curve.job, points));
        }
    }
    let parts = series.len().div_ceil(LINES);
    let chart = |(k, lines): (usize, &[Series])| {
        let title =
            if parts > 1 { format!("{name} ({} of {parts})", k + 1) } else { name.to_owned() };
        let chart = Chart::new(title, "step", lines.to_vec());
        if name == LOSS { chart.logarithmic() } else { chart }
    };
    series.chunks(LINES).enumerate().map(chart).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::CurveRecord;

    #[test]
    fn a_chart_has_few_lines_and_one_figure() {
        let record = |job: usize, seed: u64, name: &str| CurveRecord {
            job: format!("job-{job}"),
            seed,
            name: name.into(),
            points: vec![[1.0, 2.0], [2.0, 1.0]],
        };
        let mut results = Results::default();
        for job in 0..4 {
            for seed in 0..2 {
                results.curves.push(record(job, seed, LOSS));
            }
        }
        results.curves.push(record(0, 0, "validation: iou"));
        let charts = charts(&results);
        let titles: Vec<&str> = charts.iter().map(|chart| chart.title.as_str()).collect();
        assert_eq!(titles, ["validation: iou", "loss (1 of 2)", "loss (2 of 2)"]);
        assert_eq!((charts[1].series.len(), charts[2].series.len()), (3, 1));
        assert!(charts[1].logarithmic && !charts[0].logarithmic);
    }
}
