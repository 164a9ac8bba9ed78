//! The part of a generic system that is compiled once.

use autodiff_lite::Tape;
use datasets::View;
use mesh_core::TriMesh;
use ndarray::ArrayD;
use train::{DataError, LossError, Metric, PredictError, Shown, StepInfo, Subset, Terms};

use crate::predict::{PredictInput, Prediction};

/// What of a generic system runs its network, by its data and samples.
///
/// A table of functions that each instance of the system hands out: so they are compiled in this crate, and not once more in
/// every crate that names the system.
pub trait Instance<Data, Sample> {
    /// See [`System::loss`](train::System::loss).
    ///
    /// # Errors
    /// As there.
    fn loss<'t>(
        &self,
        tape: &'t Tape,
        batch: &[Sample],
        at: StepInfo,
    ) -> Result<Terms<'t>, LossError>;

    /// See [`System::evaluate`](train::System::evaluate).
    ///
    /// # Errors
    /// As there.
    fn evaluate(&self, data: &Data, subset: Subset) -> Result<Vec<Metric>, DataError>;

    /// See [`System::show`](train::System::show).
    ///
    /// # Errors
    /// As there.
    fn show(&self, data: &Data, subset: Subset) -> Result<Shown, DataError>;

    /// See [`System::predict`](train::System::predict).
    ///
    /// # Errors
    /// As there.
    fn predict(&self, views: &[View]) -> Result<TriMesh, PredictError>;

    /// See [`Predictor::apply`](crate::predict::Predictor::apply).
    ///
    /// # Errors
    /// As there.
    fn apply(&self, input: &PredictInput) -> Result<Prediction, PredictError>;

    /// See [`Predictor::onnx_outputs`](crate::predict::Predictor::onnx_outputs).
    ///
    /// # Shapes
    /// As there.
    fn image_side_outputs(&self, inputs: &[ArrayD<f32>]) -> Vec<ArrayD<f32>>;
}
