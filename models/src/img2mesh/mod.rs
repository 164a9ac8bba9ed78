//! img2mesh: several views of an object, attention between them, one mesh; learned from images
//! alone.
//!
//! ```text
//! views [N, V, S, S, 3] -> encoder -> features [N, V, D] -> attention -> mean over views -> x + relu(W x)
//!   -> offsets of an icosphere, its colours, its place -> DIB-R into the same cameras -> four losses
//! ```
//!
//! With `stages` the mesh of the whole images is only where it begins: each stage reads the encoder's maps, the masks' outlines
//! and the colours of every view where a vertex is seen, attends over the views at each vertex, and moves it after a few graph
//! convolutions, from coarse to fine.
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
//! Vertex-aligned features of several views: Wen et al. 2019, *Pixel2Mesh++*. The img2mesh paper and its code; losses and renderer: Chen et al. 2019, *Learning to Predict 3D Objects with
//! an Interpolation-based Differentiable Renderer*.

mod canonical;
mod config;
mod data;
mod encoder;
mod evaluate_meshes;
mod feature_cache;
mod level;
mod mesh_pairs;
mod model;
mod observation;
mod offsets;
mod onnx;
mod predictor;
mod prepared;
#[cfg(test)]
mod published_tests;
mod render;
mod score;
mod size;
mod surface;
#[cfg(test)]
mod tests;
mod view_stage;
#[cfg(test)]
mod view_stage_tests;

use std::sync::Arc;

use autodiff_lite::{Tape, Var, impl_module};
use datasets::View;
use mesh_core::TriMesh;
use ndarray::ArrayD;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use train::{
    Compile, Compiled, DataError, DataSummary, Draw, Inherited, LossError, Metric, OptimizerState,
    PredictError, Shown, Source, StepInfo, Subset, Summary, System, Terms,
};

use crate::parts::finished;
use crate::pretrained::unusable;
use crate::stacked::stacked;
use encoder::Encoder;
use feature_cache::FeatureCache;
use level::Level;
use model::{Meshes, Model};
use observation::observe;
use prepared::Prepared;

pub use config::{AttentionKind, EncoderKind, Img2MeshConfig, SilhouetteKind};
pub use data::{Data, Group, Sample};
pub use evaluate_meshes::evaluate_meshes;

/// The system; see the [module](self).
#[derive(Debug)]
pub struct Img2Mesh {
    config: Img2MeshConfig,
    seed: u64,
    model: Model,
    /// Those that have meshes of their own, coarsest first.
    levels: Vec<Level>,
    features: FeatureCache,
}

impl_module!(Img2Mesh: f32 = model);

impl Img2Mesh {
    /// The mesh of one object from all given views, as it is scored and delivered.
    fn meshes<'t>(&self, tape: &'t Tape, views: &[Arc<Prepared>]) -> Meshes<'t> {
        self.finished(tape, &self.sequence(tape, 1, views))
    }

    /// The same from images that are not looked at again: no features are kept.
    fn meshes_uncached<'t>(&self, tape: &'t Tape, views: &[Arc<Prepared>]) -> Meshes<'t> {
        self.finished(tape, &self.sequence_uncached(tape, 1, views))
    }

    /// Views as the model takes them.
    fn prepared(&self, views: &[View]) -> Result<Vec<Arc<Prepared>>, PredictError> {
        if views.is_empty() {
            return Err(PredictError::NoView);
        }
        let prepared = views.iter().map(|view| Prepared::new(view, &self.config).map(Arc::new));
        Ok(prepared.collect::<Result<_, _>>()?)
    }

    /// The last mesh of one object's, moved apart where it passes through itself if that is wanted.
    fn finished<'t>(&self, tape: &'t Tape, sequence: &[Meshes<'t>]) -> Meshes<'t> {
        let meshes = *sequence.last().expect("a mesh at least");
        if !self.config.untangle {
            return meshes;
        }
        let shape = meshes.positions.shape();
        let rows = meshes.positions.value().as_slice().as_chunks::<3>().0.to_vec();
        let mesh = finished(TriMesh::new(rows, self.finest().renderer.corners.clone()), true);
        let values = mesh.positions.into_flattened();
        let positions = ArrayD::from_shape_vec(shape, values).expect("as many vertices");
        Meshes { positions: tape.constant(positions), ..meshes }
    }

    /// The finest level, on which predictions are.
    fn finest(&self) -> &Level {
        self.levels.last().expect("a level at least")
    }

    /// The mesh of the whole images, and those of the stages: each on the level of its place but the first, whose level is the
    /// first stage's.
    fn sequence<'t>(&self, tape: &'t Tape, n: usize, views: &[Arc<Prepared>]) -> Vec<Meshes<'t>> {
        if !Encoder::is_frozen(&self.config) {
            return self.sequence_uncached(tape, n, views);
        }
        let features = self.features.of(tape, &self.model, self.config.image_size, views);
        vec![self.model.forward(n, features, self.cameras(tape, views, &[views.len(), 12]))]
    }

    fn sequence_uncached<'t>(
        &self,
        tape: &'t Tape,
        n: usize,
        views: &[Arc<Prepared>],
    ) -> Vec<Meshes<'t>> {
        let images = image_tensor(tape, self.config.image_size, views);
        let (maps, features) = self.model.encode_maps(images);
        let cameras = self.cameras(tape, views, &[views.len(), 3, 4]);
        let code = self.model.code(n, features, cameras.reshape(&[views.len(), 12]));
        let first = self.model.decode(code);
        if self.model.stages().is_empty() {
            return vec![first];
        }
        let views: Vec<&Prepared> = views.iter().map(AsRef::as_ref).collect();
        let [_, v, _] = first.positions.dims();
        // Each vertex is told what the whole images say.
        let [_, d] = code.dims();
        let ones = tape.constant(ndarray::Array3::ones((1, v, 1)));
        let mut left = code.reshape(&[n, 1, d]) * ones;
        let (mut mesh, mut sequence) = (first, vec![first]);
        for (i, (stage, level)) in self.model.stages().iter().zip(&self.levels).enumerate() {
            if let Some(up) = i.checked_sub(1).and_then(|before| self.levels[before].up.as_ref()) {
                mesh = mesh.carried(up);
                left = left.sparse_matmul(up);
            }
            let seen = observe(tape, level, mesh.positions, &views, cameras);
            let (offset, colors, hidden) = tape.scope("stage", || {
                let refined = stage.forward(&maps, &seen, left, mesh.colors, level);
                (refined.offset, refined.colors, refined.hidden)
            });
            mesh = mesh.refined(offset, colors);
            left = hidden;
            sequence.push(mesh);
        }
        sequence
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

