//! The report of a training: curves, scores, and the last samples.

use std::collections::BTreeMap;

use serde_json::Value;

use super::log::{History, Line};
use super::system::Shown;
use crate::report::{Chart, Figure, Report, Series, Table};
use crate::settings::settings_of;

/// The page about a run as far as it came.
pub(super) fn report(system: &str, config: &str, history: &History, shown: &Shown) -> Report {
    let header = &history.header;
    let fact = |name: &str| match &header[name] {
        Value::String(text) => text.clone(),
        Value::Null => String::new(),
        other => other.to_string(),
    };
    let steps = history.lines.iter().filter(|line| matches!(line, Line::Step { .. })).count();
    let seconds = history.seconds();
    let facts = ["data", "data_hash", "seed", "threads", "cpu", "machine", "version", "commit"];
    let facts = facts.map(|name| (name.replace('_', " "), fact(name)));
    Report {
        title: format!("{system}: a training"),
        summary: format!(
            "{steps} of {} steps in {seconds:.0} s of computing; {} numbers are trained.",
            fact("total"),
            fact("trainable")
        ),
        command: fact("command"),
        scene: shown.scene.clone().unwrap_or_default(),
        figures: figures(history),
        views: shown.views.clone(),
        charts: charts(history),
        tables: vec![
            Table::new("Provenance", facts.into_iter().filter(|(_, fact)| !fact.is_empty())),
            Table::new("Configuration", options(config)),
        ],
        ..Report::default()
    }
}

/// The last scores of validation, and the step of the best.
fn figures(history: &History) -> Vec<Figure> {
    let validations = || {
        history.lines.iter().rev().filter_map(|line| match line {
            Line::Validation { step, metrics, best, .. } => Some((step, metrics, best)),
            _ => None,
        })
    };
    let Some((_, last, _)) = validations().next() else { return Vec::new() };
    let mut figures: Vec<Figure> = last
        .iter()
        .map(|(name, value)| Figure::new(format!("validation: {name}"), format!("{value:.4}")))
        .collect();
    if let Some((step, ..)) = validations().find(|(_, _, best)| **best) {
        figures.push(Figure::new("steps of the best checkpoint", step.to_string()));
    }
    figures
}

fn charts(history: &History) -> Vec<Chart> {
    let mut terms: BTreeMap<String, Vec<(f64, f64)>> = BTreeMap::new();
    let (mut loss, mut rate, mut norm) = (Vec::new(), Vec::new(), Vec::new());
    let mut scores: BTreeMap<String, Vec<(f64, f64)>> = BTreeMap::new();
    for line in &history.lines {
        match line {
            Line::Step { step, loss: l, terms: t, learning_rate, gradient_norm, .. } => {
                let x = *step as f64;
                loss.push((x, *l));
                rate.push((x, *learning_rate));
                norm.push((x, *gradient_norm));
                for (name, value) in t {
                    terms.entry(name.clone()).or_default().push((x, *value));
                }
            }
            Line::Validation { step, metrics, .. } => {
                for (name, value) in metrics {
                    scores.entry(name.clone()).or_default().push((*step as f64, *value));
                }
            }
            _ => {}
        }
    }
    let mut all = vec![Series::new("loss", loss)];
    all.extend(terms.into_iter().map(|(name, points)| Series::new(name, points)));
    let chart = |title: &str, series| Chart::new(title, "step", series);
    let mut charts = vec![
        chart("Loss and its weighted terms", all).logarithmic(),
        chart("Norm of the gradients", vec![Series::new("norm", norm)]).logarithmic(),
        chart("Learning rate", vec![Series::new("learning rate", rate)]).logarithmic(),
    ];
    // Scores differ in unit: one chart each.
    let scores = scores.into_iter();
    charts.extend(scores.map(|(name, points)| {
        chart(&format!("Validation: {name}"), vec![Series::new(&name, points)])
    }));
    charts
}

/// The settings in the order of the file. A list may stand on several lines there.
fn options(config: &str) -> impl Iterator<Item = (&str, String)> {
    let settings = settings_of(config);
    let names = config.lines().filter_map(|line| line.split_once(" = ")).map(|(name, _)| name);
    names.filter_map(move |name| Some((name, settings.get(name)?.clone())))
}

#[cfg(test)]
mod tests {
    use super::options;

    #[test]
    fn a_list_on_several_lines_is_one_setting() {
        let config = "families = [\n    \"car\",\n    \"chair\",\n]\nlevel = 2\n";
        let found: Vec<_> = options(config).collect();
        assert_eq!(
            found,
            [("families", r#"["car", "chair"]"#.to_owned()), ("level", "2".to_owned())]
        );
    }
}
