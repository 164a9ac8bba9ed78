//! Refinement of predictions at test time.

use recon::fit::{RefineConfig, refine};
use train::{DataError, PredictError};

use super::input::PredictInput;
use super::predictor::Prediction;

/// Moves a predicted mesh until its outlines agree with the views that were given, whose colours it takes
/// where they show it: [`refine`]. The mesh as the network made it is kept as [`before`](Prediction::before); views that were not
/// given are not looked at. With 0 steps nothing changes.
///
/// # Errors
/// If no given view shows the object, or the mesh does not lie before the cameras.
pub fn refined(
    prediction: Prediction,
    input: &PredictInput,
    config: &RefineConfig,
) -> Result<Prediction, PredictError> {
    if config.steps == 0 {
        return Ok(prediction);
    }
    let mesh = refine(&prediction.mesh, &input.given, config).map_err(DataError::unfit)?;
    Ok(Prediction { before: Some(prediction.mesh), mesh, ..prediction })
}
