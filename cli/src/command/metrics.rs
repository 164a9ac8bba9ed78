//! `unsphere metrics`: two meshes compared by published protocols.

use std::path::Path;

use losses::metrics::{CompareError, Preset, Report, Role, evaluate};
use serde::Serialize;

use crate::args::{Global, Metrics};
use crate::console::{Console, table};
use crate::failure::Failure;
use crate::mesh_file::read_mesh;
use crate::progress::Progress;

/// What is printed with `--json`.
#[derive(Debug, Serialize)]
struct Comparison<'a> {
    prediction: &'a Path,
    truth: &'a Path,
    reports: Vec<Report>,
}

pub(crate) fn run(console: Console, global: Global, arguments: &Metrics) -> Result<(), Failure> {
    let presets = match arguments.preset.as_slice() {
        [] => Preset::ALL.to_vec(),
        names => names
            .iter()
            .map(|name| name.parse())
            .collect::<Result<Vec<Preset>, _>>()
            .map_err(|error| Failure::Usage(format!("--preset: {error}")))?,
    };
    let prediction = read_mesh(console, &arguments.prediction)?;
    let truth = read_mesh(console, &arguments.truth)?;
    let progress = Progress::new(console, "compare");
    let mut reports = Vec::new();
    for (k, preset) in presets.iter().enumerate() {
        progress.set(k, presets.len());
        progress.say(preset.name().to_owned());
        let protocol = preset.protocol(global.seed.unwrap_or(0));
        reports.push(evaluate(&prediction, &truth, &protocol).map_err(|error| {
            let role = match &error {
                CompareError::Invalid { role, .. }
                | CompareError::NoSurface { role, .. }
                | CompareError::Flat { role } => *role,
            };
            let path = match role {
                Role::Prediction => &arguments.prediction,
                Role::Truth => &arguments.truth,
            };
            Failure::Input(format!("{}: {error}", path.display()))
        })?);
    }
    progress.finish();
    let comparison =
        Comparison { prediction: &arguments.prediction, truth: &arguments.truth, reports };
    console.result(&comparison, |comparison| {
        comparison.reports.iter().map(describe).collect::<Vec<_>>().join("\n")
    })
}

/// A report for people.
pub(crate) fn describe(report: &Report) -> String {
    let mut rows = Vec::new();
    let mut add = |name: &'static str, value: Option<f64>| {
        if let Some(value) = value {
            rows.push((name, format!("{value:.6}")));
        }
    };
    add("  chamfer", report.chamfer);
    add("  prediction to truth", report.accuracy);
    add("  truth to prediction", report.completeness);
    add("  normal consistency", report.normal_consistency);
    add("  IoU of volumes", report.iou);
    let scores: Vec<_> =
        report.f_scores.iter().map(|f| format!("{:.4} at {:.4}", f.f_score, f.threshold)).collect();
    if !scores.is_empty() {
        rows.push(("  F-score", scores.join(", ")));
    }
    let protocol = &report.protocol;
    format!("{}  ({})\n  {}\n{}", protocol.name, protocol.source, protocol.formula, table(rows))
}
