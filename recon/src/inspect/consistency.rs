//! How well cameras fit masks, for whoever moves cameras: the mean gap alone, of the same outlines under other cameras.

use datasets::View;
use mesh_core::Camera;
use rayon::prelude::*;

use super::coherence::Outlines;
use super::finer::roomy;
use super::hull::{Sphere, bounding_sphere};
use super::mask_view::MaskView;
use super::silhouette::Silhouette;

/// Views that are looked at; of more, evenly chosen ones.
const VIEWS: usize = 32;
/// Places on each outline.
const PLACES: usize = 100;

/// The outlines of some views.
#[derive(Debug)]
pub(crate) struct Consistency {
    silhouettes: Vec<Silhouette>,
    /// Which of the views they are.
    chosen: Vec<usize>,
    sphere: Sphere,
}

impl Consistency {
    /// `None` where the masks fix no body.
    pub(crate) fn of(views: &[&View]) -> Option<Self> {
        let step = views.len().div_ceil(VIEWS).max(1);
        let chosen: Vec<usize> = (0..views.len()).step_by(step).collect();
        let mask_views: Vec<MaskView> =
            chosen.par_iter().map(|&i| MaskView::new(views[i])).collect();
        let silhouettes = chosen.par_iter().map(|&i| Silhouette::new(views[i])).collect();
        Some(Self { silhouettes, chosen, sphere: roomy(bounding_sphere(&mask_views)?) })
    }

    /// The mean gap in pixels of an image of at most 320 under these cameras, one for each of the views.
    pub(crate) fn gap(&self, cameras: &[Camera]) -> f64 {
        let with = |(silhouette, &i): (&Silhouette, &usize)| {
            silhouette.with(silhouette.window.camera(&cameras[i]))
        };
        let views: Vec<Silhouette> = self.silhouettes.iter().zip(&self.chosen).map(with).collect();
        Outlines { views: &views, sphere: self.sphere }.mean_gap(PLACES, f64::INFINITY)
    }
}
