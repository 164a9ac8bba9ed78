//! A single image's mesh and its way there, from a user's files.

use train::{DataError, PredictError};

use super::deformer::Deformer;
use super::single_view::SingleView;
use crate::predict::{PredictInput, Prediction, Predictor, Request};

/// Meshes of a deformation through time.
const FRAMES: usize = 25;

impl<D: Deformer> Predictor for SingleView<D> {
    const ABOUT: &'static str = D::ABOUT;
    const TRAINING: &'static str = D::TRAINING;

    fn load(&self, request: &Request<'_>) -> Result<PredictInput, DataError> {
        PredictInput::single(request)
    }

    fn apply(&self, input: &PredictInput) -> Result<Prediction, PredictError> {
        let picture = self.picture(&input.given)?;
        let (mesh, sequence) =
            self.mesh_and_sequence_of(&picture, FRAMES).map_err(PredictError::solve)?;
        let in_world = |mesh| picture.frame.mesh_in_world(mesh);
        Ok(Prediction {
            mesh: in_world(mesh),
            sequence: sequence.into_iter().map(in_world).collect(),
            ..Prediction::default()
        })
    }
}
