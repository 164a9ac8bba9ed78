//! A textured mesh, its camera and the mean shapes that it is mixed from, from a user's photograph.

use ndarray::ArrayD;
use nets::onnx::OnnxModel;
use train::{DataError, PredictError, Subset, System as _};

use super::{Data, Mcmr};
use crate::parts::of_each;
use crate::predict::{PredictInput, Prediction, Predictor, Request, Sighting};

impl Predictor for Mcmr {
    const ABOUT: &'static str =
        "One photograph to a textured mesh, learned from photo collections of many categories";
    const TRAINING: &'static str = "`unsphere train mcmr -o runs/mine` trains one on made photographs, in seven minutes of one core \
         (a rough one with --preset tiny, in seconds)";

    fn load(&self, request: &Request<'_>) -> Result<PredictInput, DataError> {
        PredictInput::single(request)
    }

    fn to_onnx(&self) -> Option<OnnxModel> {
        Some(self.model.to_onnx(self.config.image_size))
    }

    fn onnx_outputs(&self, inputs: &[ArrayD<f32>]) -> Vec<ArrayD<f32>> {
        self.model.onnx_outputs(inputs)
    }

    fn apply(&self, input: &PredictInput) -> Result<Prediction, PredictError> {
        let found = self.predict(&input.given)?;
        let [x, y] = found.pose.place;
        let details = vec![
            ("selection", found.weights.iter().map(|&w| f64::from(w)).collect()),
            ("camera-scale", vec![found.pose.scale]),
            ("camera-place", vec![x, y]),
            ("camera-quaternion", found.pose.rotation.to_vec()),
            ("mesh-to-world", found.to_world.concat()),
        ];
        let mesh = found.mesh_in_world();
        Ok(Prediction { mesh, details, features: found.features, ..Prediction::default() })
    }

    fn features_of(
        &self,
        data: &Data,
        subset: Subset,
        most: usize,
    ) -> Result<Vec<Sighting>, DataError> {
        let objects = data.listed(subset);
        of_each(objects.len(), most, |k| {
            let photo = data.photo(objects[k])?;
            let family = data.category(objects[k]).1.to_owned();
            Ok(Sighting {
                family,
                features: self.features(&photo.plain(Subset::Test, &self.config)),
            })
        })
    }
}
