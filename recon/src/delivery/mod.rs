//! From a fit to the folder that a user keeps: meshes, turntable, report and figures.

mod apart;
mod baked;
mod comparison;
mod metrics;
mod refinement;
mod report;

pub use apart::apart_from;
pub use baked::{BakedDelivery, BakedMetrics, deliver_baked};
pub use comparison::compare;
pub use metrics::Metrics;
pub use refinement::Refinement;
pub use report::{comparison_rows, holes, mesh_table, score_figures};

use datasets::{View, Views};
use diff_raster::FacesError;
use losses::metrics::{CompareError, Preset, evaluate};
use mesh_core::io::{glb, write_mesh};
use mesh_core::{Camera, TriMesh, UpAxis, WriteError};
use serde::Serialize;
use train::output::{OutputError, OutputFolder};
use train::report::{Report, ViewPair};

use crate::fit::{FitConfig, Fitted};
pub use crate::turntable::{animation, turntable};
use crate::verdict::Assessment;
use comparison::compare_by;

/// Side of the report's images and of the turntable where nothing else is wished, pixels.
pub const PICTURE: usize = 256;

/// A finished fit and what it came from.
#[derive(Debug)]
pub struct Delivery<'a> {
    /// Heading of the report.
    pub title: &'a str,
    /// The command as it was typed.
    pub command: &'a str,
    /// The views that the mesh was fitted to and scored on.
    pub views: &'a Views,
    /// The options of the fit.
    pub config: &'a FitConfig,
    /// The fit.
    pub fitted: &'a Fitted,
    /// What is said of it.
    pub assessment: &'a Assessment,
    /// The object's true mesh, where it is known.
    pub truth: Option<&'a TriMesh>,
    /// Which way is up in the world of the cameras: turntable, page and GLB stand upright.
    pub up: UpAxis,
    /// More rows for the report's table: machine, threads, dates.
    pub provenance: Vec<(String, String)>,
}

/// Why a fit could not be delivered.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DeliverError {
    /// The folder could not be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A mesh could not be written.
    #[error(transparent)]
    Mesh(#[from] WriteError),
    /// The mesh is not one.
    #[error(transparent)]
    Faces(#[from] FacesError),
    /// The mesh cannot be compared with the true one.
    #[error(transparent)]
    Compare(#[from] CompareError),
}

/// Scores a fit and writes everything that a user keeps of it into the folder.
///
/// The files are `mesh.glb`, `mesh.obj` (with `mesh.mtl` and its image where there is a texture),
/// `mesh.ply`, `turntable.gif`, `report.html`, `metrics.json` and `config.toml`.
///
/// # Errors
/// If the folder cannot be written or the mesh cannot be scored.
pub fn deliver(delivery: &Delivery<'_>, folder: &OutputFolder) -> Result<Metrics, DeliverError> {
    let (metrics, pairs) = score(delivery)?;
    let options = train::settings::to_toml(delivery.config);
    folder.write("config.toml", options.as_bytes())?;
    let report = report::report(delivery, &metrics, pairs);
    let side = delivery.config.picture_size;
    write_results(&delivery.fitted.mesh, (delivery.up, side), &metrics, report, folder)?;
    Ok(metrics)
}

/// Writes `mesh.glb`, `mesh.obj`, `mesh.ply`, `turntable.gif`, `metrics.json` and `report.html`, which shows the
/// turntable too, `side` pixels wide. The GLB and the turntable stand upright; OBJ and PLY are in the world of the cameras.
///
/// # Errors
/// If a file cannot be written, or a face names a vertex that is not there.
///
/// # Panics
/// If the metrics cannot be JSON.
pub fn write_results(
    mesh: &TriMesh,
    (up, side): (UpAxis, usize),
    metrics: &impl Serialize,
    report: Report,
    folder: &OutputFolder,
) -> Result<(), DeliverError> {
    glb::write_upright(folder.path().join("mesh.glb"), mesh, up)?;
    for name in ["mesh.obj", "mesh.ply"] {
        write_mesh(folder.path().join(name), mesh)?;
    }
    let turntable = turntable(&mesh.clone().upright(up), side)?;
    folder.write("turntable.gif", &turntable)?;
    let json = serde_json::to_string_pretty(metrics).expect("plain figures serialise");
    folder.write("metrics.json", (json + "\n").as_bytes())?;
    let page = Report { turntable: Some(turntable), ..report }.to_html();
    folder.write("report.html", page.as_bytes())?;
    Ok(())
}

fn score(delivery: &Delivery<'_>) -> Result<(Metrics, Vec<ViewPair>), DeliverError> {
    let fitted = delivery.fitted;
    let (scored_on, indices) = if fitted.held_out_views.is_empty() {
        ("fitted", &fitted.train_views)
    } else {
        ("held-out", &fitted.held_out_views)
    };
    let seen = |&i: &usize| {
        let view = &delivery.views.views[i];
        (view, fitted.cameras.as_ref().map_or(&view.camera, |found| &found.cameras[i]))
    };
    let views: Vec<(&View, &Camera)> = indices.iter().map(seen).collect();
    let (scores, pairs) = compare_by(&fitted.mesh, &views, delivery.config.picture_size)?;
    let against = |truth| {
        let protocols = Preset::ALL.map(|preset| preset.protocol(delivery.config.seed));
        protocols.iter().map(|p| evaluate(&fitted.mesh, truth, p)).collect::<Result<_, _>>()
    };
    let truth = delivery.truth.map(against).transpose()?.unwrap_or_default();
    let metrics = Metrics {
        schema_version: 1,
        steps: fitted.history.len(),
        interrupted: fitted.ended.is_cancelled(),
        up: delivery.up.name(),
        verdict: delivery.assessment.verdict.clone(),
        warnings: delivery.views.warnings.iter().chain(&fitted.warnings).cloned().collect(),
        evidence: delivery.assessment.evidence.clone(),
        cameras: Refinement::of(fitted, &delivery.views.views)?,
        exposure: fitted.exposure_range(),
        photo_consistency: fitted.photo_consistency,
        scored_on,
        views: scores,
        health: fitted.health.clone(),
        genus: fitted.health.genus(),
        holes: holes(&fitted.health),
        self_intersections: fitted.self_intersections,
        truth,
    };
    Ok((metrics, pairs))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::primitives;
    use synth::{Orbit, RenderOptions, render_views};
    use train::progress::Watch;

    use super::*;
    use crate::fit::fit;
    use crate::verdict::assess;

    #[test]
    fn metrics_have_what_reader_and_fit_had_to_say() {
        let ball = primitives::icosphere(2).colored([0.5; 3]);
        let cameras = Orbit { count: 5, width: 32, height: 32, ..Orbit::default() }.cameras();
        let views = render_views(&ball, &cameras, &RenderOptions::default(), &|_, _| {}).unwrap();
        let views = Views { warnings: vec!["a remark".into()], ..Views::in_memory(views) };
        let config = FitConfig { start_level: 1, level: 1, steps: 2, ..FitConfig::default() };
        let mut fitted = fit(&views, &config, &mut Watch::default()).unwrap();
        fitted.warnings = vec!["another".into()];
        let assessment = assess(&views, &fitted).unwrap();
        let (title, command, up) = ("a", "b", UpAxis::Y);
        let (views, config, fitted, assessment) = (&views, &config, &fitted, &assessment);
        let (truth, provenance) = (None, Vec::new());
        let delivery =
            Delivery { title, command, views, config, fitted, assessment, truth, up, provenance };
        assert_eq!(score(&delivery).unwrap().0.warnings, ["a remark", "another"]);
    }
}
