//! What a trainable system is.

use std::fmt::Debug;
use std::path::Path;

use autodiff_lite::{Module, Tape, Var};
use serde::{Deserialize, Serialize};

use super::config::{Configuration, TrainConfig};
use super::draw::Draw;
use super::error::{DataError, LossError, PredictError};
use super::inherited::Inherited;
use super::optimizer::OptimizerState;
use super::step_info::StepInfo;
use super::subset::{DataSummary, Subset};
use crate::report::{Scene, ViewPair};
use crate::settings::Options;

/// A trainable system: a model, what it is trained to minimise, and what it predicts.
///
/// The loop ([`train`](fn@super::train)) owns everything that is alike for all: order, steps, files. A
/// system owns its data and its samples: it draws sample by sample from [`Draw`] alone, so that a
/// run that stopped goes on as if it had not.
pub trait System: Module<f32> + Send + Sync + Sized {
    /// The name in commands and files: `img2mesh`.
    const NAME: &'static str;
    /// Complete configurations by name, as TOML: `tiny`, `small`, `paper`.
    const PRESETS: &'static [(&'static str, &'static str)];
    /// The metric that chooses the best checkpoint where the configuration names none.
    const BEST: &'static str;

    /// The system's options. Beside them in the same table stand those of
    /// [`TrainConfig`](super::TrainConfig).
    type Config: Options + Clone + Debug + PartialEq + Send + Sync;
    /// How a user may ask for files to be read, beside the configuration; `()` if there is no choice.
    type ReadOptions;
    /// What samples are drawn from.
    type Data: Send + Sync;
    /// One sample, ready for the tape.
    type Sample: Send + Sync;
    /// What a prediction is made from.
    type Input: ?Sized;
    /// What is predicted.
    type Prediction;

    /// What is wrong with options, one sentence each; empty when nothing is. Beside ranges what several must agree on.
    fn check(config: &Self::Config) -> Vec<String> {
        config.out_of_range()
    }

    /// The same of the loop's options and the system's together.
    fn problems(config: &Configuration<Self::Config>) -> Vec<String> {
        let mut problems = config.train.check();
        problems.extend(Self::check(&config.system));
        problems
    }

    /// What options amount to, in milliseconds and without the arrays: shapes, parameter count. `config` passed
    /// [`check`](Self::check).
    fn summary(config: &Self::Config) -> Summary;

    /// A fresh system. `config` passed [`check`](Self::check); all first weights follow from `seed`.
    fn new(config: &Self::Config, seed: u64) -> Self;

    /// Called once on a fresh system: takes over what the data decides, its scale or statistics,
    /// into parameters that are not trained, so that checkpoints have it; and reads the files of
    /// weights that its configuration names. What was learned by the training that it
    /// [begins with](super::Job::from) stays: see [`Inherited::has`].
    ///
    /// # Errors
    /// If such a file is damaged or does not fit.
    fn init_from_data(
        &mut self,
        _data: &Self::Data,
        _inherited: Option<&Inherited>,
    ) -> Result<(), DataError> {
        Ok(())
    }

    /// Opens or makes the data.
    ///
    /// # Errors
    /// If files are missing or damaged, or the data does not serve this system.
    fn open(
        config: &Self::Config,
        source: &Source<'_, Self::ReadOptions>,
    ) -> Result<Self::Data, DataError>;

    /// A number that another content of the data changes; see [`Fingerprint`](super::Fingerprint).
    fn fingerprint(data: &Self::Data) -> u64;

    /// Samples in an epoch; at least one, but for data that nothing can be learned from.
    fn epoch_len(&self, data: &Self::Data) -> usize;

    /// One sample, a function of `draw` alone and not of the parameters: it may be drawn while the
    /// step before it is computed. Called from any thread.
    ///
    /// # Errors
    /// If a file cannot be read.
    fn draw(&self, data: &Self::Data, draw: &Draw) -> Result<Self::Sample, DataError>;

    /// What a sample is called when something is wrong with it.
    fn name_of(sample: &Self::Sample) -> String;

