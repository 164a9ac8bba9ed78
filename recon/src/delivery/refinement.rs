//! What is delivered of refined cameras.

use datasets::View;
use diff_raster::FacesError;
use mesh_core::Camera;
use serde::Serialize;

use crate::evaluate::{ViewScores, score_views_by};
use crate::fit::Fitted;

/// What became of cameras that were refined.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Refinement {
    /// The focal length, times the one given.
    pub focal: f64,
    /// How far the outlines moved in the images, root mean square in pixels.
    pub motion: f64,
    /// Distance of the outlines to the masks before and after, root mean square in pixels.
    pub distance: [f64; 2],
    /// How far outlines miss one another before and after, mean in pixels of an image of at most 320, measured without the mesh.
    pub gap: [f64; 2],
    /// The scores on held-out views if their poses, which are as far off as the others were, are found from their own masks by the
    /// finished mesh; none where no view is held out.
    pub located: Option<ViewScores>,
}

impl Refinement {
    /// Of a fit to these views; none where it left the cameras alone.
    pub(super) fn of(fitted: &Fitted, views: &[View]) -> Result<Option<Self>, FacesError> {
        let Some(found) = &fitted.cameras else { return Ok(None) };
        let held_out = fitted.held_out_views.iter().zip(&found.located);
        let seen: Vec<(&View, &Camera)> =
            held_out.map(|(&i, camera)| (&views[i], camera)).collect();
        let located = if seen.is_empty() {
            None
        } else {
            Some(score_views_by(&fitted.mesh, &seen, &|_, _| ())?)
        };
        let (focal, motion, distance, gap) = (found.focal, found.motion, found.distance, found.gap);
        Ok(Some(Self { focal, motion, distance, gap, located }))
    }
}