impl Compile for Img2Mesh {
    #[inline(never)]
    fn compiled() -> Compiled<Self> {
        Compiled::here()
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
        ("aligned", include_str!("presets/aligned.toml")),
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
        let levels = Level::all(config);
        let model = Model::new(config, &levels[0].template, seed);
        Self { config: config.clone(), seed, model, levels, features: FeatureCache::default() }
    }

    fn init_from_data(
        &mut self,
        data: &Data,
        inherited: Option<&Inherited>,
    ) -> Result<(), DataError> {
        let mut frame = data.frame(&self.config)?.map(|x| x as f32);
        if self.config.world_origin {
            frame[..3].fill(0.0);
        }
        self.model.frame.as_slice_mut().copy_from_slice(&frame);
        let begins = inherited.is_none_or(|i| !i.has("encoder"));
        if let Some(path) = self.config.weights.as_ref().filter(|_| begins) {
            let loaded = self.model.encoder.load(path);
            loaded.map_err(unusable)?;
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
        let sequence = self.sequence(tape, n, &given);
        let (meshes, earlier) = sequence.split_last().expect("a mesh at least");
        let finest = self.finest();
        let targets = || batch.iter().flat_map(|sample| &sample.views);
        let (m, side) = (targets().count(), c.render_size);
        let all: Vec<&Prepared> = targets().map(AsRef::as_ref).collect();
        let matrices = self.cameras(tape, &all, &[m, 3, 4]);
        let rendered = finest.renderer.render(meshes.positions, meshes.colors, matrices);
        let image = stacked(tape, targets().map(|view| &view.target[..]), &[m, side, side, 3]);
        let mask = stacked(tape, targets().map(|view| &view.mask[..]), &[m, side, side]);
        let topology = &finest.renderer.topology;
        let flat = losses::face_angle(meshes.raw, topology);
        let mut terms = Terms::new()
            .with("image", c.image_weight, losses::l1(rendered.image, image, None))
            .with("mask", c.mask_weight, losses::mask_iou(rendered.silhouette, mask))
            .with("flat", c.flat_weight, flat)
            .with("edge", c.edge_weight, losses::edge_length_sum(meshes.raw, &topology.edges));
        if c.bending_weight > 0.0 {
            let all = sequence.iter().enumerate();
            let energy = all.map(|(i, mesh)| self.levels[i.saturating_sub(1)].bending(mesh.raw));
            let energy = energy.reduce(|a, b| a + b).expect("a mesh at least");
            terms = terms.with("bending", c.bending_weight, energy);
        }
        if !earlier.is_empty() {
            let error = |(i, mesh): (usize, &Meshes<'t>)| {
                let level = &self.levels[i.saturating_sub(1)];
                let silhouettes = level.renderer.silhouettes(mesh.positions, matrices);
                losses::mask_iou(silhouettes, mask)
            };
            let errors = earlier.iter().enumerate().map(error);
            let early = errors.reduce(|a, b| a + b).expect("one at least");
            terms = terms.with("early-masks", c.early_weight * c.mask_weight, early);
        }
        Ok(terms)
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

    fn coupling(&self) -> Option<&'static str> {
        let text = "`attention` is \"published\", which is over the objects of the batch (`attention = \"views\"` is not)";
        (self.config.attention == AttentionKind::Published).then_some(text)
    }

    /// A coloured mesh in the world of the cameras, from any number of views.
    fn predict(&self, views: &[View]) -> Result<TriMesh, PredictError> {
        let tape = Tape::eval();
        Ok(self.mesh(self.meshes_uncached(&tape, &self.prepared(views)?)))
    }
}

/// Images for the encoder: `[M, S, S, 3]`.
fn image_tensor<'t>(tape: &'t Tape, side: usize, views: &[Arc<Prepared>]) -> Var<'t> {
    let images = views.iter().map(|view| &view.image[..]);
    stacked(tape, images, &[views.len(), side, side, 3])
}
