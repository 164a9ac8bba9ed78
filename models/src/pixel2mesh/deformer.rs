//! What the systems of a single image differ in.

use std::fmt::Debug;

use autodiff_lite::{Module, Var};
use nets::Init;
use ode_deform::solve::{SolveError, Stats};
use train::Compiled;
use train::settings::Options;

use super::config::SharedConfig;
use super::single_view::SingleView;
use super::template::Template;
use crate::instance::Instance;
use crate::paired::{Pair, Pairs};

/// Turns feature maps and a camera into meshes.
pub trait Deformer: Module<f32> + Debug + Send + Sync + Sized + 'static {
    /// The name of its system.
    const NAME: &'static str;
    /// Its system's configurations by name.
    const PRESETS: &'static [(&'static str, &'static str)];
    /// How a checkpoint is had.
    const TRAINING: &'static str;
    /// What its system does, in one sentence.
    const ABOUT: &'static str;

    /// Its system's options.
    type Config: Options + Clone + Debug + PartialEq + Send + Sync;

    /// The options that all have.
    fn shared(config: &Self::Config) -> &SharedConfig;

    /// What is wrong with options, one sentence each.
    fn check(config: &Self::Config) -> Vec<String>;

    /// Its trained numbers, and the shapes between its parts.
    fn size(config: &Self::Config) -> (usize, Vec<(String, String)>);

    /// With fresh parameters.
    fn new(config: &Self::Config, init: &Init, template: &Template) -> Self;

    /// The loop of its system; see [`Compile::compiled`](train::Compile::compiled).
    fn compiled() -> Compiled<SingleView<Self>>;

    /// What of its system runs the network.
    fn instance(system: &SingleView<Self>) -> &dyn Instance<Pairs, Pair>;

    /// Meshes of all stages.
    ///
    /// # Shapes
    /// `inputs`: the camera `[N, 3, 4]` and the feature maps `[N, H, W, C]`.
    ///
    /// # Errors
    /// If an integration does not come to its end.
    fn deform<'t>(
        &self,
        template: &Template,
        inputs: &[Var<'t>],
        run: Run,
    ) -> Result<Deformed<'t>, SolveError>;
}

/// What a deformation is for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Run {
    /// A step of a training: random where the method is, by the seed of the run and the number of the step.
    Training {
        /// Of the run.
        seed: u64,
        /// Steps before.
        step: u64,
    },
    /// Anything else: the same each time.
    Test,
    /// The same, with the meshes at so many times from the first to the last, evenly spaced.
    Sequence {
        /// At least two.
        frames: usize,
    },
}

/// Meshes on their way.
#[derive(Clone, Debug)]
pub struct Deformed<'t> {
    /// What losses are taken of; the last is the prediction.
    pub stages: Vec<Stage<'t>>,
    /// Positions at asked times, `[N, V, 3]` of one level each.
    pub sequence: Vec<Var<'t>>,
    /// How much work an integration was.
    pub stats: Stats,
}

/// The mesh after one stage.
#[derive(Clone, Copy, Debug)]
pub struct Stage<'t> {
    /// The level of the template whose vertices these are.
    pub level: usize,
    /// `[N, V, 3]`, in the frame of the images.
    pub positions: Var<'t>,
    /// The mesh that went into the stage, with as many vertices.
    pub before: Var<'t>,
    /// What the change of Laplacian coordinates counts here.
    pub laplacian: f64,
    /// What displacements count here.
    pub displacement: f64,
}
