//! A mesh beside the views that it is scored on.

use std::collections::BTreeMap;
use std::sync::Mutex;

use datasets::View;
use diff_raster::FacesError;
use mesh_core::{ByteImage, Camera, TriMesh};
use synth::{Lighting, RenderOptions, render_view};
use train::report::ViewPair;

use crate::evaluate::{ViewScores, score_views_by};

/// Views shown in the report; more make it long, not clearer.
const MOST_VIEWS: usize = 15;
/// Scores a mesh on views, and shows it above them, at most `side` pixels wide: every so many where there are more than a
/// report has room for.
///
/// # Errors
/// If the mesh's faces cannot be drawn.
pub fn compare(
    mesh: &TriMesh,
    views: &[&View],
    side: usize,
) -> Result<(ViewScores, Vec<ViewPair>), FacesError> {
    let seen: Vec<(&View, &Camera)> = views.iter().map(|view| (*view, &view.camera)).collect();
    compare_by(mesh, &seen, side)
}

/// [`compare`] where each view has another camera than its own.
pub(super) fn compare_by(
    mesh: &TriMesh,
    views: &[(&View, &Camera)],
    side: usize,
) -> Result<(ViewScores, Vec<ViewPair>), FacesError> {
    let stride = views.len().div_ceil(MOST_VIEWS);
    // Renders arrive from any thread; a map keeps their order that of the views.
    let renders = Mutex::new(BTreeMap::new());
    let scores = score_views_by(mesh, views, &|index, render| {
        if index % stride == 0 {
            let (view, camera) = views[index];
            let shown = shown_from(mesh, &view.whole_camera(camera), render);
            let picture = close_up(&view.whole(), &shown, side);
            renders.lock().expect("no thread panicked").insert(index, picture);
        }
    })?;
    let pairs = renders.into_inner().expect("no thread panicked");
    let pairs = pairs.into_iter().map(|(index, (model, truth))| {
        let s = &scores.views[index];
        let psnr = s.psnr.map_or_else(String::new, |p| format!(", {p:.1} dB"));
        ViewPair { caption: format!("view {}: IoU {:.3}{psnr}", s.name, s.mask_iou), model, truth }
    });
    let pairs = pairs.collect();
    Ok((scores, pairs))
}

/// What the report shows of the mesh from a view. Scores are of what was rendered for them; what has no colours would be
/// a flat blob there, and shows its shape by light here.
fn shown_from(mesh: &TriMesh, camera: &Camera, scored: ByteImage) -> ByteImage {
    let lighting = Lighting::for_mesh(mesh);
    if lighting.is_flat() {
        return scored;
    }
    let options = RenderOptions { lighting, ..RenderOptions::default() };
    render_view(mesh, camera, &options).map_or(scored, |view| view.color)
}

/// Render and photograph around the object: a square with a margin, at most so wide.
fn close_up(view: &View, render: &ByteImage, most: usize) -> (ByteImage, ByteImage) {
    let truth = view.over([0; 3]);
    let Some([top, left, height, width]) = view.mask_bounds() else {
        return (render.clone(), truth);
    };
    let side = (height.max(width) * 5 / 4 + 4).min(view.color.width).min(view.color.height);
    let start = |low: usize, length: usize, limit: usize| {
        (low + length / 2).saturating_sub(side / 2).min(limit - side)
    };
    let x = start(left, width, view.color.width);
    let y = start(top, height, view.color.height);
    let picture = |image: &ByteImage| {
        let part = image.cropped(x, y, side, side);
        if side <= most { part } else { part.resized(most, most) }
    };
    (picture(render), picture(&truth))
}
