//! What is done to predictions at test time.

use recon::fit::{RefineConfig, refine, solidify};
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

/// Makes a solid of a mesh whose faces run through each other: [`solidify`]. How many pairs did is kept among the
/// [`details`](Prediction::details), as `self-intersections-before`. A sound mesh stays as it is, and so does the mesh before any refinement.
///
/// # Errors
/// If the mesh is not closed, or encloses nothing.
pub fn solidified(prediction: Prediction) -> Result<Prediction, PredictError> {
    let pairs = prediction.mesh.self_intersections().len();
    if pairs == 0 {
        return Ok(prediction);
    }
    let mesh = solidify(&prediction.mesh).map_err(DataError::unfit)?;
    let mut details = prediction.details;
    details.push(("self-intersections-before", vec![pairs as f64]));
    Ok(Prediction { mesh, details, ..prediction })
}
