//! Scores of meshes that are made in another way: controls of tables.

use datasets::View;
use mesh_core::TriMesh;
use rayon::prelude::*;
use recon::evaluate::score_views;
use train::{Better, DataError, Metric, Subset};

use super::config::Img2MeshConfig;
use super::data::{Data, Group};
use super::surface::compared;
use crate::parts::mean_metric;

/// Scores of what `mesh_of` makes of the groups of a subset, with `views` given, under the names and at the cameras of
/// [`evaluate_with`](super::Img2Mesh::evaluate_with). `mesh_of` answers in the world of the cameras.
///
/// # Errors
/// If a file cannot be read, there is nothing for that, or `mesh_of` says so.
pub fn evaluate_meshes(
    data: &Data,
    config: &Img2MeshConfig,
    (subset, views): (Subset, usize),
    mesh_of: impl Fn(&Group) -> Result<TriMesh, DataError> + Sync,
) -> Result<Vec<Metric>, DataError> {
    let one = |k: usize| -> Result<(String, [Option<f64>; 7]), DataError> {
        let group = data.group((subset, views), k)?;
        let mesh = mesh_of(&group)?;
        let small: Vec<View> =
            group.scored.iter().map(|view| view.clone().at_most(config.render_size)).collect();
        let seen = score_views(&mesh, &small.iter().collect::<Vec<_>>(), &|_, _| ());
        let seen = seen.map_err(DataError::unfit)?;
        let surface = group.truth.as_ref().map(|truth| compared(&mesh, truth));
        let scores = [
            Some(seen.mask_iou),
            Some(seen.image_l1),
            seen.psnr,
            surface.map(|s| s.chamfer),
            surface.map(|s| s.f_score),
            surface.map(|s| s.quality.self_intersecting),
            surface.map(|s| s.quality.folded),
        ];
        Ok((group.object, scores))
    };
    let all: Vec<_> = (0..data.trials(subset, views)?).into_par_iter().map(one).collect();
    let all = all.into_iter().collect::<Result<Vec<_>, DataError>>()?;
    let names = [
        ("mask-iou", Better::Larger),
        ("image-l1", Better::Smaller),
        ("psnr", Better::Larger),
        ("chamfer", Better::Smaller),
        ("f-score", Better::Larger),
        ("self-intersecting", Better::Smaller),
        ("folded", Better::Smaller),
    ];
    let metric = |(k, (name, better)): (usize, (&str, Better))| {
        let values = all.iter().filter_map(|(object, scores)| Some((&**object, scores[k]?)));
        mean_metric(name, better, values)
    };
    let metrics = names.into_iter().enumerate().map(metric);
    Ok(metrics.filter(|metric| !metric.by_object.is_empty()).collect())
}
