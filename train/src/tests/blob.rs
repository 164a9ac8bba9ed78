//! A small system: a two-layer network that turns the radii of an ellipsoid into the offsets of an
//! icosphere, and learns from silhouettes alone.

use std::sync::Arc;

use autodiff_lite::{Activation, BufferUpdate, Param, Tape, impl_module};
use diff_raster::{Faces, Renderer, Settings};
use mesh_core::{ByteImage, Camera, Topology, TriMesh, primitives};
use ndarray::{Array2, ArrayD, IxDyn};
use ode_deform::solve::SolveError;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::report::ViewPair;
use crate::{
    Compile, DataError, Draw, LossError, Metric, OptimizerState, PredictError, Shown, Source,
    StepInfo, Subset, Summary, System, Terms,
};

const SIDE: usize = 16;
const OBJECTS: usize = 12;

crate::options! {
    /// How the network is made, and what goes wrong.
    #[serde(deny_unknown_fields)]
    pub(super) struct Options {
        /// Columns inside.
        pub(super) hidden: usize = 8, in 1..=64;
        /// Share of the hidden columns that is dropped.
        pub(super) dropout: f64 = 0.1, in 0.0..1.0;
        /// The object whose image is not a number.
        #[serde(with = "crate::settings::optional")]
        pub(super) poisoned: Option<u64> = None;
        /// The object whose image cannot be read.
        #[serde(with = "crate::settings::optional")]
        pub(super) unreadable: Option<u64> = None;
        /// The object whose loss has no value.
        #[serde(with = "crate::settings::optional")]
        pub(super) unsolved: Option<u64> = None;
        /// Whether none of the terms counts.
        pub(super) weightless: bool = false;
        /// What the loss is multiplied by at each of the first steps; the last number goes on.
        pub(super) factors: Vec<f64> = Vec::new();
        /// Whether a term of weight 0 is no number.
        pub(super) unbounded: bool = false;
        /// The epoch before which the hidden layer doubles.
        #[serde(with = "crate::settings::optional")]
        pub(super) grow_at: Option<u64> = None;
        /// Whether one object's loss depends on a parameter more, and statistics run along.
        pub(super) uneven: bool = false;
        /// Couples the samples of a batch, to be refused with shards.
        pub(super) coupled: bool = false;
    }
}

#[derive(Debug)]
pub(super) struct Blob {
    hidden: (Param, Param),
    pub(super) offsets: (Param, Param),
    /// What only one object's loss depends on: the other shards of its batch have no gradient of it.
    rare: Param,
    /// A running mean of radii, which depends on the order of what was seen.
    pub(super) seen: Param,
    options: Options,
    renderer: Renderer,
    edges: Vec<[u32; 2]>,
    sphere: ArrayD<f32>,
}
impl_module!(Blob: f32 { hidden, offsets, rare, seen } fixed { options, renderer, edges, sphere });

pub(super) struct Silhouette {
    name: String,
    radii: [f32; 3],
    matrix: Vec<f32>,
    mask: Vec<f32>,
}

fn object(index: usize) -> [f32; 3] {
    let mut rng = ChaCha8Rng::seed_from_u64(17);
    rng.set_stream(index as u64);
    std::array::from_fn(|_| 0.4 + 0.5 * rng.random::<f32>())
}

fn camera(angle: f64) -> Vec<f32> {
    let eye = [3.0 * angle.sin(), 0.8, 3.0 * angle.cos()];
    let camera = Camera::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 0.7, SIDE, SIDE);
    camera.projection().concat().into_iter().map(|x| x as f32).collect()
}

fn renderer(mesh: &TriMesh) -> Renderer {
    Renderer::new(Arc::new(Faces::of(mesh).unwrap()), Settings::new(SIDE, SIDE))
}

pub(super) fn silhouette(index: usize, angle: f64, name: String) -> Silhouette {
    let radii = object(index);
    let mesh = primitives::icosphere(2).scaled(radii);
    let tape = Tape::eval();
    let positions = Array2::from(mesh.positions.clone()).into_dyn();
    let positions = positions.to_shape(IxDyn(&[1, mesh.positions.len(), 3])).unwrap().to_owned();
    let matrix = camera(angle);
    let cameras = ArrayD::from_shape_vec(IxDyn(&[1, 3, 4]), matrix.clone()).unwrap();
    let projected = tape.constant(positions).project(tape.constant(cameras));
    let mask = renderer(&mesh).frame(projected).mask();
    Silhouette { name, radii, matrix, mask }
}

