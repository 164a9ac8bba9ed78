//! What a user keeps of a texture that was baked.

use datasets::{View, Views};
use mesh_core::UpAxis;
use serde::Serialize;
use train::output::OutputFolder;
use train::report::{Figure, Report, Table, ViewPair, counted};

use super::comparison::compare;
use super::report::score_figures;
use super::{DeliverError, PICTURE, write_results};
use crate::bake::{Baked, UvOrigin};
use crate::evaluate::ViewScores;
use crate::scene::scene_of;

/// A baked mesh and what it came from.
#[derive(Debug)]
pub struct BakedDelivery<'a> {
    /// Heading of the report.
    pub title: &'a str,
    /// The command as it was typed.
    pub command: &'a str,
    /// All views.
    pub views: &'a Views,
    /// Indices of those that were given to [`bake`](crate::bake::bake()); [`Baked::views`] counts within these.
    pub given: &'a [usize],
    /// Indices of those that only score it.
    pub held_out: &'a [usize],
    /// What was made.
    pub baked: &'a Baked,
    /// Which way is up in the world of the cameras: turntable, page and GLB stand upright.
    pub up: UpAxis,
    /// What else a user should know, one sentence each.
    pub warnings: &'a [String],
    /// More rows for the report's table: machine, threads, dates.
    pub provenance: Vec<(String, String)>,
}

/// What `metrics.json` holds of a baked mesh.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct BakedMetrics {
    /// Version of this layout.
    pub schema_version: u32,
    /// The axis that is up in the coordinates of the mesh; `mesh.glb` is turned so that it is +Y there.
    pub up: &'static str,
    /// How many vertices the mesh has.
    pub vertices: usize,
    /// How many faces.
    pub faces: usize,
    /// Where its texture coordinates are from.
    pub uv: UvOrigin,
    /// Side of the texture, texels.
    pub texture_size: usize,
    /// [`Baked::unseen`].
    pub unseen: f64,
    /// [`Baked::mask_iou`].
    pub mask_iou: f64,
    /// The darkest and the brightest channel of a photograph beside the texture, in sRGB; none where photographs do not differ in
    /// exposure or white balance.
    pub exposure: Option<[f32; 2]>,
    /// The scores on the views that it was baked from.
    pub baked: ViewScores,
    /// The scores on views that were held out; none where there are none.
    pub held_out: Option<ViewScores>,
    /// What a user should know, one sentence each.
    pub warnings: Vec<String>,
}

/// Scores a baked mesh and writes what a user keeps of it into the folder: `mesh.glb`, `mesh.obj` with `mesh.mtl` and
/// `mesh.png`, `mesh.ply` with a colour per vertex, `turntable.gif`, `report.html` and `metrics.json`.
///
/// # Errors
/// If the folder cannot be written.
///
/// # Panics
/// If an index is not that of a view, or the mesh has no texture.
pub fn deliver_baked(
    delivery: &BakedDelivery<'_>,
    folder: &OutputFolder,
) -> Result<BakedMetrics, DeliverError> {
    let baked = delivery.baked;
    let compared = |indices: &[usize], kind: &str| -> Result<_, DeliverError> {
        let views: Vec<&View> = indices.iter().map(|&i| &delivery.views.views[i]).collect();
        let (scores, mut pairs) = compare(&baked.mesh, &views, PICTURE)?;
        for pair in &mut pairs {
            pair.caption = format!("{kind} {}", pair.caption);
        }
        Ok((scores, pairs))
    };
    let held_out = (!delivery.held_out.is_empty())
        .then(|| compared(delivery.held_out, "held-out"))
        .transpose()?;
    let used: Vec<usize> = baked.views.iter().map(|&i| delivery.given[i]).collect();
    let (scores, own) = compared(&used, "baked")?;
    let (held_out, mut pairs) = held_out.unzip();
    let pairs = pairs.get_or_insert_with(Vec::new);
    pairs.extend(own);
    let mesh = &baked.mesh;
    let texture = mesh.texture.as_ref().expect("a baked mesh has a texture");
    let warnings = delivery.views.warnings.iter().chain(&baked.warnings).chain(delivery.warnings);
    let metrics = BakedMetrics {
        schema_version: 1,
        up: delivery.up.name(),
        vertices: mesh.positions.len(),
        faces: mesh.faces.len(),
        uv: baked.uv.clone(),
        texture_size: texture.image.width,
        unseen: baked.unseen,
        mask_iou: baked.mask_iou,
        exposure: baked.exposure_range(),
        baked: scores,
        held_out,
        warnings: warnings.cloned().collect(),
    };
    let page = page(delivery, &metrics, std::mem::take(pairs));
    write_results(mesh, (delivery.up, PICTURE), &metrics, page, folder)?;
    Ok(metrics)
}

fn page(delivery: &BakedDelivery<'_>, metrics: &BakedMetrics, views: Vec<ViewPair>) -> Report {
    let (scores, scored) = match &metrics.held_out {
        Some(scores) => (scores, "that were held out"),
        None => (&metrics.baked, "that it was baked from"),
    };
    let source = delivery.views.source.display();
    let mut figures = score_figures(scores);
    figures.push(Figure::new("texels that no view shows", percent(metrics.unseen)));
    let kept = if metrics.uv.kept { "the mesh's own" } else { "new" };
    let rows = [
        ("vertices, faces", format!("{}, {}", metrics.vertices, metrics.faces)),
        ("texture", format!("{0} x {0}", metrics.texture_size)),
        ("texture coordinates", format!("{kept}: {}", metrics.uv.reason)),
        ("texels that no view shows", percent(metrics.unseen)),
        ("mask IoU before baking, around the masks", format!("{:.4}", metrics.mask_iou)),
    ];
    let mut run = vec![("input".to_owned(), format!("{source} ({})", delivery.views.layout))];
    run.extend(delivery.provenance.iter().cloned());
    Report {
        title: delivery.title.into(),
        summary: format!(
            "A texture baked from {} of {source}; the figures are means over {} {scored}.",
            counted(metrics.baked.views.len(), "view"),
            counted(scores.views.len(), "view"),
        ),
        command: delivery.command.into(),
        scene: scene_of(&delivery.baked.mesh.clone().upright(delivery.up)),
        figures,
        warnings: metrics.warnings.clone(),
        views,
        tables: vec![Table::new("The mesh", rows), Table::new("The run", run)],
        ..Report::default()
    }
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}
