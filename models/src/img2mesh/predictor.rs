//! A mesh from all of a user's views.

use std::sync::Arc;

use autodiff_lite::Tape;
use datasets::View;
use ndarray::ArrayD;
use nets::onnx::OnnxModel;
use recon::fit::RefineConfig;
use train::{DataError, PredictError, Subset};

use super::canonical::{Canonical, Placed, Tried, around_the_object};
use super::prepared::Prepared;
use super::{Data, Img2Mesh, Img2MeshConfig, image_tensor};
use crate::parts::of_each;
use crate::predict::{Features, PredictInput, Prediction, Predictor, Sighting};

/// Of a lower IoU with the masks that it is made from, a mesh may be of an object that was seen from a side that it does not expect.
const LIKE: f64 = 0.6;
/// Of a lower one it may still be turned by a quarter or a half, as other worlds are whose axes have other names (R2N2's ShapeNet is
/// turned by a quarter beside ours). This and the next chosen among five pairs on validation objects (`studies/examples/turned.rs`).
const SURE: f64 = 0.85;
/// By how much more another side must fit the masks then.
const BETTER: f64 = 0.05;

impl Img2Mesh {
    /// What was found in the frame of the model, in the world of the views.
    fn brought_back(&self, found: Tried, seen: &[Arc<Prepared>]) -> Prediction {
        let Tried { placed, mesh, .. } = found;
        Prediction {
            mesh: placed.back(mesh),
            features: self.features(seen),
            details: placed.details(),
            warnings: vec![placed.remark()],
            ..Prediction::default()
        }
    }
}

impl Predictor for Img2Mesh {
    const ABOUT: &'static str = "Several views to one mesh, learned from images and masks";
    const TRAINING: &'static str = "`unsphere train img2mesh VIEWS -o runs/mine` trains one, in five minutes of one core \
         (a rough one with --preset tiny, in seconds)";

    const REFINE: usize = 100;

    /// Of what views say nothing the network knows more than their hull, and their mirror images more than the network.
    fn refinement(steps: usize) -> RefineConfig {
        RefineConfig {
            steps,
            tolerance: -0.01,
            smoothness: 4.0,
            symmetry: true,
            ..RefineConfig::default()
        }
    }

    fn input(_: &Img2MeshConfig) -> String {
        "views of one object: images, masks and cameras".to_owned()
    }

    /// Views of another world than that of the training are moved into its frame, and the mesh back: see `canonical.rs`.
    fn apply(&self, input: &PredictInput) -> Result<Prediction, PredictError> {
        let given = &input.given;
        let seen = self.prepared(given)?;
        let (mesh, likeness) = self.judged(&seen);
        let asis = Prediction { mesh, features: self.features(&seen), ..Prediction::default() };
        let frame: [f32; 4] = std::array::from_fn(|k| self.model.frame.as_slice()[k]);
        let canonical = Canonical::new(frame.map(f64::from));
        let holds = canonical.holds(given);
        if holds && likeness >= SURE {
            return Ok(asis);
        }
        let judged = |seen: &[Arc<Prepared>], views: &[View], placed: &Placed| {
            let cameras = views.iter().map(|view| placed.camera(&view.camera));
            let moved = seen.iter().zip(cameras).map(|(seen, camera)| seen.through(&camera));
            self.judged(&moved.map(Arc::new).collect::<Vec<_>>())
        };
        let (mut found, mut most) = (asis, likeness);
        if holds {
            let side = canonical.best_side(|placed| judged(&seen, given, placed));
            if side.likeness > likeness + BETTER {
                most = side.likeness;
                found = self.brought_back(side, &seen);
            }
            if most >= LIKE {
                return Ok(found);
            }
        }
        let cut: Vec<View> = given.iter().map(around_the_object).collect();
        let prepared = self.prepared(&cut)?;
        let best = canonical.best(given, |placed| judged(&prepared, &cut, placed));
        Ok(match best {
            Some(best) if best.likeness > most => self.brought_back(best, &prepared),
            _ => found,
        })
    }

    /// The first group of views of each object that is scored; of one object alone there is no family.
    fn features_of(
        &self,
        data: &Data,
        subset: Subset,
        most: usize,
    ) -> Result<Vec<Sighting>, DataError> {
        let count = if data.is_one() { 0 } else { data.listed(subset).len() };
        of_each(count, most, |k| {
            let trial = data.trial(&self.config, (subset, self.config.views), k)?;
            Ok(Sighting { features: self.features(&trial.given), family: trial.family })
        })
    }

    fn to_onnx(&self) -> Option<OnnxModel> {
        self.model.to_onnx(self.config.image_size)
    }

    fn onnx_outputs(&self, inputs: &[ArrayD<f32>]) -> Vec<ArrayD<f32>> {
        self.model.onnx_outputs(inputs)
    }
}

impl Img2Mesh {
    /// What the encoder says of each view, whatever its camera.
    fn features(&self, views: &[Arc<Prepared>]) -> Features {
        let tape = Tape::eval();
        let features =
            self.model.encode(image_tensor(&tape, self.config.image_size, views)).value();
        features.as_slice().chunks(self.config.width()).map(<[f32]>::to_vec).collect()
    }
}
