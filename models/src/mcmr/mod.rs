//! MCMR: photographs of many kinds of objects, one of each object, with a mask and a rough pose, to textured meshes.
//!
//! ```text
//! image [B, S, S, 3] -> ResNet-18 -> map -> code [B, D]
//!   code -> selection w [B, N] (softmax)      mean shape = Σ w_i V_i, the V_i learned, spheres at first
//!   [code, w, vertex] -> offset of the vertex, one network for all      shape = mean shape + offsets
//!   code -> camera (size, place, quaternion)      map -> texture around the sphere
//! shape, texture, rough camera -> DIB-R or SoftRas -> masks, colours, smoothness
//! ```
//!
//! Nobody says which image shows what: mean shapes specialise because it pays. What the network knows of a
//! vertex is where it is, so the mesh can be [subdivided](McmrConfig::subdivide_at) in the middle of the
//! training. Half of the predictions are compared with mirrored images, so shapes become symmetric in x.
//!
//! # What differs from the published code
//!
//! In the presets `paper` only: y is up, and shapes are not mirrored; pixels have their centres in their middles;
//! without its weights a pyramid of differences stands in for LPIPS. Elsewhere too:
//!
//! - DIB-R draws ([`RendererKind::SoftRas`] is the original's way).
//! - The texture has no seam: its last columns fade into its first, poles are one colour, and it is looked up by
//!   direction at every pixel ([`McmrConfig::closed_texture`]).
//! - Cameras may be several viewpoints of a network of its own, of which the outline chooses, and training may draw with them
//!   in the place of the rough ones ([`CameraHead::Viewpoint`], [`McmrConfig::own_cameras_at`]).
//! - The optimiser's moments survive the subdivision ([`McmrConfig::keep_moments`]).
//! - LPIPS is given images in the range that it expects ([`McmrConfig::lpips_from_zero`]).
//! - The size that is predicted begins at 1 ([`McmrConfig::first_size`]).
//! - Spheres may differ at first, and two terms can keep a selection from collapsing ([`McmrConfig::perturb`],
//!   [`McmrConfig::balance_weight`], [`McmrConfig::decision_weight`]).
//! - Rotations may be compared by the sine of half their angle, which decides between front and back
//!   ([`McmrConfig::rotation_loss`]), and Laplacians may be as strong on a finer mesh
//!   ([`McmrConfig::laplacian_by_faces`]).
//!
//! # References
//! Simoni, Pini, Vezzani, Cucchiara 2021, *Multi-Category Mesh Reconstruction From Image Collections*, and its
//! code; Kanazawa et al. 2018, *Learning Category-Specific Mesh Reconstruction from Image Collections*.

mod camera;
mod config;
mod data;
mod gallery;
mod mesh_pairs;
mod model;
mod noise;
mod onnx;
mod perceptual;
mod photo;
mod pose;
mod prediction;
mod predictor;
#[cfg(test)]
mod published_tests;
mod render;
mod replaced;
mod score;
mod shapes;
mod size;
#[cfg(test)]
mod tests;
mod texture;
mod upright;

use std::borrow::Cow;
use std::sync::Arc;

use autodiff_lite::{Tape, Var, impl_module};
use datasets::View;
use mesh_core::cotangent_laplacian;
use nets::{LoadWeights, NormKind};
use recon::scene::scene_of;
use train::{
    Compile, Compiled, DataError, DataSummary, Draw, Inherited, LossError, Metric, OptimizerState,
    PredictError, Shown, Source, StepInfo, Subset, Summary, System, Terms,
};

use crate::pretrained::unusable;
use crate::stacked::stacked;
use model::{Model, Predicted};
use noise::noise;
use photo::lens_of;
use render::{Rendered, TexturedRenderer};
use shapes::{Split, Template};

pub use config::{CameraHead, McmrConfig, RendererKind, RotationLoss};
pub use data::Data;
pub use perceptual::PerceptualMetrics;
pub use photo::{Photo, Sample};
pub use pose::{CommonLens, Pose};
pub use prediction::McmrPrediction;
pub use replaced::{Replaced, Selection};
pub use score::{Scored, ScoredObject};

/// Below this a weight of the selection has no logarithm.
const LEAST: f32 = 1e-8;
/// Faces of the icosphere of level 2, which the weights of Laplacians are given for.
const FACES: f64 = 320.0;

/// The system; see the [module](self).
#[derive(Debug)]
pub struct Mcmr {
    config: McmrConfig,
    model: Model,
    template: Template,
    renderer: TexturedRenderer,
}

impl_module!(Mcmr: f32 = model);

impl Mcmr {
    /// The options.
    pub fn config(&self) -> &McmrConfig {
        &self.config
    }

