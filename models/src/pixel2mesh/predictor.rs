//! A single image's mesh and its way there, from a user's files.

use autodiff_lite::Tape;
use mesh_core::TriMesh;
use ndarray::ArrayD;
use nets::onnx::OnnxModel;
use train::{DataError, PredictError, Subset};

use super::camera::{Estimate, Seen};
use super::config::CameraSource;
use super::deformer::Deformer;
use super::framing::framed;
use super::single_view::{SingleView, maps};
use crate::paired::{FrameKind, InputImage, Pairs};
use crate::parts::of_each;
use crate::predict::{
    Detail, Features, PredictInput, Prediction, Predictor, Request, Sighting, strongest,
};
use crate::viewpoint::as_seen;

/// Meshes of a deformation through time.
const FRAMES: usize = 25;

impl<D: Deformer> Predictor for SingleView<D> {
    const ABOUT: &'static str = D::ABOUT;
    const TRAINING: &'static str = D::TRAINING;

    /// An image that has no camera is framed as those that were learned. In the object's frame an image that has no camera is given the one that is estimated, so that its mesh stands upright.
    fn load(&self, request: &Request<'_>) -> Result<PredictInput, DataError> {
        let mut input = PredictInput::single(request)?;
        if !input.camera_assumed {
            return Ok(input);
        }
        if let Some(view) = framed(&input.given[0]) {
            input.given[0] = view;
            let text = "the part of the image around the object was taken, as large and as far in the middle as in those that were learned";
            input.warnings.push(text.to_owned());
        }
        if self.shared().frame == FrameKind::Object {
            self.give_camera(&mut input)?;
        }
        Ok(input)
    }

    fn input(config: &D::Config) -> String {
        let shared = D::shared(config);
        let camera = match (shared.frame, shared.camera) {
            (FrameKind::Camera, _) => "",
            (_, CameraSource::Estimated) => ", whose camera is estimated",
            _ if shared.has_camera_head() => {
                ", and its camera, which is estimated where it has none"
            }
            _ => ", and its camera in the object's frame",
        };
        format!("one image with its mask{camera}")
    }

    fn features_of(
        &self,
        data: &Pairs,
        subset: Subset,
        most: usize,
    ) -> Result<Vec<Sighting>, DataError> {
        of_each(data.listed(subset).len(), most, |k| {
            let [object, view] = data.tried(subset, 1, k)?;
            let family = data.name(object)[0].to_owned();
            Ok(Sighting { family, features: self.features(&*data.image(object, view)?) })
        })
    }

    fn to_onnx(&self) -> Option<OnnxModel> {
        Some(self.image_side_to_onnx())
    }

    fn onnx_outputs(&self, inputs: &[ArrayD<f32>]) -> Vec<ArrayD<f32>> {
        D::instance(self).image_side_outputs(inputs)
    }

    fn apply(&self, input: &PredictInput) -> Result<Prediction, PredictError> {
        D::instance(self).apply(input)
    }
}

impl<D: Deformer> SingleView<D> {
    /// The mesh and its way there, in the world of the given camera.
    pub(super) fn applied(&self, input: &PredictInput) -> Result<Prediction, PredictError> {
        let image = self.image(&input.given)?;
        let estimate = match self.seen(&image).map_err(PredictError::solve)? {
            Seen::Told(..) => None,
            Seen::Estimated(estimate) => Some(estimate),
        };
        let through = estimate.as_ref().map(|estimate| image.seen_by(estimate.camera.clone()));
        let (mesh, sequence) = self
            .mesh_and_sequence_of(through.as_ref().unwrap_or(&image), FRAMES)
            .map_err(PredictError::solve)?;
        let in_world = |mesh: TriMesh| {
            let mesh = image.frame.mesh_in_world(mesh);
            match &estimate {
                None => mesh,
                Some(Estimate { camera, .. }) => as_seen(mesh, camera, &image.camera),
            }
        };
        Ok(Prediction {
            features: self.features(&image),
            mesh: in_world(self.shared().pairs.finished(mesh)),
            sequence: sequence.into_iter().map(in_world).collect(),
            details: estimate.iter().flat_map(details).collect(),
            ..Prediction::default()
        })
    }

    fn features(&self, image: &InputImage) -> Features {
        let tape = Tape::eval();
        let [.., last] = maps(&self.encoder, self.pixels(&tape, &[image]));
        strongest(&[last])
    }

    /// Puts the estimated camera in the place of the assumed one, and says so.
    pub(super) fn give_camera(&self, input: &mut PredictInput) -> Result<(), DataError> {
        let refused = |what: &str| {
            let source = input.source.display();
            DataError::Unfit(format!("{source}: {what}"))
        };
        let image = self.image(&input.given).map_err(|error| refused(&error.to_string()))?;
        let estimate = self.estimate(&image).map_err(|error| refused(&error.to_string()))?;
        let Some(Estimate { camera, hypothesis, outline, .. }) = estimate else {
            let what = "no camera, expected views with cameras (a folder) or a checkpoint that estimates them \
                        (`camera-weight` above 0)";
            return Err(refused(what));
        };
        let view = &mut input.given[0];
        view.camera = camera.resized(view.camera.width, view.camera.height);
        let at = hypothesis.viewpoint;
        let warning = format!(
            "the camera of a single image is estimated: azimuth {:.0}, elevation {:.0} degrees (held {:.0} % likely; the outline \
             agrees by {outline:.2}), through a lens of 35 mm on a sensor 32 mm wide, the object in the middle",
            at.azimuth.to_degrees().rem_euclid(360.0),
            at.elevation.to_degrees(),
            100.0 * hypothesis.probability,
        );
        input.warnings.retain(|warning| !warning.starts_with("the camera of a single image"));
        input.warnings.push(warning);
        Ok(())
    }
}

/// What is known of an estimated camera.
fn details(estimate: &Estimate) -> Vec<Detail> {
    let at = estimate.hypothesis.viewpoint;
    let degrees = [at.azimuth, at.elevation].map(f64::to_degrees);
    vec![
        ("camera azimuth and elevation", degrees.to_vec()),
        ("camera probability", vec![estimate.hypothesis.probability]),
        ("camera outline IoU", vec![estimate.outline]),
        ("cameras tried", vec![estimate.tried as f64]),
    ]
}
