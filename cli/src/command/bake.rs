//! `unsphere bake`: a mesh and views in, the mesh with a texture out.

use std::path::Path;
use std::time::Instant;

use datasets::{View, Views};
use mesh_core::{Limits, TriMesh, UpAxis, read_mesh_with_uvs};
use recon::bake::{BakeConfig, BakeError, Baked, MISSED, Misfit, bake};
use recon::delivery::{BakedDelivery, BakedMetrics, deliver_baked};
use serde::Serialize;
use train::report::counted;

use crate::args::Bake;
use crate::command::fit::score_rows;
use crate::console::{Console, table};
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::mesh_file::remarked;
use crate::progress::Progress;
use crate::provenance::{facts, typed_command};
use crate::views::{add_scored, around_the_object, read_views, up_axis};

/// Where the results go when nothing is said.
const FOLDER: &str = "unsphere-bake";

/// What is printed with `--json`: `metrics.json`, and where and how fast it was made.
#[derive(Debug, Serialize)]
struct Outcome<'a> {
    #[serde(serialize_with = "train::path_text::serialize")]
    output: &'a Path,
    seconds: f64,
    metrics: &'a BakedMetrics,
}

pub(crate) fn run(console: Console, arguments: &Bake) -> Result<(), Failure> {
    let start = Instant::now();
    // Refusals come before the work.
    let folder = arguments.output.create(FOLDER)?;
    let _interrupt = Interrupt::listen(Some(folder.unfinished()))?;
    let path = &arguments.mesh;
    let mesh =
        remarked(console, path, |remarks| read_mesh_with_uvs(path, &Limits::default(), remarks))?;
    let reading = around_the_object(&arguments.reading);
    let mut views = read_views(console, &arguments.views, &reading)?;
    if let Some(others) = &arguments.score {
        add_scored(console, &mut views, others, &reading)?;
    }
    views.warnings.iter().for_each(|warning| console.warn(warning));
    let up = up_axis(console, arguments.up, &views);
    let mesh = match arguments.mesh_up {
        Some(own) => mesh.upright(own).laid(up),
        None => mesh,
    };
    let (given, held_out) = parted(&views, arguments);
    let seen: Vec<&View> = given.iter().map(|&i| &views.views[i]).collect();
    let baked = baked(console, &mesh, &seen, arguments)?;
    let misfit =
        (baked.mask_iou < MISSED).then(|| misfit_words(&mesh, &seen, up, arguments, &baked));
    baked.warnings.iter().chain(&misfit).for_each(|warning| console.warn(warning));
    if let Some([least, most]) = baked.exposure_range() {
        console.remark(format_args!(
            "photographs differ in exposure or white balance, {least:.2} to {most:.2} times the mean: the texture is that of the \
             mean (--keep-exposure mixes them as they are)"
        ));
    }
    let progress = Progress::new(console, "write");
    progress.say("scores, meshes, turntable, report");
    let name = path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy();
    let warnings: Vec<String> = misfit.into_iter().collect();
    let delivery = BakedDelivery {
        title: &name,
        command: &typed_command(),
        views: &views,
        given: &given,
        held_out: &held_out,
        baked: &baked,
        up,
        warnings: &warnings,
        provenance: facts(["unsphere", "threads", "machine"]).into(),
    };
    let metrics = deliver_baked(&delivery, &folder).map_err(Failure::other)?;
    let output = folder.commit()?;
    progress.finish();
    let seconds = start.elapsed().as_secs_f64();
    let outcome = Outcome { output: &output, seconds, metrics: &metrics };
    console.result(&outcome, |outcome| describe(outcome, views.len()))
}

/// Indices of the views to bake from, and of those that only score.
fn parted(views: &Views, arguments: &Bake) -> (Vec<usize>, Vec<usize>) {
    let every = arguments.hold_out.map(|every| every as usize);
    if arguments.score.is_some() {
        return (0..views.len()).partition(|i| views.test.binary_search(i).is_err());
    }
    let split = views.split(every);
    (split.fit, split.held_out)
}