    /// What becomes of images.
    fn predicted<'t>(&self, tape: &'t Tape, samples: &[&Sample]) -> Predicted<'t> {
        self.predicted_from(tape, samples, None)
    }

    /// The same from these weights of the mean shapes, `[B, N]`, where there are any.
    fn predicted_from<'t>(
        &self,
        tape: &'t Tape,
        samples: &[&Sample],
        weights: Option<&[f32]>,
    ) -> Predicted<'t> {
        let n = samples.len();
        let images = self.images(tape, samples);
        let weights = weights.map(|w| stacked(tape, [w].into_iter(), &[n, w.len() / n]));
        self.model.forward(tape, images, weights)
    }

    /// What the network is shown of samples, `[B, S, S, 3]`.
    fn images<'t>(&self, tape: &'t Tape, samples: &[&Sample]) -> Var<'t> {
        let (n, side) = (samples.len(), self.config.image_size);
        let images: Vec<_> = if self.config.blind {
            samples.iter().map(|sample| Cow::Owned(noise(&sample.image))).collect()
        } else {
            samples.iter().map(|sample| Cow::Borrowed(&sample.image[..])).collect()
        };
        stacked(tape, images.iter().map(|image| &image[..]), &[n, side, side, 3])
    }

    /// Predictions as they are seen in these poses.
    fn drawn<'t>(&self, tape: &'t Tape, predicted: &Predicted<'t>, poses: &[Pose]) -> Rendered<'t> {
        let lens = lens_of(&self.config);
        let rows: Vec<[f32; 12]> = poses.iter().map(|pose| pose.projection(lens)).collect();
        let matrices = stacked(tape, rows.iter().map(|row| &row[..]), &[poses.len(), 3, 4]);
        self.renderer.render(tape, predicted.positions, predicted.texture, matrices)
    }

    /// Each face in four.
    fn refine(&mut self) -> Split {
        let (template, split) = self.template.subdivided();
        self.model.shapes = split.shapes(&self.model.shapes);
        self.renderer = TexturedRenderer::new(&template, &self.config);
        self.template = template;
        split
    }

    /// What keeps the surface smooth and near the mean shape.
    fn regularised<'t>(&self, terms: Terms<'t>, predicted: &Predicted<'t>) -> Terms<'t> {
        let (c, neighbors) = (&self.config, &self.template.topology.vertex_vertices);
        let Predicted { positions, offsets, .. } = *predicted;
        let faces = self.template.corners.len() as f64;
        let smooth = if c.laplacian_by_faces { faces / FACES } else { 1.0 };
        let laplacian = |of| losses::laplacian_norm(of, neighbors);
        let mut terms = terms
            .with("deform", c.deform_weight, losses::deformation_norm(offsets))
            .with("laplacian", smooth * c.laplacian_weight, laplacian(positions))
            .with("laplacian-offsets", smooth * c.laplacian_offsets_weight, laplacian(offsets));
        if c.cotangent_weight > 0.0 {
            let Template { corners, topology, .. } = &self.template;
            let values = positions.value();
            let values = values.as_slice().as_chunks::<3>().0;
            let matrices: Vec<_> = values
                .chunks_exact(self.template.sphere.len())
                .map(|shape| cotangent_laplacian(shape, corners, topology))
                .collect();
            let value = losses::laplacian_cotangent(positions, &matrices);
            terms = terms.with("cotangent", c.cotangent_weight, value);
        }
        terms
    }

    /// What the selection is asked beside its use.
    fn selected<'t>(&self, terms: Terms<'t>, weights: Var<'t>) -> Terms<'t> {
        let c = &self.config;
        if c.shapes == 1 {
            return terms;
        }
        let used = weights.mean_axis(0);
        let all = used.mul(used.add_scalar(LEAST).ln()).sum();
        let all = all.add_scalar((c.shapes as f32).ln());
        let one = weights.mul(weights.add_scalar(LEAST).ln()).sum_axis(1).mean().neg();
        terms.with("balance", c.balance_weight, all).with("decision", c.decision_weight, one)
    }
}

impl Compile for Mcmr {
    #[inline(never)]
    fn compiled() -> Compiled<Self> {
        Compiled::here()
    }
}

