//! What the two systems can be told, beside the loop's own options.

use autodiff_lite::Activation;
use nets::{EncoderInit, MapSampling};
use ode_deform::Adjoint;
use ode_deform::deform::{FieldConfig, Schedule, StackedConfig};
use ode_deform::solve::{
    BOSH3, DOPRI5, EULER, HEUN, MIDPOINT, Problem, RK4, StepController, Tableau,
};
use serde::{Deserialize, Serialize};

use crate::paired::PairsConfig;

/// What both have: images, encoder, template, losses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case")]
pub struct SharedConfig {
    /// The data.
    #[serde(flatten)]
    pub pairs: PairsConfig,
    /// Channels of the encoder's six stages, 1 to 2048 each; maps are read from the last four.
    /// Default a quarter of the published `[16, 32, 64, 128, 256, 512]`.
    pub channels: [usize; 6],
    /// How the encoder's weights begin. Default `"he"`; published deviations of 0.02 let the image fade on its way.
    pub encoder_init: EncoderInitKind,
    /// Whether the encoder's layers are plain or residual. Default `"plain"`, as published.
    pub encoder_form: EncoderForm,
    /// What maps are multiplied by before they are read, above 0 to 1000. Default 1. Residual encoders put out features of about 1, and a
    /// step of Adam changes what is read linearly from many such at once too much; 0.1 serves them.
    pub feature_scale: f64,
    /// How often the ellipsoid of 156 vertices is subdivided, 0 to 3. Default 1: 618 vertices.
    pub level: u32,
    /// Columns inside of the graph convolutions. Default 96; published 192.
    pub hidden: usize,
    /// After graph convolutions. Default `"relu"`; the version that the ODE paper started from has none.
    pub activation: ActivationKind,
    /// How feature maps are read. Default `"bilinear"`; published `"floor"`, by a slip.
    pub sampling: SamplingKind,
    /// Weight of the Chamfer distance: the mean squared distances of both ways. Default 100.
    pub chamfer_weight: f64,
    /// What its way from prediction to truth counts beside the other. Default 1; 0.55 in the original Pixel2Mesh.
    pub chamfer_back: f64,
    /// Weight of the mean squared edge length. Default 5.
    pub edge_weight: f64,
    /// Weight of edges against the true normals. Default 0.
    pub normal_weight: f64,
    /// Weight of the change of Laplacian coordinates, a mean over vertices. Default 0.
    pub laplacian_weight: f64,
    /// Weight of the mean squared displacement. Default 0.
    pub move_weight: f64,
}

impl Default for SharedConfig {
    fn default() -> Self {
        Self {
            pairs: PairsConfig::default(),
            channels: [8, 8, 16, 32, 64, 64],
            encoder_init: EncoderInitKind::He,
            encoder_form: EncoderForm::Plain,
            feature_scale: 1.0,
            level: 1,
            hidden: 96,
            activation: ActivationKind::Relu,
            sampling: SamplingKind::Bilinear,
            chamfer_weight: 100.0,
            chamfer_back: 1.0,
            edge_weight: 5.0,
            normal_weight: 0.0,
            laplacian_weight: 0.0,
            move_weight: 0.0,
        }
    }
}

impl SharedConfig {
    /// Channels of the four maps together.
    pub fn features(&self) -> usize {
        self.channels[2..].iter().sum()
    }

