//! A mesh from all of a user's views.

use ndarray::ArrayD;
use nets::onnx::OnnxModel;
use train::{PredictError, System as _};

use super::{Img2Mesh, Img2MeshConfig};
use crate::predict::{PredictInput, Prediction, Predictor};

impl Predictor for Img2Mesh {
    const ABOUT: &'static str = "Several views to one mesh, learned from images and masks";
    const TRAINING: &'static str = "`unsphere train img2mesh VIEWS -o runs/mine` trains one, in about three minutes on two \
         cores (a rough one with --preset tiny, in seconds)";

    const REFINE: usize = 50;

    fn input(_: &Img2MeshConfig) -> String {
        "views of one object: images, masks and cameras".to_owned()
    }

    fn apply(&self, input: &PredictInput) -> Result<Prediction, PredictError> {
        Ok(Prediction { mesh: self.predict(&input.given)?, ..Prediction::default() })
    }

    fn to_onnx(&self) -> Option<OnnxModel> {
        self.model.to_onnx(self.config.image_size)
    }

    fn onnx_outputs(&self, inputs: &[ArrayD<f32>]) -> Vec<ArrayD<f32>> {
        self.model.onnx_outputs(inputs)
    }
}