impl System for Mcmr {
    const NAME: &'static str = "mcmr";
    const PRESETS: &'static [(&'static str, &'static str)] = &[
        ("tiny", include_str!("presets/tiny.toml")),
        ("small", include_str!("presets/small.toml")),
        ("table", include_str!("presets/table.toml")),
        ("paper", include_str!("presets/paper.toml")),
        ("paper-table", include_str!("presets/paper-table.toml")),
        ("paper-cub", include_str!("presets/paper-cub.toml")),
    ];
    const BEST: &'static str = "mask-iou";

    type Config = McmrConfig;
    type ReadOptions = datasets::ReadOptions;
    type Data = Data;
    type Sample = (Sample, Arc<PerceptualMetrics>);
    type Input = [View];
    type Prediction = McmrPrediction;

    fn check(config: &McmrConfig) -> Vec<String> {
        config.check()
    }

    fn summary(config: &McmrConfig) -> Summary {
        size::summary(config)
    }

    fn new(config: &McmrConfig, seed: u64) -> Self {
        let template = Template::new(config.level);
        let model = Model::new(config, seed, &template);
        let renderer = TexturedRenderer::new(&template, config);
        Self { config: config.clone(), model, template, renderer }
    }

    fn init_from_data(
        &mut self,
        data: &Data,
        inherited: Option<&Inherited>,
    ) -> Result<(), DataError> {
        let begins = |part: &str| inherited.is_none_or(|i| !i.has(part));
        if begins("viewpoint") {
            self.camera_begins_at(data)?;
        }
        let weights = self.config.weights.as_ref().filter(|_| begins("encoder"));
        let Some(path) = weights else { return Ok(()) };
        let loaded = LoadWeights::partial().load(path, &mut self.model.encoder);
        loaded.map(|_| ()).map_err(unusable)
    }

    fn open(
        config: &McmrConfig,
        source: &Source<'_, Self::ReadOptions>,
    ) -> Result<Data, DataError> {
        Data::open(config, source)
    }

    fn fingerprint(data: &Data) -> u64 {
        data.fingerprint()
    }

    fn epoch_len(&self, data: &Data) -> usize {
        data.trained().len()
    }

    fn draw(&self, data: &Data, draw: &Draw) -> Result<Self::Sample, DataError> {
        let photo = data.photo(data.trained()[draw.item])?;
        Ok((photo.random(&self.config, &mut draw.rng()), Arc::clone(data.perceptual())))
    }

    fn name_of((sample, _): &Self::Sample) -> String {
        sample.name.clone()
    }

    fn begin_epoch(&mut self, epoch: u64, state: &mut OptimizerState<'_>) {
        if self.config.subdivide_at == Some(epoch) {
            let split = self.refine();
            if self.config.keep_moments {
                state.carry(shapes::PATH, |moment| split.finer(moment));
            } else {
                // As the published code, which makes its optimiser anew.
                state.forget("");
            }
        }
    }

    fn loss<'t>(
        &self,
        tape: &'t Tape,
        batch: &[Self::Sample],
        at: StepInfo,
    ) -> Result<Terms<'t>, LossError> {
        let (c, n, side) = (&self.config, batch.len(), self.config.image_size);
        let samples: Vec<&Sample> = batch.iter().map(|(sample, _)| sample).collect();
        let predicted = self.predicted(tape, &samples);
        let cameras = self.training_cameras(tape, &predicted, &samples, at.epoch);
        let rendered = self.renderer.render(tape, predicted.positions, predicted.texture, cameras);
        let mask = stacked(tape, samples.iter().map(|s| &s.mask[..]), &[n, side, side]);
        let target = stacked(tape, samples.iter().map(|s| &s.target[..]), &[n, side, side, 3]);
        let terms =
            Terms::new().with("mask", c.mask_weight, losses::l2(rendered.silhouette, mask, None));
        let terms = self.with_camera(tape, terms, &predicted, &samples);
        let terms = self.selected(self.regularised(terms, &predicted), predicted.weights);
        let inside = mask.reshape(&[n, side, side, 1]);
        let (image, truth) = (rendered.image.mul(inside), target.mul(inside));
        let [lab, true_lab] = [image, truth].map(losses::rgb_to_lab);
        Ok(terms
            .with("percept", c.percept_weight, batch[0].1.distance(image, truth))
            .with("color", c.color_weight, losses::lab_color(lab, true_lab, None))
            .with("lightness", c.lightness_weight, losses::lab_lightness(lab, true_lab, None)))
    }

    fn data_summary(data: &Data) -> Option<DataSummary> {
        Some(data.summary())
    }

    fn evaluate(&self, data: &Data, subset: Subset) -> Result<Vec<Metric>, DataError> {
        Ok(self.scored(data, subset)?.metrics())
    }

    fn show(&self, data: &Data, subset: Subset) -> Result<Shown, DataError> {
        let sample = data.photo(data.wanted(subset)?[0])?.plain(subset, &self.config);
        let tape = Tape::eval();
        let mesh = self.mesh_of(&self.predicted(&tape, &[&sample]), 0);
        Ok(Shown { views: self.gallery_of_shapes(data, subset)?, scene: Some(scene_of(&mesh)) })
    }

    fn rates(&self) -> Vec<(String, f64)> {
        vec![(shapes::PATH.to_owned(), self.config.shape_rate)]
    }

    fn coupling(&self) -> Option<&'static str> {
        let text = "`norm` is \"batch\" or \"frozen\", whose norms of codes have the statistics of the batch (`norm = \"group\"` has none)";
        let c = &self.config;
        let balance = "`balance-weight` is above 0, which asks of the batch that all shapes are used (0 asks nothing)";
        match c.norm {
            NormKind::Group => (c.balance_weight > 0.0 && c.shapes > 1).then_some(balance),
            _ => Some(text),
        }
    }

    /// A textured mesh, its camera and the selection, from the first view; of the view's own camera only the lens counts,
    /// to put the mesh into its world.
    fn predict(&self, views: &[View]) -> Result<McmrPrediction, PredictError> {
        let view = views.first().ok_or(PredictError::NoView)?;
        self.predict_view(view)
    }
}
