//! What the two systems can be told, beside the loop's own options.

use autodiff_lite::Activation;
use nets::{EncoderInit, MapSampling, ViewpointHead};
use ode_deform::Adjoint;
use ode_deform::deform::{FieldConfig, Schedule, StackedConfig};
use ode_deform::solve::{
    BOSH3, DOPRI5, EULER, HEUN, MIDPOINT, Problem, RK4, StepController, Tableau,
};
use serde::{Deserialize, Deserializer, Serialize};

use train::settings::above_to;

use crate::paired::{FrameKind, PairsConfig};
use crate::viewpoint::DIRECTIONS;

train::options! {
    /// What both have: images, encoder, template, losses.
    pub struct SharedConfig extends pairs: PairsConfig = PairsConfig::default() => {
        /// Whose frame truth, ellipsoid and prediction live in: `"camera"` as published, or `"object"`, the object's own, in
        /// which the camera has to be told.
        pub frame: FrameKind = FrameKind::Camera;
        /// Where the camera is known from in the object's frame: `"told"` by the data, or `"estimated"` from the image by the
        /// camera head. It is trained on true cameras in any case.
        pub camera: CameraSource = CameraSource::Told;
        /// Weight of what the camera head misses in the loss; with 0 there is no head.
        pub camera_weight: f64 = 0.0, in 0.0..=1e9;
        /// How many estimated cameras are tried at most, each with a mesh of its own; the one is kept whose outline fits the
        /// image's mask, and which the camera head holds likely.
        pub camera_hypotheses: usize = 3, in 1..=DIRECTIONS;
        /// What the logarithm of a camera's probability counts beside the outline's intersection over union; with 0 the
        /// outline alone chooses, which cannot tell the front of a bus from its back.
        pub camera_prior_weight: f64 = 0.05, in 0.0..=1e9;
        /// Channels of the encoder's six stages; maps are read from the last four. Published are `[16, 32, 64, 128,
        /// 256, 512]`.
        pub channels: [usize; 6] = [8, 8, 16, 32, 64, 64], in 1..=2048;
        /// How the encoder's weights begin; published deviations of 0.02 let the image fade on its way.
        pub encoder_init: EncoderInit = EncoderInit::He;
        /// Whether the encoder's layers are plain or residual. Published: plain.
        pub encoder_form: EncoderForm = EncoderForm::Plain;
        /// What maps are multiplied by before they are read. Residual encoders put out features of about 1, and a
        /// step of Adam changes what is read linearly from many such at once too much; 0.1 serves them.
        pub feature_scale: f64 = 1.0, in above_to(0.0, 1e3);
        /// How often the ellipsoid of 156 vertices is subdivided; 1 gives 618 vertices.
        pub level: u32 = 1, in 0..=3;
        /// Columns inside of the graph convolutions; published 192.
        pub hidden: usize = 96, in 1..=4096;
        /// After graph convolutions; the version that the ODE paper started from has none.
        pub activation: Activation = Activation::Relu;
        /// How feature maps are read: `"nearest"` in the paper on neural ODEs; `"truncated"` in the code that it began
        /// with and `"corners"` in Pixel2Mesh's first, both of which forget some vertices.
        pub sampling: MapSampling = MapSampling::Bilinear;
        /// Focal length and middle, in pixels of an image of 224, that all vertices are projected with, as published:
        /// `[250.0, 112.0]` in Pixel2Mesh, `[248.0, 111.5]` in the code that the ODE paper began with. Without, each
        /// image's own camera, which of 3D-R2N2's images has 245 and 112.
        #[serde(with = "train::settings::optional")]
        pub projection: Option<[f64; 2]> = None;
        /// Weight of the Chamfer distance: the mean squared distances of both ways.
        pub chamfer_weight: f64 = 100.0, in above_to(0.0, 1e9);
        /// What its way from prediction to truth counts beside the other; 0.55 in the original Pixel2Mesh.
        pub chamfer_back: f64 = 1.0, in 0.0..=1e9;
        /// Weight of the mean squared edge length, which falls with the second power of the edges of a finer mesh.
        pub edge_weight: f64 = 5.0, in 0.0..=1e9;
        /// Whether each vertex counts as an edge of no length in the means over edges, as in the published lists of
        /// edges, which are those of the supports: both means are smaller by a seventh.
        pub self_loops: bool = false;
        /// Weight of edges against the true normals.
        pub normal_weight: f64 = 0.0, in 0.0..=1e9;
        /// Weight of the change of Laplacian coordinates, a mean over vertices, which falls with the fourth power.
        pub laplacian_weight: f64 = 0.0, in 0.0..=1e9;
        /// Weight of the mean squared edge length in units of the ellipsoid's at the same level: the same at any number of
        /// vertices. Published: 0, with `edge-weight` in its place.
        pub stretch_weight: f64 = 0.0, in 0.0..=1e9;
        /// Weight of a stage's bending, the mean square of the Laplacian of its displacement over the square of the
        /// ellipsoid's mean squared edge: about the same at any number of vertices. Published: 0, with `laplacian-weight`
        /// in its place.
        pub bending_weight: f64 = 0.0, in 0.0..=1e9;
        /// Weight of the mean squared displacement.
        pub move_weight: f64 = 0.0, in 0.0..=1e9;
        /// Weight of half the sum of the squares of all weights of the encoder's convolutions.
        pub encoder_decay: f64 = 0.0, in 0.0..=1e3;
        /// Weight of the same of the graph convolutions, biases included.
        pub graph_decay: f64 = 0.0, in 0.0..=1e3;
    }
}

