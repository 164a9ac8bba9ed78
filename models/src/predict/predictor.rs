//! A system as a user meets it: files in, a mesh out.

use std::time::Instant;

use datasets::ReadOptions;
use mesh_core::{MedianOfEven, TriMesh, median};
use ndarray::ArrayD;
use nets::onnx::OnnxModel;
use recon::fit::RefineConfig;
use train::{Compile, DataError, PredictError, Subset, System};

use super::input::{PredictInput, Request};
use super::sighting::{Features, Sighting};

/// A system that makes a mesh from a user's files.
///
/// All input is [`View`](datasets::View)s: a system of a single image takes the first, with its
/// depth where there is one; one that needs no camera gives its own to images that have none.
pub trait Predictor: System<ReadOptions = ReadOptions> + Compile + 'static {
    /// What it does, in one sentence, for lists.
    const ABOUT: &'static str;
    /// How a checkpoint is had, for those who have none: a command and how long it takes.
    const TRAINING: &'static str;

    /// Steps of refinement on the given views where a user says nothing of it; see [`refined`](super::refined).
    const REFINE: usize = 0;

    /// How its predictions are refined in so many steps.
    fn refinement(steps: usize) -> RefineConfig {
        RefineConfig { steps, ..RefineConfig::default() }
    }

    /// Reads a user's files.
    ///
    /// # Errors
    /// If they are missing or damaged, or do not serve this system.
    fn load(&self, request: &Request<'_>) -> Result<PredictInput, DataError> {
        PredictInput::read(request)
    }

    /// What a prediction is made from under these options, as one asks a user for it: one image, if nothing else is said.
    fn input(_config: &Self::Config) -> String {
        "one image with its mask".to_owned()
    }

    /// Runs the network, once.
    ///
    /// # Errors
    /// Why the input does not serve.
    fn apply(&self, input: &PredictInput) -> Result<Prediction, PredictError>;

    /// The [features](Prediction::features) of objects of a subset, at most so many, spread over all of it; none where the
    /// system has none.
    ///
    /// # Errors
    /// If a file cannot be read.
    fn features_of(
        &self,
        _data: &Self::Data,
        _subset: Subset,
        _most: usize,
    ) -> Result<Vec<Sighting>, DataError> {
        Ok(Vec::new())
    }

    /// What of it is a plain network from an image on, in ONNX's form, for other programs to run; nothing where no part is one.
    /// Images are `[N, C, H, W]` of the size that the configuration says, colours in `[0, 1]`.
    fn to_onnx(&self) -> Option<OnnxModel> {
        None
    }

    /// What the outputs of [`to_onnx`](Self::to_onnx) are for these inputs, computed here, in its axes and order: to hold another
    /// program to.
    ///
    /// # Shapes
    /// Those of the graph: images and maps `[N, C, H, W]`.
    ///
    /// # Panics
    /// If the inputs are not those of the model.
    fn onnx_outputs(&self, _inputs: &[ArrayD<f32>]) -> Vec<ArrayD<f32>> {
        Vec::new()
    }
}

/// What a system makes of its input.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Prediction {
    /// The mesh, coloured where the system knows colours, in the world of the given cameras.
    pub mesh: TriMesh,
    /// The mesh as the network made it, where it was [refined](super::refined) since.
    pub before: Option<TriMesh>,
    /// The mesh on its way from the template to the shape, first and last included, in the same world; empty where the
    /// system goes there in one step.
    pub sequence: Vec<TriMesh>,
    /// What else the system knows of what it predicted, by name: a camera, a selection. Empty where it is the mesh alone.
    pub details: Vec<Detail>,
    /// What the encoder says of each image, by which a [`Familiarity`](super::Familiarity) tells how far the input is from what
    /// was trained on; empty where the system does not say.
    pub features: Features,
    /// What a user should know of how it was made, one sentence each.
    pub warnings: Vec<String>,
}

/// A name and its numbers.
pub type Detail = (&'static str, Vec<f64>);

/// How long a system takes from decoded images to the mesh: the (upper) median of so many runs, milliseconds.
///
/// # Errors
/// Why the input does not serve.
pub fn milliseconds<S: Predictor>(
    system: &S,
    input: &PredictInput,
    runs: usize,
) -> Result<f64, PredictError> {
    let times = (0..runs.max(1))
        .map(|_| {
            let start = Instant::now();
            system.apply(input)?;
            Ok(1e3 * start.elapsed().as_secs_f64())
        })
        .collect::<Result<Vec<f64>, PredictError>>()?;
    Ok(median(times, MedianOfEven::Upper).expect("there is one run"))
}
