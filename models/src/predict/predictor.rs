//! A system as a user meets it: files in, a mesh out.

use std::time::Instant;

use mesh_core::TriMesh;
use train::{DataError, System};

use super::input::{PredictInput, Request};
use crate::img2mesh::Img2Mesh;
use crate::mcmr::Mcmr;
use crate::pixel2mesh::{Deformer, SingleView};

/// A system that makes a mesh from a user's files.
///
/// All input is [`View`](datasets::View)s: a system of a single image takes the first, with its
/// depth where there is one; one that needs no camera gives its own to images that have none.
pub trait Predictor: System {
    /// How a checkpoint is had, for those who have none: a command and how long it takes.
    const TRAINING: &'static str;

    /// Reads a user's files.
    ///
    /// # Errors
    /// If they are missing or damaged, or do not serve this system.
    fn load(&self, request: &Request<'_>) -> Result<PredictInput, DataError> {
        PredictInput::read(request)
    }

    /// What a prediction is made from under these options, as one asks a user for it.
    fn input(config: &Self::Config) -> String;

    /// Runs the network, once.
    ///
    /// # Errors
    /// Why the input does not serve, in one sentence.
    fn apply(&self, input: &PredictInput) -> Result<Prediction, String>;
}

/// What a system makes of its input.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Prediction {
    /// The mesh, coloured where the system knows colours, in the world of the given cameras.
    pub mesh: TriMesh,
    /// The mesh on its way from the template to the shape, first and last included, in the same world; empty where the
    /// system goes there in one step.
    pub sequence: Vec<TriMesh>,
    /// What else the system knows of what it predicted, by name: a camera, a selection. Empty where it is the mesh alone.
    pub details: Vec<Detail>,
}

/// A name and its numbers.
pub type Detail = (&'static str, Vec<f64>);

/// Meshes of a deformation through time.
const FRAMES: usize = 25;

/// What systems ask for that see one image and nothing else.
const ONE_PICTURE: &str = "one image with its mask";

impl<D: Deformer> Predictor for SingleView<D> {
    const TRAINING: &'static str = D::TRAINING;

    fn load(&self, request: &Request<'_>) -> Result<PredictInput, DataError> {
        PredictInput::single(request)
    }

    fn input(_: &D::Config) -> String {
        ONE_PICTURE.to_owned()
    }

    fn apply(&self, input: &PredictInput) -> Result<Prediction, String> {
        let picture = self.picture(&input.given)?;
        let (mesh, sequence) =
            self.mesh_and_sequence_of(&picture, FRAMES).map_err(|error| error.to_string())?;
        let in_world = |mesh| picture.frame.mesh_in_world(mesh);
        Ok(Prediction {
            mesh: in_world(mesh),
            sequence: sequence.into_iter().map(in_world).collect(),
            details: Vec::new(),
        })
    }
}

impl Predictor for Img2Mesh {
    const TRAINING: &'static str = "`unsphere train img2mesh VIEWS -o runs/mine` trains one, in about three minutes on two \
         cores (a rough one with --preset tiny, in seconds)";

    fn input(_: &Self::Config) -> String {
        "views of one object: images, masks and cameras".to_owned()
    }

    fn apply(&self, input: &PredictInput) -> Result<Prediction, String> {
        Ok(Prediction { mesh: self.predict(&input.given)?, ..Prediction::default() })
    }
}

impl Predictor for Mcmr {
    const TRAINING: &'static str = "`unsphere train mcmr -o runs/mine` trains one on made photographs, in about five minutes on two cores \
         (a rough one with --preset tiny, in seconds)";

    fn load(&self, request: &Request<'_>) -> Result<PredictInput, DataError> {
        PredictInput::single(request)
    }

    fn input(_: &Self::Config) -> String {
        ONE_PICTURE.to_owned()
    }

    fn apply(&self, input: &PredictInput) -> Result<Prediction, String> {
        let found = self.predict(&input.given)?;
        let [x, y] = found.pose.place;
        let details = vec![
            ("selection", found.weights.iter().map(|&w| f64::from(w)).collect()),
            ("camera-scale", vec![found.pose.scale]),
            ("camera-place", vec![x, y]),
            ("camera-quaternion", found.pose.rotation.to_vec()),
            ("mesh-to-world", found.to_world.concat()),
        ];
        Ok(Prediction { mesh: found.mesh_in_world(), sequence: Vec::new(), details })
    }
}

/// How long a system takes from decoded images to the mesh: the median of so many runs, milliseconds.
///
/// # Errors
/// Why the input does not serve, in one sentence.
pub fn milliseconds<S: Predictor>(
    system: &S,
    input: &PredictInput,
    runs: usize,
) -> Result<f64, String> {
    let mut times = (0..runs.max(1))
        .map(|_| {
            let start = Instant::now();
            system.apply(input)?;
            Ok(1e3 * start.elapsed().as_secs_f64())
        })
        .collect::<Result<Vec<f64>, String>>()?;
    times.sort_by(f64::total_cmp);
    Ok(times[times.len() / 2])
}