impl SharedConfig {
    /// Whether cameras are estimated from images.
    pub fn has_camera_head(&self) -> bool {
        self.frame == FrameKind::Object && self.camera_weight > 0.0
    }

    /// Trained numbers of what estimates cameras.
    pub(super) fn camera_parameters(&self) -> usize {
        if self.has_camera_head() { ViewpointHead::<f32>::parameters(3, DIRECTIONS) } else { 0 }
    }

    /// Channels of the four maps together.
    pub fn features(&self) -> usize {
        self.channels[2..].iter().sum()
    }

    /// What is wrong beside ranges, one sentence each.
    pub(super) fn conflicts(&self) -> Vec<String> {
        let mut problems = self.pairs.conflicts();
        if let Activation::LeakyRelu(slope) = self.activation
            && !(slope > 0.0 && slope <= 1.0)
        {
            problems.push(format!("`activation`: the slope is {slope}, expected above 0 to 1"));
        }
        if self.frame == FrameKind::Camera && self.camera_weight > 0.0 {
            let (weight, what) =
                (self.camera_weight, "0 where `frame` is \"camera\": none is needed there");
            problems.push(format!("`camera-weight` is {weight}, expected {what}"));
        }
        if self.camera == CameraSource::Estimated && !self.has_camera_head() {
            let what = "\"told\", or `frame` \"object\" and a `camera-weight` above 0";
            problems.push(format!("`camera` is \"estimated\", expected {what}"));
        }
        if self.projection.is_some() && self.frame == FrameKind::Object {
            let what = "\"none\": in the object's frame each image has its own camera";
            problems
                .push(format!("`projection` is given with `frame` \"object\", expected {what}"));
        }
        if let Some([focal, middle]) = self.projection
            && !(focal > 0.0 && focal <= 1e5 && (0.0..=224.0).contains(&middle))
        {
            let what = "a focal length above 0 and a middle of 0 to 224";
            problems.push(format!("`projection` is [{focal}, {middle}], expected {what}"));
        }
        problems
    }

    /// Numbers in the encoder.
    pub(super) fn encoder_parameters(&self) -> usize {
        let stages = [(2, 3), (3, 3), (3, 3), (3, 3), (3, 5), (4, 5)];
        let residual = self.encoder_form == EncoderForm::Residual;
        let mut inputs = 3;
        let mut total = 0;
        for ((count, kernel), &channels) in stages.into_iter().zip(&self.channels) {
            for i in 0..count {
                let side: usize = if i == 0 { kernel } else { 3 };
                total += side * side * inputs * channels + channels;
                total += if residual { 2 * channels } else { 0 };
                inputs = channels;
            }
        }
        total
    }
}

/// Where a camera is known from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CameraSource {
    /// The data.
    #[default]
    Told,
    /// The image.
    Estimated,
}

/// What an encoder's layers are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EncoderForm {
    /// A convolution and a ReLU.
    Plain,
    /// With group norms, and skips around convolutions that do not halve.
    Residual,
}

