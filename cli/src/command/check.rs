//! `unsphere check`: looks at meshes, views, weights and configurations before work is spent on them.

use std::path::Path;

use mesh_core::{Examination, Health, TriMesh};
use models::predict::Predictor;
use recon::fit::FitConfig;
use serde::Serialize;
use train::report::counted;
use train::{Checkpoint, CheckpointPath, Summary, settings};

use crate::args::{Check, Global, SystemSettings};
use crate::checkpoint_report::CheckpointReport;
use crate::command::fit;
use crate::configuration::configuration;
use crate::console::{Console, table};
use crate::failure::Failure;
use crate::mesh_file::read_mesh;
use crate::options::{self, ListedOption};
use crate::progress::Progress;
use crate::system::Systems;
use crate::views::read_views;

/// From so many faces at one vertex on comparing them takes long: they all come close to each other, so that each is compared with
/// each, some 20 seconds for this many.
const CROWDED: usize = 20_000;

/// What is printed with `--json`.
#[derive(Debug, Default, Serialize)]
struct Checked<'a> {
    #[serde(skip_serializing_if = "Option::is_none")]
    mesh: Option<MeshReport<'a>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    checkpoint: Option<CheckpointReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    views: Option<ViewsReport<'a>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    config: Option<FitConfig>,
    #[serde(skip_serializing_if = "Option::is_none")]
    system: Option<SystemReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    options: Option<Vec<ListedOption>>,
}

/// What a system's configuration amounts to.
#[derive(Debug, Serialize)]
pub(crate) struct SystemReport {
    name: &'static str,
    #[serde(flatten)]
    summary: Summary,
    config: serde_json::Value,
    #[serde(skip)]
    text: String,
}

/// What the configuration of a system amounts to that the command line asks for.
pub(crate) fn system_report<S: Predictor>(
    asked: &SystemSettings,
    global: Global,
) -> Result<SystemReport, Failure> {
    let config = configuration::<S>(asked, global)?;
    let summary = S::summary(&config.system);
    let text = settings::to_toml(&config);
    let config = serde_json::to_value(&config).map_err(Failure::other)?;
    Ok(SystemReport { name: S::NAME, summary, config, text })
}

#[derive(Debug, Serialize)]
struct MeshReport<'a> {
    #[serde(serialize_with = "train::path_text::serialize")]
    path: &'a Path,
    watertight: bool,
    problems: Vec<String>,
    self_intersections: usize,
    health: Health,
}

#[derive(Debug, Serialize)]
struct ViewsReport<'a> {
    #[serde(serialize_with = "train::path_text::serialize")]
    path: &'a Path,
    layout: String,
    views: usize,
    width: [usize; 2],
    height: [usize; 2],
    /// Least, mean and greatest share of an image that the object covers.
    coverage: [f64; 3],
    warnings: Vec<String>,
}

pub(crate) fn run(
    console: Console,
    global: Global,
    arguments: &Check,
    systems: &Systems,
) -> Result<(), Failure> {
    let mut checked = Checked::default();
    if arguments.options {
        let system = arguments.system.as_deref();
        let options = system.map_or_else(options::of_fit, |name| (systems.named(name).options)());
        checked.options = Some(options);
        return console.result(&checked, describe);
    }
    let asked = &arguments.configuration;
    if let Some(name) = &arguments.system {
        if asked.quality.is_some() {
            let text = "--quality is of a fit, and --system names another thing: that has --preset";
            return Err(Failure::Usage(text.to_owned()));
        }
        let preset = arguments.preset.clone().unwrap_or_else(|| "small".to_owned());
        let (config, set) = (asked.config.clone(), asked.set.clone());
        let asked = SystemSettings { preset, config, set };
        checked.system = Some((systems.named(name).check)(&asked, global)?);
    } else if asked.config.is_some() || asked.quality.is_some() || !asked.set.is_empty() {
        // `-` stands for no file at all: the defaults.
        let mut asked = asked.clone();
        asked.config = asked.config.filter(|path| path.as_os_str() != "-");
        checked.config = Some(fit::configuration(&asked, global)?);
    }
    if let Some(path) = arguments.mesh.as_ref().filter(|path| holds_weights(path)) {
        checked.checkpoint = Some(check_weights(path, systems)?);
    } else if let Some(path) = &arguments.mesh {
        let mesh = read_mesh(console, path)?;
        checked.mesh = Some(check_mesh(console, path, &mesh));
    }
    if let Some(path) = &arguments.views {
        checked.views = Some(check_views(console, path, arguments)?);
    }
    console.result(&checked, describe)?;
    if let Some(mesh) = checked.mesh.filter(|mesh| !mesh.problems.is_empty()) {
        let text = format!("{}: {}", mesh.path.display(), mesh.problems.join("; "));
        return Err(Failure::Other(text));
    }
    Ok(())
}

/// Whether a path is that of weights or of a training.
fn holds_weights(path: &Path) -> bool {
    let is_run = || path.is_dir() && CheckpointPath::find(path, false).is_ok();
    path.extension().is_some_and(|ending| ending == "safetensors") || is_run()
}

fn check_weights(path: &Path, systems: &Systems) -> Result<CheckpointReport, Failure> {
    let found = CheckpointPath::find(path, false).map_err(Failure::input)?;
    let checkpoint = Checkpoint::read(&found.file).map_err(Failure::input)?;
    let name = checkpoint.system().map_err(Failure::input)?;
    match systems.find(name) {
        Some(system) => (system.checkpoint)(&checkpoint, &found),
        None => Err(Failure::input(checkpoint.wrong("system", name, &systems.names()))),
    }
}

