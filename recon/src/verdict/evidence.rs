//! What speaks for and against a fit.

use datasets::{View, Views};
use diff_raster::FacesError;
use mesh_core::Camera;
use serde::{Deserialize, Serialize};

use super::disagreement::{self, Disagreement};
use crate::fit::Fitted;
use crate::inspect::{Coherence, LensFit, Window, fitness_of, unseen_of};

/// What a verdict is made of: figures that depend on views and mesh alone, without any truth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Evidence {
    /// Mean mask IoU of the views that were held out; of all where none was.
    pub mask_iou: f64,
    /// Mean mask IoU of the views that the mesh was fitted to.
    pub fitted_iou: f64,
    /// Views that the mesh was fitted to.
    pub fitted_views: usize,
    /// How the masks fit together, under the cameras that the mesh agrees with; none where they fix no body.
    pub coherence: Option<Coherence>,
    /// A lens that explains the masks better than the one of the cameras that the mesh agrees with, which may be refined, beside the one that
    /// was given; none where no other does.
    pub lens: Option<LensFit>,
    /// How far outside of the masks' edges the colours change most, pixels of an image of at most 320; negative where masks are too
    /// large, none where images do not tell.
    pub mask_edge: Option<f64>,
    /// Share of all directions that a surface can face in which no fitted view sees it, and the axis nearest to their middle.
    pub unseen: (f64, String),
    /// How far the outlines moved because cameras were refined, pixels of an image of at most 320; 0 where they were not.
    pub motion: f64,
    /// Pairs of faces that run through each other.
    pub self_intersections: usize,
    /// Whether the mesh is closed.
    pub closed: bool,
    /// The views, those that disagree most first.
    #[serde(rename = "worst_views")]
    pub views: Vec<Disagreement>,
}

impl Evidence {
    /// Looks at a fit from all of its views, whose images and masks must still be there.
    ///
    /// # Cost
    /// A silhouette for each view, at most 320 pixels wide, and what
    /// [`inspect_views`](crate::inspect::inspect_views) takes for its finer figures: about a second for a hundred views.
    ///
    /// # Errors
    /// If a face names a vertex that is not there.
    pub fn of(views: &Views, fitted: &Fitted) -> Result<Self, FacesError> {
        let camera = |i: usize| cameras(fitted, &views.views, i);
        let shown: Vec<usize> =
            fitted.train_views.iter().chain(&fitted.held_out_views).copied().collect();
        let seen: Vec<_> = shown.iter().map(|&i| (i, &views.views[i], camera(i))).collect();
        let mut judged = disagreement::of_views(&fitted.mesh, &seen)?;
        let mean = |of: &[usize]| {
            let ious = judged.iter().filter(|view| of.contains(&view.index)).map(|v| v.mask_iou);
            ious.sum::<f64>() / of.len().max(1) as f64
        };
        let fitted_iou = mean(&fitted.train_views);
        let held_out = &fitted.held_out_views;
        let mask_iou = if held_out.is_empty() { fitted_iou } else { mean(held_out) };
        judged.sort_by(|a, b| a.mask_iou.total_cmp(&b.mask_iou).then(a.index.cmp(&b.index)));
        let train: Vec<(&View, &Camera)> =
            fitted.train_views.iter().map(|&i| (&views.views[i], camera(i))).collect();
        let fitness = fitness_of(&train);
        // What was found is beside the lens of these cameras, which may be refined.
        let refined = fitted.cameras.as_ref().map_or(1.0, |refined| refined.focal);
        let given = |lens: LensFit| LensFit { focal: refined * lens.focal, ..lens };
        let seen = fitted.train_views.iter().map(|&i| camera(i));
        let scales = shown.iter().map(|&i| Window::of(&views.views[i]).scale());
        let brought = 1.0 / scales.fold(1.0, f64::max);
        Ok(Self {
            mask_iou,
            fitted_iou,
            fitted_views: fitted.train_views.len(),
            coherence: fitness.map(|fitness| fitness.coherence),
            lens: fitness.and_then(|fitness| fitness.lens).map(given),
            mask_edge: fitness.and_then(|fitness| fitness.mask_edge),
            unseen: unseen_of(seen, fitted.placement.center),
            motion: fitted.cameras.as_ref().map_or(0.0, |refined| brought * refined.motion),
            self_intersections: fitted.self_intersections,
            closed: fitted.health.is_watertight(),
            views: judged,
        })
    }

    /// How many views have what is asked for.
    pub(super) fn count(&self, wanted: impl Fn(&Disagreement) -> bool) -> usize {
        self.views.iter().filter(|view| wanted(view)).count()
    }
}

/// The camera of a view that the mesh agrees with.
pub(super) fn cameras<'a>(fitted: &'a Fitted, views: &'a [View], i: usize) -> &'a Camera {
    fitted.cameras.as_ref().map_or(&views[i].camera, |refined| &refined.cameras[i])
}