train::options! {
    /// The options of a deformation in continuous time, and of the residual networks that it is compared with.
    pub struct OdeConfig extends shared: SharedConfig = SharedConfig::default() => {
        /// What deforms.
        pub deformation: DeformationKind = DeformationKind::Ode;
        /// Blocks of the residual network.
        pub blocks: usize = 8, in 1..=64;
        /// Graph convolutions of the field; residual blocks and stacked fields have two. Published: 2.
        pub layers: usize = 2, in 2..=8;
        /// Columns of the field's state beside positions: what a vertex remembers of its way. Published: 0;
        /// residual blocks have none in any case.
        #[serde(alias = "memory")]
        pub augment_dim: usize = 0, in 0..=256;
        /// Columns in which the time is repeated (`ode`). Published: 196; 1 says the same.
        pub time: usize = 196, in 0..=4096;
        /// Columns that a stacked field reads features through.
        #[serde(alias = "reading")]
        pub feature_dim: usize = 24, in 1..=4096;
        /// Segments of the time, for each of which a stacked field has weights of its own.
        #[serde(alias = "pieces")]
        pub segments: usize = 8, in 1..=64;
        /// What the sums of a stacked field are multiplied by to be velocities; at 8 with as many steps a change of
        /// the weights moves vertices as far as in residual blocks.
        #[serde(alias = "speed")]
        pub output_scale: f64 = 8.0, in above_to(0.0, 1e3);
        /// What the first velocities are multiplied by: of the published size they would crumple the ellipsoid before
        /// the first step.
        pub first_velocity: f64 = 0.1, in above_to(0.0, 1e3);
        /// The method of integration (`ode`, `stacked`; there is none of residual blocks).
        pub method: Method = Method::Euler;
        /// Least and greatest start in training (`ode`, `stacked`).
        pub start: [f64; 2] = Schedule::DEEP.start, in 0.0..1.0;
        /// Least and greatest step in training; elsewhere all have their mean (`ode`, `stacked`).
        pub step: [f64; 2] = Schedule::DEEP.step, in 1e-4..=1.0;
        /// Where a test starts; without, at the middle of `start` (`ode`, `stacked`).
        #[serde(serialize_with = "train::settings::optional::serialize", deserialize_with = "test_start")]
        pub test_start: Option<f64> = None, in 0.0..1.0;
        /// Relative and absolute error of methods that estimate it (`bosh3`, `dopri5`) outside of training; without,
        /// steps are fixed (`ode`, `stacked`).
        #[serde(with = "train::settings::optional")]
        pub tolerance: Option<f64> = None, in 1e-10..=1.0;
        /// Whether the last step may go past 1, as in the published loop (`ode`, `stacked`).
        pub overshoot: bool = false;
        /// How gradients are found (`ode`, `stacked`).
        pub adjoint: Adjoint = Adjoint::Checkpointed;
    }
}

impl OdeConfig {
    /// Sizes of the field, or of each residual block.
    pub fn field(&self) -> FieldConfig {
        let shared = &self.shared;
        let ode = self.deformation == DeformationKind::Ode;
        let residual = self.deformation == DeformationKind::Residual;
        FieldConfig {
            features: shared.features(),
            time: if ode { self.time } else { 0 },
            hidden: shared.hidden,
            augment_dim: if residual { 0 } else { self.augment_dim },
            layers: if ode { self.layers } else { 2 },
            activation: shared.activation,
            sampling: shared.sampling,
        }
    }

    /// Sizes of a field whose weights change with the time.
    pub fn stacked(&self) -> StackedConfig {
        StackedConfig {
            features: self.shared.features(),
            feature_dim: self.feature_dim,
            segments: self.segments,
            hidden: self.shared.hidden,
            augment_dim: self.augment_dim,
            output_scale: self.output_scale,
            activation: self.shared.activation,
            sampling: self.shared.sampling,
        }
    }

    /// Trained numbers of what deforms, without the encoder.
    pub fn deformation_parameters(&self) -> usize {
        match self.deformation {
            DeformationKind::Ode => self.field().parameters(),
            DeformationKind::Stacked => self.stacked().parameters(),
            DeformationKind::Residual => self.blocks * self.field().parameters(),
        }
    }

    /// The steps of training: those of the `draw`-th step of a run.
    pub fn training_problem(&self, seed: u64, draw: u64) -> Problem {
        self.ending(self.schedule().random(self.method.tableau(), seed, draw))
    }

    /// The steps everywhere else.
    pub fn test_problem(&self) -> Problem {
        let mut problem = self.ending(self.schedule().fixed(self.method.tableau()));
        if let Some(start) = self.test_start {
            problem.span[0] = start;
        }
        if let Some(tolerance) = self.tolerance {
            problem.control = StepController::adaptive(tolerance, tolerance);
        }
        problem
    }

    fn schedule(&self) -> Schedule {
        Schedule { start: self.start, step: self.step }
    }

    fn ending(&self, problem: Problem) -> Problem {
        if self.overshoot { problem.overshooting() } else { problem }
    }

    /// What is wrong beside ranges, one sentence each.
    pub(super) fn conflicts(&self) -> Vec<String> {
        let mut problems = self.shared.conflicts();
        for ([low, high], key) in [(self.start, "start"), (self.step, "step")] {
            if low > high {
                problems
                    .push(format!("`{key}` is [{low}, {high}], expected two numbers that rise"));
            }
        }
        if self.tolerance.is_some() && self.method.tableau().error.is_none() {
            let what = "\"none\": only the methods `bosh3` and `dopri5` estimate their error";
            problems
                .push(format!("`tolerance` is {}, expected {what}", self.tolerance.unwrap_or(0.0)));
        }
        problems
    }
}