fn check_mesh<'a>(console: Console, path: &'a Path, mesh: &TriMesh) -> MeshReport<'a> {
    if let Some(text) = crowded(mesh) {
        console.warn(format_args!("{}: {text}", path.display()));
    }
    let progress = Progress::in_shares(console, "examine");
    let found = mesh.examined_with(&|done, all| progress.set(done, all));
    progress.finish();
    let problems = found.problems();
    let Examination { health, self_intersections } = found;
    let watertight = health.is_watertight();
    MeshReport { path, watertight, problems, self_intersections, health }
}

/// What is said of a mesh whose examination takes much longer than its size lets expect.
fn crowded(mesh: &TriMesh) -> Option<String> {
    let mut faces_at = vec![0_usize; mesh.positions.len()];
    for &vertex in mesh.faces.iter().flatten() {
        if let Some(count) = faces_at.get_mut(vertex as usize) {
            *count += 1;
        }
    }
    let most = faces_at.into_iter().max().filter(|&most| most >= CROWDED)?;
    Some(format!(
        "{most} faces meet at one vertex, as the triangles of a polygon do: each is compared with each, which takes a while \
         and four times as long for twice as many"
    ))
}

fn check_views<'a>(
    console: Console,
    path: &'a Path,
    arguments: &Check,
) -> Result<ViewsReport<'a>, Failure> {
    let views = read_views(console, path, &arguments.reading.options())?;
    let range = |size: fn(&datasets::View) -> usize| {
        let sizes = || views.views.iter().map(size);
        [sizes().min().unwrap_or(0), sizes().max().unwrap_or(0)]
    };
    let shares: Vec<f64> =
        views.views.iter().map(|v| v.mask_pixels() as f64 / v.mask.data.len() as f64).collect();
    let least = shares.iter().copied().fold(f64::INFINITY, f64::min);
    let greatest = shares.iter().copied().fold(0.0, f64::max);
    let mean = shares.iter().sum::<f64>() / shares.len() as f64;
    Ok(ViewsReport {
        path,
        layout: views.layout.to_string(),
        views: views.len(),
        width: range(|v| v.color.width),
        height: range(|v| v.color.height),
        coverage: [least, mean, greatest],
        warnings: views.warnings,
    })
}

fn describe(checked: &Checked<'_>) -> String {
    let mut parts = Vec::new();
    if let Some(mesh) = &checked.mesh {
        let h = &mesh.health;
        let verdict = if mesh.problems.is_empty() { "a closed solid" } else { "has problems" };
        let rows = [
            ("  vertices, faces", format!("{}, {}", h.vertices, h.faces)),
            ("  pieces, Euler number", format!("{}, {}", h.components, h.euler)),
            ("  volume, area", format!("{:.6}, {:.6}", h.volume, h.area)),
            ("  smallest angle", format!("{:.2} degrees", h.smallest_angle_degrees)),
            ("  angles below 5 degrees", format!("{:.3} %", 100.0 * h.angles_below_5_fraction)),
            ("  sharpest fold", format!("{:.1} degrees", h.largest_dihedral_degrees)),
            ("  pairs of faces that run through each other", mesh.self_intersections.to_string()),
        ];
        parts.push(format!("{}: {verdict}\n{}", mesh.path.display(), table(rows)));
        parts.extend(mesh.problems.iter().map(|problem| format!("  problem: {problem}\n")));
    }
    parts.extend(checked.checkpoint.as_ref().map(CheckpointReport::text));
    if let Some(views) = &checked.views {
        let range = |[low, high]: [usize; 2]| {
            if low == high { low.to_string() } else { format!("{low} to {high}") }
        };
        let [least, mean, greatest] = views.coverage.map(|share| 100.0 * share);
        let (path, count) = (views.path.display(), views.views);
        parts.push(format!("{path}: {}, {}\n", counted(count, "view"), views.layout));
        parts.push(table([
            ("  width", range(views.width)),
            ("  height", range(views.height)),
            ("  object", format!("{least:.1} to {greatest:.1} % of an image, mean {mean:.1} %")),
        ]));
        parts.extend(views.warnings.iter().map(|warning| format!("  warning: {warning}\n")));
    }
    if let Some(system) = &checked.system {
        let Summary { trainable, frozen, shapes } = &system.summary;
        let numbers = format!("{trainable} trained, {frozen} frozen");
        let rows = shapes.iter().map(|(name, shape)| (name.as_str(), shape.clone()));
        let rows = std::iter::once(("numbers", numbers)).chain(rows);
        let rows = table(rows).trim_end().replace('\n', "\n# ");
        parts.push(format!("# {}\n# {rows}\n{}", system.name, system.text));
    }
    if let Some(config) = &checked.config {
        parts.push(settings::to_toml(config));
    }
    parts.extend(checked.options.as_deref().map(options::text));
    parts.concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A polygon of so many corners as readers take it: a fan of triangles around the first.
    fn polygon(corners: usize) -> TriMesh {
        let at = |k: usize| std::f64::consts::TAU * k as f64 / corners as f64;
        let positions = (0..corners).map(|k| [at(k).cos() as f32, at(k).sin() as f32, 0.0]);
        let faces = (2..corners as u32).map(|k| [0, k - 1, k]);
        TriMesh::new(positions.collect(), faces.collect())
    }

    #[test]
    fn a_fan_that_takes_long_is_spoken_of() {
        assert_eq!(crowded(&polygon(CROWDED + 1)), None);
        let text = crowded(&polygon(CROWDED + 2)).unwrap_or_default();
        assert!(text.starts_with("20000 faces meet at one vertex"), "{text}");
        // Faces that name what is not there are no reason to fail.
        assert_eq!(crowded(&TriMesh::new(vec![[0.0; 3]], vec![[0, 7, 9]])), None);
    }
}
