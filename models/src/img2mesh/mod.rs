//! img2mesh: several views of an object, attention between them, one mesh; learned from images
//! alone.
//!
//! ```text
//! views [N, V, S, S, 3] -> encoder -> features [N, V, D] -> attention -> mean over views -> x + relu(W x)
//!   -> offsets of an icosphere, its colours, its place -> DIB-R into the same cameras -> four losses
//! ```
//!
//! The number of views is free: a model trained on pairs takes one view or eight. Beyond what was
//! published it can be told each view's camera (`camera-embedding`), be compared with views that
//! it was not given (`extra-views`), and attend over the views as the paper says, where the
//! published code attends over the batch (`attention`).
//!
//! Encoders learn from scratch unless a file with pretrained weights is named (`weights`). One that
//! stays as it begins (`freeze-encoder`), as VGG16 does in the published base model, computes the
//! features of each image once.
//!
//! # References
//! The img2mesh paper and its code; losses and renderer: Chen et al. 2019, *Learning to Predict 3D Objects with
//! an Interpolation-based Differentiable Renderer*.

mod config;
mod data;
mod encoder;
mod evaluate_meshes;
mod feature_cache;
mod mesh_pairs;
mod model;
mod offsets;
mod predictor;
mod prepared;
#[cfg(test)]
mod published_tests;
mod render;
mod score;
mod surface;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use autodiff_lite::{Tape, Var, impl_module};
use datasets::View;
use mesh_core::TriMesh;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use train::{
    DataError, DataSummary, Draw, LossError, Metric, OptimizerState, PredictError, Shown, Source,
    StepInfo, Subset, Summary, System, Terms,
};

use crate::stacked::stacked;
use encoder::Encoder;
use feature_cache::FeatureCache;
use model::{Meshes, Model};
use prepared::Prepared;
use render::ViewRenderer;

pub use config::{AttentionKind, EncoderKind, Img2MeshConfig, SilhouetteKind};
pub use data::{Data, Group, Sample};
pub use evaluate_meshes::evaluate_meshes;

/// The system; see the [module](self).
#[derive(Debug)]
pub struct Img2Mesh {
    config: Img2MeshConfig,
    seed: u64,
    model: Model,
    renderer: ViewRenderer,
    features: FeatureCache,
}

impl_module!(Img2Mesh: f32 = model);

impl Img2Mesh {
    /// Meshes of `n` objects from all given views, object by object, each as many.
    fn meshes<'t>(&self, tape: &'t Tape, n: usize, views: &[Arc<Prepared>]) -> Meshes<'t> {
        if !Encoder::is_frozen(&self.config) {
            return self.meshes_uncached(tape, n, views);
        }
        let features = self.features.of(tape, &self.model, self.config.image_size, views);
        self.model.forward(n, features, self.cameras(tape, views, &[views.len(), 12]))
    }

    /// The same from images that are not looked at again: no features are kept.
    fn meshes_uncached<'t>(&self, tape: &'t Tape, n: usize, views: &[Arc<Prepared>]) -> Meshes<'t> {
        let features = self.model.encode(pictures(tape, self.config.image_size, views));
        self.model.forward(n, features, self.cameras(tape, views, &[views.len(), 12]))
    }

    /// Cameras relative to the model's frame: 12 numbers a view, as `shape`.
    fn cameras<'t, V: std::borrow::Borrow<Prepared>>(
        &self,
        tape: &'t Tape,
        views: &[V],
        shape: &[usize],
    ) -> Var<'t> {
        let frame = self.model.frame.as_slice();
        let rows: Vec<[f32; 12]> = views.iter().map(|view| view.borrow().matrix(frame)).collect();
        stacked(tape, rows.iter().map(|row| &row[..]), shape)
    }

    /// Takes in the levels that are due.
    fn activate_levels(&mut self, epoch: u64) {
        let levels = self.model.mesh_fc.levels();
        let more = self.config.refine_every.map(|every| usize::try_from(epoch / every));
        self.model.mesh_fc.active = match more {
            Some(Ok(more)) => levels.min(1 + more),
            _ => levels,
        };
    }

    /// How many views are given at a step.
    fn given(&self, at: StepInfo) -> usize {
        if !self.config.vary_views {
            return self.config.views;
        }
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(at.step);
        rng.random_range(1..=self.config.views)
    }
}