train::options! {
    /// The options of Pixel2Mesh in three stages.
    pub struct StagesConfig extends shared: SharedConfig = staged() => {
        /// Residual blocks of each stage.
        pub blocks: usize = 6, in 0..=64;
        /// Columns before the last convolution, which only meshes of several stages have; without, `hidden`.
        #[serde(with = "train::settings::optional")]
        pub last_hidden: Option<usize> = None, in 1..=4096;
        /// How the graph convolutions' weights begin.
        pub graph_init: GraphInit = GraphInit::Uniform;
        /// Whether stages put out displacements of the mesh that they are given instead of new places, as published:
        /// nothing has to learn to reproduce the ellipsoid.
        pub offsets: bool = true;
        /// What the Laplacian term of the first stage counts beside the others'.
        pub first_laplacian: f64 = 0.2, in 0.0..=1e9;
    }
}

/// The options of both, as the stages have them.
fn staged() -> SharedConfig {
    SharedConfig {
        level: 2,
        normal_weight: 0.02,
        laplacian_weight: 5.0,
        move_weight: 1.0,
        ..SharedConfig::default()
    }
}

impl StagesConfig {
    /// Input, hidden and output columns of each stage's chain.
    pub(super) fn sizes(&self) -> Vec<[usize; 3]> {
        let (features, hidden) = (self.shared.features() + 3, self.shared.hidden);
        let stages = self.shared.level as usize + 1;
        let size = |stage: usize| {
            let inputs = if stage == 0 { features } else { features + hidden };
            // The last stage has one more convolution after its chain.
            let last = stage + 1 == stages && stages > 1;
            [inputs, hidden, if last { self.last_columns() } else { 3 }]
        };
        (0..stages).map(size).collect()
    }

    /// Columns before the last convolution.
    pub(super) fn last_columns(&self) -> usize {
        self.last_hidden.unwrap_or(self.shared.hidden)
    }

    /// Trained numbers of what deforms, without the encoder.
    pub fn deformation_parameters(&self) -> usize {
        let conv = |inputs: usize, outputs: usize| 2 * inputs * outputs + outputs;
        let chain = |[inputs, hidden, outputs]: [usize; 3]| {
            conv(inputs, hidden) + 2 * self.blocks * conv(hidden, hidden) + conv(hidden, outputs)
        };
        let sizes = self.sizes();
        let last = if sizes.len() > 1 { conv(self.last_columns(), 3) } else { 0 };
        sizes.into_iter().map(chain).sum::<usize>() + last
    }
}

/// How the weights of graph convolutions begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum GraphInit {
    /// Evenly within one over the root of the outputs, biases too: Pixel2Mesh's versions in PyTorch.
    Uniform,
    /// Glorot's, evenly within `√(6 / (inputs + outputs))`, biases 0: the first version.
    Glorot,
}

/// Methods of integration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// Order 1, one evaluation a step.
    Euler,
    /// Order 2, two.
    Heun,
    /// Order 2, two.
    Midpoint,
    /// Order 4, four.
    Rk4,
    /// Bogacki and Shampine's, order 3, three, estimates its error.
    Bosh3,
    /// Dormand and Prince's, order 5, six, estimates its error.
    Dopri5,
}

impl Method {
    /// Its coefficients.
    pub fn tableau(self) -> &'static Tableau {
        match self {
            Self::Euler => &EULER,
            Self::Heun => &HEUN,
            Self::Midpoint => &MIDPOINT,
            Self::Rk4 => &RK4,
            Self::Bosh3 => &BOSH3,
            Self::Dopri5 => &DOPRI5,
        }
    }
}

/// What deforms the ellipsoid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DeformationKind {
    /// A field, integrated.
    Ode,
    /// A field with weights of its own in each part of the time, integrated.
    Stacked,
    /// Separate blocks with skips: the paper's RES.
    Residual,
}

/// `test-start`: 0 is a value of it; configurations of before said -1 for the middle of `start`.
fn test_start<'de, D: Deserializer<'de>>(from: D) -> Result<Option<f64>, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged, expecting = "a number, or \"none\"")]
    enum Start {
        At(f64),
        Middle(Middle),
    }
    #[derive(Deserialize)]
    #[serde(rename_all = "lowercase")]
    enum Middle {
        None,
    }
    Ok(match Start::deserialize(from)? {
        Start::At(-1.0) | Start::Middle(Middle::None) => None,
        Start::At(start) => Some(start),
    })
}