    pub(super) fn check(&self) -> Vec<String> {
        let mut problems = self.pairs.check();
        let mut require = |holds: bool, field: &str, found: &dyn std::fmt::Display, what: &str| {
            if !holds {
                problems.push(format!("`{field}` is {found}, expected {what}"));
            }
        };
        let all = format!("{:?}", self.channels);
        let sound = self.channels.iter().all(|c| (1..=2048).contains(c));
        require(sound, "channels", &all, "1 to 2048 each");
        require(self.level <= 3, "level", &self.level, "0 to 3");
        let scale = self.feature_scale;
        require(scale > 0.0 && scale <= 1e3, "feature-scale", &scale, "above 0 to 1000");
        require((1..=4096).contains(&self.hidden), "hidden", &self.hidden, "1 to 4096");
        for (weight, field) in [
            (self.chamfer_weight, "chamfer-weight"),
            (self.chamfer_back, "chamfer-back"),
            (self.edge_weight, "edge-weight"),
            (self.normal_weight, "normal-weight"),
            (self.laplacian_weight, "laplacian-weight"),
            (self.move_weight, "move-weight"),
        ] {
            require((0.0..=1e9).contains(&weight), field, &weight, "0 to 1e9");
        }
        require(self.chamfer_weight > 0.0, "chamfer-weight", &self.chamfer_weight, "more than 0");
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

/// What an encoder's layers are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EncoderForm {
    /// A convolution and a ReLU.
    Plain,
    /// With group norms, and skips around convolutions that do not halve.
    Residual,
}

/// The options of a deformation in continuous time, and of the residual networks that it is compared with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case")]
pub struct OdeConfig {
    /// What both systems have.
    #[serde(flatten)]
    pub shared: SharedConfig,
    /// What deforms. Default `"ode"`.
    pub deformation: DeformationKind,
    /// Blocks of the residual network, 1 to 64. Default 8.
    pub blocks: usize,
    /// Graph convolutions of the field, 2 to 8; residual blocks and stacked fields have two. Default 2, as published.
    pub layers: usize,
    /// Columns of the field's state beside positions, 0 to 256: what a vertex remembers of its way. Default 0, as
    /// published.
    #[serde(alias = "memory")]
    pub augment_dim: usize,
    /// Columns in which the time is repeated, 0 to 4096. Default 196, as published; 1 says the same.
    pub time: usize,
    /// Columns that a stacked field reads features through, 1 to 4096. Default 24.
    #[serde(alias = "reading")]
    pub feature_dim: usize,
    /// Parts of the time for which a stacked field has weights of their own, 1 to 64. Default 8.
    #[serde(alias = "pieces")]
    pub segments: usize,
    /// What the sums of a stacked field are multiplied by to be velocities, above 0 to 1000. Default 8: with as many steps
    /// a change of the weights moves vertices as far as in residual blocks.
    #[serde(alias = "speed")]
    pub output_scale: f64,
    /// What the first velocities are multiplied by, more than 0. Default 0.1: of the published size they would crumple
    /// the ellipsoid before the first step.
    pub first_velocity: f64,
    /// The method. Default `"euler"`.
    pub method: Method,
    /// Least and greatest start in training, in [0, 1). Default [0, 0.25].
    pub start: [f64; 2],
    /// Least and greatest step in training; elsewhere all have their mean. Default [0.05, 0.2].
    pub step: [f64; 2],
    /// Where a test starts; -1 stands for the middle of `start`. Default -1.
    pub test_start: f64,
    /// Relative and absolute error of methods that estimate it (`bosh3`, `dopri5`) outside of training; 0 keeps the
    /// fixed steps. Default 0.
    pub tolerance: f64,
    /// Whether the last step may go past 1, as in the published loop. Default false.
    pub overshoot: bool,
    /// How gradients are found. Default `"checkpointed"`.
    pub adjoint: AdjointKind,
}

impl Default for OdeConfig {
    fn default() -> Self {
        Self {
            shared: SharedConfig::default(),
            deformation: DeformationKind::Ode,
            blocks: 8,
            layers: 2,
            augment_dim: 0,
            time: 196,
            feature_dim: 24,
            segments: 8,
            output_scale: 8.0,
            first_velocity: 0.1,
            method: Method::Euler,
            start: Schedule::DEEP.start,
            step: Schedule::DEEP.step,
            test_start: -1.0,
            tolerance: 0.0,
            overshoot: false,
            adjoint: AdjointKind::Checkpointed,
        }
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
            activation: shared.activation.into(),
            sampling: shared.sampling.into(),
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
            activation: self.shared.activation.into(),
            sampling: self.shared.sampling.into(),
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
        if self.test_start >= 0.0 {
            problem.span[0] = self.test_start;
        }
        if self.tolerance > 0.0 {
            problem.control = StepController::adaptive(self.tolerance, self.tolerance);
        }
        problem
    }

    fn schedule(&self) -> Schedule {
        Schedule { start: self.start, step: self.step }
    }

    fn ending(&self, problem: Problem) -> Problem {
        if self.overshoot { problem.overshooting() } else { problem }
    }

