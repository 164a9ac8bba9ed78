//! `unsphere metrics`: two meshes compared by published protocols.

use std::path::Path;

use losses::metrics::{CompareError, FrameMismatch, Preset, Report, Role, evaluate};
use recon::delivery::comparison_rows;
use serde::Serialize;

use crate::args::{Global, Metrics};
use crate::console::{Console, table};
use crate::failure::Failure;
use crate::mesh_file::read_mesh;
use crate::progress::Progress;

/// What is printed with `--json`.
#[derive(Debug, Serialize)]
struct Comparison<'a> {
    #[serde(serialize_with = "train::path_text::serialize")]
    prediction: &'a Path,
    #[serde(serialize_with = "train::path_text::serialize")]
    truth: &'a Path,
    /// Why the two seem to lie in different coordinates.
    #[serde(skip_serializing_if = "Option::is_none")]
    warning: Option<String>,
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
        progress.say(preset.name());
        let protocol = preset.protocol(global.seed.unwrap_or(0));
        reports.push(evaluate(&prediction, &truth, &protocol).map_err(|error| {
            let role = match &error {
                CompareError::Invalid { role, .. } | CompareError::NoSurface { role, .. } => *role,
            };
            let path = match role {
                Role::Prediction => &arguments.prediction,
                Role::Truth => &arguments.truth,
            };
            Failure::Input(format!("{}: {error}", path.display()))
        })?);
    }
    progress.finish();
    let warning = FrameMismatch::of(&prediction, &truth).map(|found| found.to_string());
    if let Some(warning) = &warning {
        console.warn(warning);
    }
    let (prediction, truth) = (&arguments.prediction, &arguments.truth);
    let comparison = Comparison { prediction, truth, warning, reports };
    console.result(&comparison, |comparison| {
        comparison.reports.iter().map(describe).collect::<Vec<_>>().join("\n")
    })
}

/// A report for people.
pub(crate) fn describe(report: &Report) -> String {
    let protocol = &report.protocol;
    let rows = table(comparison_rows(report));
    let rows = rows.lines().fold(String::new(), |all, line| all + "  " + line + "\n");
    format!("{}  ({})\n  {}\n{rows}", protocol.name, protocol.source, protocol.formula)
}