    /// The loss of a batch as named, weighted terms, each a mean over the samples. The names are
    /// the same at every step.
    ///
    /// The batch may be a part of the one that was asked for, on a tape of its own; see
    /// [`coupling`](Self::coupling).
    ///
    /// # Errors
    /// If it has no value: an equation that it rests on could not be solved. Terms of which none has a weight other than 0 end
    /// the training with [`LossError::Weightless`]; options that could make them so are for [`check`](Self::check) to refuse.
    fn loss<'t>(
        &self,
        tape: &'t Tape,
        batch: &[Self::Sample],
        at: StepInfo,
    ) -> Result<Terms<'t>, LossError>;

    /// How much data there is for what, and what a user should know of its parts; none where the system does not say.
    fn data_summary(_data: &Self::Data) -> Option<DataSummary> {
        None
    }

    /// Scores on a subset. Deterministic; the first call and the thousandth agree. The loop asks for
    /// [`Subset::Validation`], by which the best checkpoint is chosen, and for no other.
    ///
    /// # Errors
    /// If a file cannot be read, or there is nothing for that.
    fn evaluate(&self, data: &Self::Data, subset: Subset) -> Result<Vec<Metric>, DataError>;

    /// Images to look at: the model above the truth, of a subset. The loop shows [`Subset::Validation`].
    ///
    /// # Errors
    /// If a file cannot be read, or there is nothing for that.
    fn show(&self, _data: &Self::Data, _subset: Subset) -> Result<Shown, DataError> {
        Ok(Shown::default())
    }

    /// Called before each epoch, the first included; may change parameters, their shapes and which
    /// of them are trained.
    ///
    /// A parameter that gets another shape takes its moments along ([`OptimizerState::carry`]) or forgets
    /// them. What the shapes are must follow from the configuration and `epoch`: when a checkpoint
    /// is loaded, a fresh system is led through the same epochs before the values are filled in.
    fn begin_epoch(&mut self, _epoch: u64, _state: &mut OptimizerState<'_>) {}

    /// Why what is computed for a sample depends on the others of its batch (batch statistics, attention over the batch), and
    /// the option that ends that; none where it does not. Such a batch cannot be cut into shards.
    fn coupling(&self) -> Option<&'static str> {
        None
    }

    /// Parameters, by the beginning of their path, whose learning rate is multiplied by a factor.
    fn rates(&self) -> Vec<(String, f64)> {
        Vec::new()
    }

    /// Applies the system.
    ///
    /// # Errors
    /// Why it cannot be applied to this input.
    fn predict(&self, input: &Self::Input) -> Result<Self::Prediction, PredictError>;
}

/// The name of the metric that chooses the best checkpoint of a system.
pub(super) fn best_of<S: System>(config: &TrainConfig) -> &str {
    config.best.as_deref().unwrap_or(S::BEST)
}

/// Where data comes from.
pub struct Source<'a, O = ()> {
    /// A file or folder; none for what the system makes itself.
    pub path: Option<&'a Path>,
    /// How it is read: the system's [`ReadOptions`](System::ReadOptions).
    pub options: &'a O,
    /// Seed of the run, for data that is made.
    pub seed: u64,
    /// Told how much is done, of how much, from any thread.
    pub progress: &'a (dyn Fn(usize, usize) + Sync),
}

impl<O> Clone for Source<'_, O> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<O> Copy for Source<'_, O> {}

impl<O> Debug for Source<'_, O> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Source").field("path", &self.path).finish_non_exhaustive()
    }
}

/// One part of a loss.
#[derive(Clone, Copy, Debug)]
pub struct Term<'t> {
    /// Its name in logs.
    pub name: &'static str,
    /// What it is multiplied by in the sum. With 0 it adds nothing, whatever its value, and is logged as 0.
    pub weight: f64,
    /// Its value, a scalar.
    pub value: Var<'t>,
}

/// The parts of a loss, in the order of the logs. At least one has a weight other than 0.
#[derive(Clone, Debug, Default)]
pub struct Terms<'t>(pub Vec<Term<'t>>);

impl<'t> Terms<'t> {
    /// No parts yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// With one more part.
    ///
    /// # Shapes
    /// `value []`, a scalar.
    #[must_use]
    pub fn with(mut self, name: &'static str, weight: f64, value: Var<'t>) -> Self {
        self.0.push(Term { name, weight, value });
        self
    }
}

/// A score.
#[derive(Clone, Debug, PartialEq)]
pub struct Metric {
    /// Its name in logs.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Which way is up.
    pub better: Better,
    /// The value of each object by its name, where the score is a mean over objects; else empty.
    pub by_object: Vec<(String, f64)>,
}

impl Metric {
    /// A score of which more is better.
    pub fn larger(name: impl Into<String>, value: f64) -> Self {
        Self { name: name.into(), value, better: Better::Larger, by_object: Vec::new() }
    }

    /// A score of which less is better.
    pub fn smaller(name: impl Into<String>, value: f64) -> Self {
        Self { better: Better::Smaller, ..Self::larger(name, value) }
    }

    /// With the values that it is the mean of.
    #[must_use]
    pub fn of_objects(self, by_object: Vec<(String, f64)>) -> Self {
        Self { by_object, ..self }
    }
}

/// Which values of a score are better.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Better {
    /// The larger.
    Larger,
    /// The smaller.
    Smaller,
}

impl Better {
    /// Whether `value` is better than `other`; what is not a number never is.
    pub fn improves(self, value: f64, other: f64) -> bool {
        match self {
            Self::Larger => value > other,
            Self::Smaller => value < other,
        }
    }
}

/// What a configuration amounts to.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Summary {
    /// Trainable parameter count.
    pub trainable: usize,
    /// Numbers that are not.
    pub frozen: usize,
    /// Parts of the model and the shapes between them, for people.
    pub shapes: Vec<(String, String)>,
}

/// What a system has to show.
#[derive(Clone, Debug, Default)]
pub struct Shown {
    /// The model above the truth.
    pub views: Vec<ViewPair>,
    /// A mesh to turn.
    pub scene: Option<Scene>,
}
