//! The scores of a prediction before it was refined.

use datasets::View;
use mesh_core::TriMesh;
use recon::delivery::DeliverError;
use recon::evaluate::{ViewScores, score_views};
use serde::Serialize;

use super::input::PredictInput;

/// How a mesh scored as the network made it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OnePass {
    /// The scores at the cameras that were given.
    pub given: ViewScores,
    /// The scores at cameras that were not; none where there are no others.
    pub held_out: Option<ViewScores>,
    /// Pairs of faces that cut through each other.
    pub self_intersections: usize,
}

impl OnePass {
    pub(super) fn of(mesh: &TriMesh, input: &PredictInput) -> Result<Self, DeliverError> {
        let scores = |views: &[View]| -> Result<ViewScores, DeliverError> {
            Ok(score_views(mesh, &views.iter().collect::<Vec<_>>(), &|_, _| ())?)
        };
        let held_out = (!input.others.is_empty()).then(|| scores(&input.others)).transpose()?;
        let self_intersections = mesh.self_intersections().len();
        Ok(Self { given: scores(&input.given)?, held_out, self_intersections })
    }
}