impl Blob {
    /// Masks of the batch, `[N, H, W]`, and the offsets, `[N, V, 3]`.
    fn masks<'t>(&self, tape: &'t Tape, batch: &[Silhouette]) -> [autodiff_lite::Var<'t>; 2] {
        let count = batch.len();
        let radii = batch.iter().flat_map(|s| s.radii).collect();
        let radii = tape.constant(ArrayD::from_shape_vec(IxDyn(&[count, 3]), radii).unwrap());
        let dense = |x: autodiff_lite::Var<'t>, (w, b): &(Param, Param), activation| {
            x.linear(tape.param(w), Some(tape.param(b)), activation)
        };
        let hidden = dense(radii, &self.hidden, Activation::Relu).dropout(self.options.dropout);
        let vertices = self.sphere.shape()[0];
        let offsets = dense(hidden, &self.offsets, Activation::None).reshape(&[count, vertices, 3]);
        let positions = offsets + tape.constant(self.sphere.clone());
        let matrices = batch.iter().flat_map(|s| s.matrix.clone()).collect();
        let matrices = ArrayD::from_shape_vec(IxDyn(&[count, 3, 4]), matrices).unwrap();
        let projected = positions.project(tape.constant(matrices));
        [self.renderer.frame(projected).antialiased_silhouette(), offsets]
    }
}

impl Compile for Blob {}

impl System for Blob {
    const NAME: &'static str = "blob";
    const PRESETS: &'static [(&'static str, &'static str)] = &[];
    const BEST: &'static str = "mask-iou";
    type Config = Options;
    type ReadOptions = ();
    type Data = ();
    type Sample = Silhouette;
    type Input = [f32; 3];
    type Prediction = Vec<f32>;

    fn summary(config: &Options) -> Summary {
        let trainable = 4 * config.hidden + 126 * (config.hidden + 1) + 1;
        Summary { trainable, frozen: 3, ..Summary::default() }
    }

    fn new(config: &Options, seed: u64) -> Self {
        let mesh = primitives::icosphere(1);
        let sphere = Array2::from(mesh.positions.clone()).mapv(|x| 0.6 * x).into_dyn();
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut weights = |rows: usize, columns: usize, scale: f32| {
            Param::new(Array2::from_shape_fn((rows, columns), |_| {
                scale * (rng.random::<f32>() - 0.5)
            }))
        };
        let (hidden, out) = (config.hidden, 3 * mesh.positions.len());
        Self {
            hidden: (weights(hidden, 3, 2.0), Param::new(ndarray::Array1::zeros(hidden))),
            offsets: (weights(out, hidden, 0.2), Param::new(ndarray::Array1::zeros(out))),
            rare: Param::new(ndarray::arr1(&[0.1])),
            seen: Param::buffer(ndarray::arr1(&[0.6; 3])),
            options: config.clone(),
            edges: Topology::new(mesh.positions.len(), &mesh.faces).edges.clone(),
            renderer: renderer(&mesh),
            sphere,
        }
    }

    fn open(_: &Options, _: &Source<'_>) -> Result<(), DataError> {
        Ok(())
    }

    fn fingerprint((): &()) -> u64 {
        7
    }

    fn epoch_len(&self, (): &()) -> usize {
        OBJECTS
    }

    fn draw(&self, (): &(), draw: &Draw) -> Result<Silhouette, DataError> {
        if Some(draw.item as u64) == self.options.unreadable {
            return Err(DataError::Unfit(format!("object {} cannot be read", draw.item)));
        }
        let angle = draw.rng().random::<f64>() * std::f64::consts::TAU;
        let mut sample = silhouette(draw.item, angle, format!("object {}", draw.item));
        if Some(draw.item as u64) == self.options.poisoned {
            sample.mask[5] = f32::NAN;
        }
        Ok(sample)
    }

    fn name_of(sample: &Silhouette) -> String {
        sample.name.clone()
    }