fn baked(
    console: Console,
    mesh: &TriMesh,
    views: &[&View],
    arguments: &Bake,
) -> Result<Baked, Failure> {
    let config = BakeConfig {
        uv: arguments.uv,
        texture_size: arguments.texture_size.map(|side| side as usize),
        balance_colors: !arguments.keep_exposure,
    };
    let progress = Progress::new(console, "bake");
    let found = bake(mesh, views, &config, &|done, all| progress.set(done, all));
    progress.finish();
    let path = arguments.mesh.display();
    found.map_err(|error| match error {
        BakeError::Config(_) | BakeError::Room { .. } => {
            Failure::Usage(format!("--texture-size: {path}: {error}"))
        }
        BakeError::Uv { reason } => Failure::Input(format!(
            "{path}: the mesh's texture coordinates {reason}; unwrap it anew, or take new ones: --uv new"
        )),
        BakeError::Mesh(error) => Failure::Input(format!("{path}: {error}")),
        BakeError::NoExtent => Failure::Input(format!("{path}: {error}")),
        error => Failure::Input(format!("{}: {error}", arguments.views.display())),
    })
}

/// What is to be said of a mesh that lies elsewhere than the object, and what to do.
fn misfit_words(
    mesh: &TriMesh,
    views: &[&View],
    up: UpAxis,
    arguments: &Bake,
    baked: &Baked,
) -> String {
    let (path, source) = (arguments.mesh.display(), arguments.views.display());
    let remedy = match Misfit::find(mesh, views, up) {
        Some(Misfit::Turned { up, mask_iou }) if arguments.mesh_up.is_none() => format!(
            "turned from {up} up it would lie there (mask IoU {mask_iou:.2}): --mesh-up {}",
            up.name()
        ),
        Some(Misfit::Turned { mask_iou, .. }) => format!(
            "turned otherwise it would lie there (mask IoU {mask_iou:.2}): is --mesh-up right?"
        ),
        Some(Misfit::Scaled { factor }) => format!(
            "it is {factor:.3} times as large as the object: in another unit? `unsphere convert {path} -o scaled.glb --scale {:.4}` \
             brings it back",
            1.0 / factor
        ),
        Some(Misfit::Moved { radii }) => format!(
            "it lies {radii:.1} radii of the object beside it: it was moved, or the cameras are of another frame"
        ),
        _ => format!(
            "it is of another object, in another frame or turned (--mesh-up), or cameras and masks do not agree: \
             `unsphere data inspect {source}` says whether they do"
        ),
    };
    format!(
        "{path}: the mesh hardly lies where the masks are (mask IoU {:.2}): {remedy}",
        baked.mask_iou
    )
}

fn describe(outcome: &Outcome<'_>, views: usize) -> String {
    let metrics = outcome.metrics;
    let (scores, scored) = match &metrics.held_out {
        Some(scores) => (scores, "held out"),
        None => (&metrics.baked, "baked"),
    };
    let kept = if metrics.uv.kept { "kept" } else { "new" };
    let mut rows = vec![
        (
            "texture",
            format!(
                "{0} x {0}, {1:.1} % of it in no view",
                metrics.texture_size,
                100.0 * metrics.unseen
            ),
        ),
        ("layout", format!("{kept}: {}", metrics.uv.reason)),
    ];
    rows.extend(score_rows(scores));
    if let (Some(_), Some(psnr)) = (&metrics.held_out, metrics.baked.psnr) {
        rows.push(("", format!("PSNR {psnr:.2} dB on the views that were baked")));
    }
    rows.push((
        "mesh",
        format!("{} vertices, {}", metrics.vertices, counted(metrics.faces, "face")),
    ));
    rows.push(("time", format!("{:.1} s", outcome.seconds)));
    rows.push(("output", outcome.output.display().to_string()));
    let count = scores.views.len();
    let was = if count == 1 { "was" } else { "were" };
    format!(
        "{} of {} baked; the scores are means over {} that {was} {scored}\n{}",
        metrics.baked.views.len(),
        counted(views, "view"),
        counted(count, "view"),
        table(rows)
    )
}
