//! Scores of a mesh against views of the true object.

use datasets::View;
use diff_raster::FacesError;
use losses::metrics::{l1, mask_iou, psnr_inside, ssim};
use mesh_core::{ByteImage, Camera, Image, TriMesh};
use rayon::prelude::*;
use serde::Serialize;
use synth::{RenderOptions, render_view};

/// How well a mesh agrees with one view.
///
/// Both images are compared over black: the render's background, and the photograph outside of its
/// mask. Background that agrees lowers `image_l1` and raises `ssim`, as in the published tables, so
/// compare these two between meshes of one dataset only.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ViewScore {
    /// The view's name.
    pub name: String,
    /// Intersection over union of the hard masks: both say what is at each pixel's centre.
    pub mask_iou: f64,
    /// Mean absolute difference of the colours, over the whole image.
    pub image_l1: f64,
    /// PSNR over the pixels of the true mask, dB; none where that is empty, or the mesh has no colours.
    pub psnr: Option<f64>,
    /// Structural similarity over the whole image.
    pub ssim: f64,
}

/// How well a mesh agrees with a set of views: each view's score, and the means over views.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ViewScores {
    /// Mean of [`ViewScore::mask_iou`].
    pub mask_iou: f64,
    /// Mean of [`ViewScore::image_l1`].
    pub image_l1: f64,
    /// Mean of [`ViewScore::psnr`] over the views that have one.
    pub psnr: Option<f64>,
    /// Mean of [`ViewScore::ssim`].
    pub ssim: f64,
    /// View by view, in their order.
    pub views: Vec<ViewScore>,
}

/// Scores the mesh on the views, on all of their images; each render is handed to `keep` with its view's index.
///
/// `keep` is called from any thread, in any order.
///
/// # Errors
/// If a face names a vertex that is not there.
///
/// # Panics
/// If there are no views, or image and mask of one differ in size (see [`View::validate`]).
pub fn score_views(
    mesh: &TriMesh,
    views: &[&View],
    keep: &(dyn Fn(usize, ByteImage) + Sync),
) -> Result<ViewScores, FacesError> {
    let seen: Vec<(&View, &Camera)> = views.iter().map(|view| (*view, &view.camera)).collect();
    score_views_by(mesh, &seen, keep)
}

/// [`score_views`] where each view has another camera than its own.
///
/// # Errors
/// If a face names a vertex that is not there.
///
/// # Panics
/// As [`score_views`].
pub fn score_views_by(
    mesh: &TriMesh,
    views: &[(&View, &Camera)],
    keep: &(dyn Fn(usize, ByteImage) + Sync),
) -> Result<ViewScores, FacesError> {
    assert!(!views.is_empty(), "score_views: no views");
    let options = RenderOptions::default();
    let is_colored = mesh.colors.is_some() || mesh.texture.is_some();
    // One view at a time, so that the renders of large views do not pile up.
    let scores = views
        .par_iter()
        .enumerate()
        .map(|(index, (view, camera))| {
            let render = render_view(mesh, &view.whole_camera(camera), &options)?;
            let mut score = score(&render, &view.whole());
            // Grey stands for a colour that nobody gave.
            score.psnr = score.psnr.filter(|_| is_colored);
            keep(index, render.color);
            Ok(score)
        })
        .collect::<Result<Vec<_>, FacesError>>()?;
    let mean =
        |value: fn(&ViewScore) -> f64| scores.iter().map(value).sum::<f64>() / scores.len() as f64;
    let psnr: Vec<f64> = scores.iter().filter_map(|s| s.psnr).collect();
    Ok(ViewScores {
        mask_iou: mean(|s| s.mask_iou),
        image_l1: mean(|s| s.image_l1),
        psnr: (!psnr.is_empty()).then(|| psnr.iter().sum::<f64>() / psnr.len() as f64),
        ssim: mean(|s| s.ssim),
        views: scores,
    })
}

fn score(render: &View, truth: &View) -> ViewScore {
    let model = Image::from(&render.color);
    let mask = Image::from(&truth.mask);
    let photograph = Image::from(&truth.over([0; 3]));
    ViewScore {
        name: truth.name.clone(),
        mask_iou: mask_iou(&Image::from(&render.mask), &mask),
        image_l1: l1(&model, &photograph),
        psnr: psnr_inside(&model, &photograph, &mask),
        ssim: ssim(&model, &photograph),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::turntable::orbit;
    use mesh_core::primitives::icosphere;
    use synth::render_views;

    fn ball(radius: f32, shade: f32) -> TriMesh {
        let mut mesh = icosphere(4);
        mesh.positions.iter_mut().flatten().for_each(|v| *v *= radius);
        mesh.colors = Some(vec![[shade; 3]; mesh.positions.len()]);
        mesh
    }

    #[test]
    fn a_mesh_scores_full_marks_on_its_own_renders() {
        let mesh = ball(1.0, 0.6);
        let cameras = orbit(mesh.bounds().unwrap(), 3, 0.2, 48);
        let views = render_views(&mesh, &cameras, &RenderOptions::default(), &|_, _| ()).unwrap();
        let views: Vec<&View> = views.iter().collect();
        let scores = score_views(&mesh, &views, &|_, _| ()).unwrap();
        assert_eq!(scores.mask_iou, 1.0);
        // The render's rim is blended with the background where the mask's is not.
        assert!(scores.image_l1 < 0.01, "{}", scores.image_l1);
        assert!(scores.psnr.is_some());
        let gray = score_views(&TriMesh { colors: None, ..mesh }, &views, &|_, _| ()).unwrap();
        assert_eq!((gray.mask_iou, gray.psnr), (1.0, None));
    }

    #[test]
    fn scores_are_those_of_the_geometry() {
        // Balls of radius 1 and 0.8 seen from far away: areas are as 1 to 0.64.
        let truth = ball(1.0, 0.6);
        let camera = Camera::look_at([0.0, 0.0, 60.0], [0.0; 3], [0.0, 1.0, 0.0], 0.05, 256, 256);
        let options = RenderOptions { supersample: 1, ..RenderOptions::default() };
        let view = render_view(&truth, &camera, &options).unwrap();
        let scores = score_views(&ball(0.8, 0.5), &[&view], &|_, _| ()).unwrap();
        assert!((scores.mask_iou - 0.64).abs() < 0.01, "{}", scores.mask_iou);
        // Inside the true mask: 0.1 off on 64 %, 0.6 off on 36 %.
        let psnr = -10.0 * (0.64f64 * 0.01 + 0.36 * 0.36).log10();
        assert!((scores.psnr.unwrap() - psnr).abs() < 0.1, "{:?} {psnr}", scores.psnr);
    }
}