impl System for Img2Mesh {
    const NAME: &'static str = "img2mesh";
    const PRESETS: &'static [(&'static str, &'static str)] = &[
        ("tiny", include_str!("presets/tiny.toml")),
        ("small", include_str!("presets/small.toml")),
        ("paper", include_str!("presets/paper.toml")),
        ("paper-table", include_str!("presets/paper-table.toml")),
        ("paper-base", include_str!("presets/paper-base.toml")),
        ("clock", include_str!("presets/clock.toml")),
        ("clock-vgg16", include_str!("presets/clock-vgg16.toml")),
        ("unseen", include_str!("presets/unseen.toml")),
    ];
    const BEST: &'static str = "mask-iou";

    type Config = Img2MeshConfig;
    type ReadOptions = datasets::ReadOptions;
    type Data = Data;
    type Sample = Sample;
    type Input = [View];
    type Prediction = TriMesh;

    fn check(config: &Img2MeshConfig) -> Vec<String> {
        config.check()
    }

    fn summary(config: &Img2MeshConfig) -> Summary {
        config.summary()
    }

    fn new(config: &Img2MeshConfig, seed: u64) -> Self {
        let (model, template) = Model::new(config, seed);
        let renderer = ViewRenderer::new(&template, config);
        Self { config: config.clone(), seed, model, renderer, features: FeatureCache::default() }
    }

    fn init_from_data(&mut self, data: &Data) -> Result<(), DataError> {
        let mut frame = data.frame(&self.config)?.map(|x| x as f32);
        if self.config.world_origin {
            frame[..3].fill(0.0);
        }
        self.model.frame.as_slice_mut().copy_from_slice(&frame);
        if let Some(path) = &self.config.weights {
            let loaded = self.model.encoder.load(path);
            loaded.map_err(DataError::unfit)?;
        }
        Ok(())
    }

    fn begin_epoch(&mut self, epoch: u64, _: &mut OptimizerState<'_>) {
        self.activate_levels(epoch);
    }

    fn open(
        config: &Img2MeshConfig,
        source: &Source<'_, Self::ReadOptions>,
    ) -> Result<Data, DataError> {
        match source.path {
            None => {
                let data_seed = config.data_seed.or(Some(source.seed));
                Data::synthetic(&Img2MeshConfig { data_seed, ..config.clone() })
            }
            Some(path) => {
                let dataset = datasets::open_with(path, source.options).map_err(DataError::read)?;
                if dataset.entries().len() == 1 || source.options.object.is_some() {
                    let views = datasets::read_views(path, source.options, source.progress)
                        .map_err(DataError::read)?;
                    return Data::one(&views, config);
                }
                Data::many(dataset, source.options.clone(), config)
            }
        }
    }

    fn fingerprint(data: &Data) -> u64 {
        data.fingerprint()
    }

    fn epoch_len(&self, data: &Data) -> usize {
        data.epoch_len(&self.config)
    }

    fn draw(&self, data: &Data, draw: &Draw) -> Result<Sample, DataError> {
        data.draw(&self.config, draw.item, &mut draw.rng())
    }

    fn name_of(sample: &Sample) -> String {
        let names: Vec<&str> = sample.views.iter().map(|view| view.name.as_str()).collect();
        format!("views {}", names.join(" + "))
    }

    fn loss<'t>(
        &self,
        tape: &'t Tape,
        batch: &[Sample],
        at: StepInfo,
    ) -> Result<Terms<'t>, LossError> {
        let (n, c) = (batch.len(), &self.config);
        let k = self.given(at);
        let given: Vec<Arc<Prepared>> =
            batch.iter().flat_map(|sample| sample.views.iter().take(k).cloned()).collect();
        let meshes = self.meshes(tape, n, &given);
        let targets = || batch.iter().flat_map(|sample| &sample.views);
        let (m, side) = (targets().count(), c.render_size);
        let all: Vec<&Prepared> = targets().map(AsRef::as_ref).collect();
        let matrices = self.cameras(tape, &all, &[m, 3, 4]);
        let rendered = self.renderer.render(meshes.positions, meshes.colors, matrices);
        let image = stacked(tape, targets().map(|view| &view.target[..]), &[m, side, side, 3]);
        let mask = stacked(tape, targets().map(|view| &view.mask[..]), &[m, side, side]);
        let topology = &self.renderer.topology;
        let flat = losses::face_angle(meshes.raw, &self.renderer.corners, &topology.edge_faces);
        Ok(Terms::new()
            .with("image", c.image_weight, losses::l1(rendered.image, image, None))
            .with("mask", c.mask_weight, losses::mask_iou(rendered.silhouette, mask))
            .with("flat", c.flat_weight, flat)
            .with("edge", c.edge_weight, losses::edge_length_sum(meshes.raw, &topology.edges)))
    }

    fn data_summary(data: &Data) -> Option<DataSummary> {
        Some(data.summary())
    }

    fn evaluate(&self, data: &Data, subset: Subset) -> Result<Vec<Metric>, DataError> {
        self.evaluate_with(data, subset, self.config.views)
    }

    fn show(&self, data: &Data, subset: Subset) -> Result<Shown, DataError> {
        self.shown(data, subset)
    }

    fn rates(&self) -> Vec<(String, f64)> {
        vec![("mesh_color_fc".to_owned(), self.config.color_rate)]
    }

    fn couples_samples(&self) -> bool {
        self.config.attention == AttentionKind::Published
    }

    /// A coloured mesh in the world of the cameras, from any number of views.
    fn predict(&self, views: &[View]) -> Result<TriMesh, PredictError> {
        if views.is_empty() {
            return Err(PredictError::NoView);
        }
        let prepared = views
            .iter()
            .map(|view| Prepared::new(view, &self.config).map(Arc::new))
            .collect::<Result<Vec<_>, _>>()?;
        let tape = Tape::eval();
        Ok(self.mesh(self.meshes_uncached(&tape, 1, &prepared)))
    }
}

/// Images for the encoder: `[M, S, S, 3]`.
fn pictures<'t>(tape: &'t Tape, side: usize, views: &[Arc<Prepared>]) -> Var<'t> {
    let images = views.iter().map(|view| &view.image[..]);
    stacked(tape, images, &[views.len(), side, side, 3])
}