    pub(super) fn check(&self) -> Vec<String> {
        let mut problems = self.shared.check();
        let mut require = |holds: bool, field: &str, found: String, what: &str| {
            if !holds {
                problems.push(format!("`{field}` is {found}, expected {what}"));
            }
        };
        require((1..=64).contains(&self.blocks), "blocks", self.blocks.to_string(), "1 to 64");
        require((2..=8).contains(&self.layers), "layers", self.layers.to_string(), "2 to 8");
        require(self.augment_dim <= 256, "augment-dim", self.augment_dim.to_string(), "0 to 256");
        require(self.time <= 4096, "time", self.time.to_string(), "0 to 4096");
        require(
            (1..=4096).contains(&self.feature_dim),
            "feature-dim",
            self.feature_dim.to_string(),
            "1 to 4096",
        );
        require(
            (1..=64).contains(&self.segments),
            "segments",
            self.segments.to_string(),
            "1 to 64",
        );
        for (factor, field) in
            [(self.first_velocity, "first-velocity"), (self.output_scale, "output-scale")]
        {
            let sound = factor > 0.0 && factor <= 1e3;
            require(sound, field, factor.to_string(), "above 0 to 1000");
        }
        let [low, high] = self.start;
        let sound = (0.0..1.0).contains(&low) && low <= high && high < 1.0;
        require(
            sound,
            "start",
            format!("{:?}", self.start),
            "two numbers that rise, from 0 to below 1",
        );
        let [low, high] = self.step;
        let sound = low >= 1e-4 && low <= high && high <= 1.0;
        require(sound, "step", format!("{:?}", self.step), "two numbers that rise, from 1e-4 to 1");
        let sound = self.test_start == -1.0 || (0.0..1.0).contains(&self.test_start);
        require(sound, "test-start", self.test_start.to_string(), "-1, or 0 to below 1");
        let estimates = self.method.tableau().error.is_some();
        let sound = self.tolerance == 0.0 || (estimates && (1e-10..=1.0).contains(&self.tolerance));
        let what = "0, or 1e-10 to 1 with the methods `bosh3` and `dopri5`";
        require(sound, "tolerance", self.tolerance.to_string(), what);
        problems
    }
}

/// The options of Pixel2Mesh in three stages.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case")]
pub struct StagesConfig {
    /// What both systems have; `level` is that of the last of `level + 1` stages.
    #[serde(flatten)]
    pub shared: SharedConfig,
    /// Residual blocks of each stage, 0 to 64. Default 6.
    pub blocks: usize,
    /// Whether stages put out displacements of the mesh that they are given instead of new places, as published.
    /// Default true: nothing has to learn to reproduce the ellipsoid.
    pub offsets: bool,
    /// What the Laplacian term of the first stage counts beside the others'. Default 0.2.
    pub first_laplacian: f64,
}

impl Default for StagesConfig {
    fn default() -> Self {
        let shared = SharedConfig {
            level: 2,
            normal_weight: 0.02,
            laplacian_weight: 5.0,
            move_weight: 1.0,
            ..SharedConfig::default()
        };
        Self { shared, blocks: 6, offsets: true, first_laplacian: 0.2 }
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
            [inputs, hidden, if last { hidden } else { 3 }]
        };
        (0..stages).map(size).collect()
    }

    /// Trained numbers of what deforms, without the encoder.
    pub fn deformation_parameters(&self) -> usize {
        let conv = |inputs: usize, outputs: usize| 2 * inputs * outputs + outputs;
        let chain = |[inputs, hidden, outputs]: [usize; 3]| {
            conv(inputs, hidden) + 2 * self.blocks * conv(hidden, hidden) + conv(hidden, outputs)
        };
        let sizes = self.sizes();
        let last = if sizes.len() > 1 { conv(self.shared.hidden, 3) } else { 0 };
        sizes.into_iter().map(chain).sum::<usize>() + last
    }

    pub(super) fn check(&self) -> Vec<String> {
        let mut problems = self.shared.check();
        if self.blocks > 64 {
            problems.push(format!("`blocks` is {}, expected 0 to 64", self.blocks));
        }
        if !(0.0..=1e9).contains(&self.first_laplacian) {
            let found = self.first_laplacian;
            problems.push(format!("`first-laplacian` is {found}, expected 0 to 1e9"));
        }
        problems
    }
}

macro_rules! choices {
    ($($(#[$doc:meta])* $name:ident => $of:ty { $($(#[$one:meta])* $variant:ident => $value:expr,)+ })+) => {
        $(
            $(#[$doc])*
            #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
            #[serde(rename_all = "lowercase")]
            pub enum $name {
                $($(#[$one])* $variant,)+
            }

            impl From<$name> for $of {
                fn from(choice: $name) -> Self {
                    match choice {
                        $($name::$variant => $value,)+
                    }
                }
            }
        )+
    };
}

choices! {
    /// How the encoder's weights begin.
    EncoderInitKind => EncoderInit {
        /// As large behind a layer as before it.
        He => EncoderInit::He,
        /// Deviation 0.02.
        Published => EncoderInit::Published,
    }
    /// After graph convolutions.
    ActivationKind => Activation {
        /// None: each evaluation is affine in its features.
        None => Activation::None,
        /// The larger of 0 and the value.
        Relu => Activation::Relu,
        /// Smooth: methods of higher order reach their order.
        Tanh => Activation::Tanh,
    }
    /// How feature maps are read.
    SamplingKind => MapSampling {
        /// Between pixels.
        Bilinear => MapSampling::Bilinear,
        /// At the pixel that a point lies in.
        Floor => MapSampling::Floor,
    }
    /// How gradients of an integration are found.
    AdjointKind => Adjoint {
        /// Everything is kept.
        Direct => Adjoint::Direct,
        /// States are kept, steps are computed once more.
        Checkpointed => Adjoint::Checkpointed,
        /// Nothing is kept; approximate.
        Backsolve => Adjoint::Backsolve,
    }
    /// Methods of integration.
    Method => &'static Tableau {
        /// Order 1, one evaluation a step.
        Euler => &EULER,
        /// Order 2, two.
        Heun => &HEUN,
        /// Order 2, two.
        Midpoint => &MIDPOINT,
        /// Order 4, four.
        Rk4 => &RK4,
        /// Bogacki and Shampine's, order 3, three, estimates its error.
        Bosh3 => &BOSH3,
        /// Dormand and Prince's, order 5, six, estimates its error.
        Dopri5 => &DOPRI5,
    }
}

impl Method {
    /// Its coefficients.
    pub fn tableau(self) -> &'static Tableau {
        self.into()
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