    fn loss<'t>(
        &self,
        tape: &'t Tape,
        batch: &[Silhouette],
        at: StepInfo,
    ) -> Result<Terms<'t>, LossError> {
        let unsolved = self.options.unsolved.map(|item| format!("object {item}"));
        if batch.iter().any(|sample| Some(&sample.name) == unsolved.as_ref()) {
            let error = SolveError::StepUnderflow { t: 0.5, step: 1e-9, least: 1e-8 };
            return Err(LossError::solve(error));
        }
        let [masks, offsets] = self.masks(tape, batch);
        let wanted = batch.iter().flat_map(|s| s.mask.clone()).collect();
        let wanted = ArrayD::from_shape_vec(IxDyn(&[batch.len(), SIDE, SIDE]), wanted).unwrap();
        let mask = losses::mask_iou(masks, tape.constant(wanted));
        let mut edge = losses::edge_length(offsets, &self.edges, 0.0);
        let rare = |sample: &Silhouette| sample.name == "object 3";
        if self.options.uneven && batch.iter().any(rare) {
            edge = edge + tape.param(&self.rare).square().sum();
        }
        if self.options.uneven && tape.is_training() {
            let mut mean = tape.buffer(3);
            let of = |k: usize| batch.iter().map(|s| s.radii[k]).sum::<f32>() / batch.len() as f32;
            mean.iter_mut().enumerate().for_each(|(k, mean)| *mean = of(k));
            tape.push_update(BufferUpdate::new(&self.seen, mean, 0.25));
        }
        let [weight, less] = if self.options.weightless { [0.0; 2] } else { [1.0, 0.1] };
        let factors = &self.options.factors;
        let factor =
            factors.get(at.step as usize).or_else(|| factors.last()).copied().unwrap_or(1.0);
        let [weight, less] = [weight, less].map(|weight| factor * weight);
        let terms = Terms::new().with("mask", weight, mask).with("edge", less, edge);
        let unbounded = self.options.unbounded;
        Ok(terms.with("watched", 0.0, if unbounded { mask.scale(f32::INFINITY) } else { mask }))
    }

    /// The three subsets are other ellipsoids each.
    fn evaluate(&self, (): &(), subset: Subset) -> Result<Vec<Metric>, DataError> {
        let first = 100 * subset as usize;
        let tape = Tape::eval();
        let iou: f64 = (0..4)
            .map(|k| {
                let sample = [silhouette(first + k, k as f64, String::new())];
                let [mask, _] = self.masks(&tape, &sample);
                let (mask, truth) = (mask.value(), &sample[0].mask);
                let both = mask.iter().zip(truth).filter(|&(m, &t)| *m > 0.5 && t > 0.5).count();
                let any = mask.iter().zip(truth).filter(|&(m, &t)| *m > 0.5 || t > 0.5).count();
                both as f64 / any.max(1) as f64
            })
            .sum();
        Ok(vec![Metric::larger("mask-iou", iou / 4.0), Metric::smaller("constant", 1.0)])
    }

    fn show(&self, (): &(), _: Subset) -> Result<Shown, DataError> {
        let picture = |b| ByteImage { height: 8, width: 8, channels: 1, data: vec![b; 64] };
        let caption = "none".to_owned();
        let view = ViewPair { caption, model: picture(50), truth: picture(200) };
        Ok(Shown { views: vec![view.clone(), view], scene: None })
    }

    fn begin_epoch(&mut self, epoch: u64, state: &mut OptimizerState<'_>) {
        if Some(epoch) != self.options.grow_at {
            return;
        }
        // Each unit twice, at half the weight behind: the function stays as it is.
        let twice = |x: &[f32]| x.repeat(2);
        let width = self.hidden.1.len();
        let halves = move |x: &[f32]| -> Vec<f32> {
            x.chunks(width).flat_map(|row| row.repeat(2)).map(|w| 0.5 * w).collect()
        };
        let shaped = |data: Vec<f32>, shape: &[usize]| {
            Param::new(ArrayD::from_shape_vec(IxDyn(shape), data).unwrap())
        };
        let out = self.offsets.1.len();
        self.hidden.0 = shaped(twice(self.hidden.0.as_slice()), &[2 * width, 3]);
        self.hidden.1 = shaped(twice(self.hidden.1.as_slice()), &[2 * width]);
        self.offsets.0 = shaped(halves(self.offsets.0.as_slice()), &[out, 2 * width]);
        state.carry("hidden.0", twice);
        state.carry("hidden.1", twice);
        state.carry("offsets.0", halves);
    }

    fn coupling(&self) -> Option<&'static str> {
        self.options.coupled.then_some("it was asked to (`coupled = false`)")
    }

    fn rates(&self) -> Vec<(String, f64)> {
        vec![("offsets".to_owned(), 0.5)]
    }

    fn predict(&self, radii: &[f32; 3]) -> Result<Vec<f32>, PredictError> {
        let sample =
            Silhouette { name: String::new(), radii: *radii, matrix: camera(0.0), mask: vec![] };
        Ok(self.masks(&Tape::eval(), &[sample])[1].value().iter().copied().collect())
    }
}
