//! A system as a user meets it: files in, a mesh out.

use std::time::Instant;

use mesh_core::TriMesh;

use super::material::{Material, Request};
use crate::img2mesh::Img2Mesh;
use crate::mcmr::Mcmr;
use crate::pixel2mesh::{Deformer, SingleView};
use crate::train::{DataError, System};

/// How often a prediction is timed.
const TIMED: usize = 5;

/// A system that makes a mesh from a user's files.
///
/// All material is [`View`](datasets::View)s: a system of a single picture takes the first, with its
/// depth where there is one; one that needs no camera gives its own to pictures that have none.
pub trait Predictor: System {
    /// How a checkpoint is had, for those who have none: a command and how long it takes.
    const TRAINING: &'static str;

    /// Reads a user's files.
    ///
    /// # Errors
    /// If they are missing or damaged, or do not serve this system.
    fn gather(&self, request: &Request<'_>) -> Result<Material, DataError> {
        Material::read(request)
    }

    /// The mesh, coloured where the system knows colours, in the world of the given cameras.
    ///
    /// # Errors
    /// Why the material does not serve, in one sentence.
    fn mesh(&self, material: &Material) -> Result<TriMesh, String>;

    /// The mesh on its way from the template to the shape, first and last included, in the same world; empty where the
    /// system goes there in one step.
    ///
    /// # Errors
    /// Why the material does not serve, in one sentence.
    fn sequence(&self, _material: &Material) -> Result<Vec<TriMesh>, String> {
        Ok(Vec::new())
    }

    /// What else the system knows of what it predicted, by name: a camera, a selection. Empty where it is the mesh alone.
    ///
    /// # Errors
    /// Why the material does not serve, in one sentence.
    fn details(&self, _material: &Material) -> Result<Vec<Detail>, String> {
        Ok(Vec::new())
    }
}

/// A name and its numbers.
pub type Detail = (&'static str, Vec<f64>);

/// Meshes of a deformation through time.
const FRAMES: usize = 25;

impl<D: Deformer> Predictor for SingleView<D> {
    const TRAINING: &'static str = D::TRAINING;

    fn gather(&self, request: &Request<'_>) -> Result<Material, DataError> {
        Material::single(request)
    }

    fn mesh(&self, material: &Material) -> Result<TriMesh, String> {
        self.predict(&material.given)
    }

    fn sequence(&self, material: &Material) -> Result<Vec<TriMesh>, String> {
        let picture = self.picture(&material.given)?;
        let meshes = self.sequence_of(&picture, FRAMES).map_err(|error| error.to_string())?;
        Ok(meshes.into_iter().map(|mesh| picture.frame.mesh_in_world(mesh)).collect())
    }
}

impl Predictor for Img2Mesh {
    const TRAINING: &'static str = "`unsphere train img2mesh VIEWS -o runs/mine` trains one, in about three minutes on two \
         cores (a rough one with --preset tiny, in seconds)";

    fn mesh(&self, material: &Material) -> Result<TriMesh, String> {
        self.predict(&material.given)
    }
}

impl Predictor for Mcmr {
    const TRAINING: &'static str = "`unsphere train mcmr -o runs/mine` trains one on made photographs, in about five minutes on two cores \
         (a rough one with --preset tiny, in seconds)";

    fn gather(&self, request: &Request<'_>) -> Result<Material, DataError> {
        Material::single(request)
    }

    fn mesh(&self, material: &Material) -> Result<TriMesh, String> {
        Ok(self.predict(&material.given)?.mesh_in_world())
    }

    fn details(&self, material: &Material) -> Result<Vec<Detail>, String> {
        let found = self.predict(&material.given)?;
        let [x, y] = found.pose.place;
        Ok(vec![
            ("selection", found.weights.iter().map(|&w| f64::from(w)).collect()),
            ("camera-scale", vec![found.pose.scale]),
            ("camera-place", vec![x, y]),
            ("camera-quaternion", found.pose.rotation.to_vec()),
            ("mesh-to-world", found.to_world.concat()),
        ])
    }
}

/// A mesh, and how long it took.
#[derive(Clone, Debug, PartialEq)]
pub struct Prediction {
    /// The mesh.
    pub mesh: TriMesh,
    /// From decoded pictures to the mesh, the median of five: the first ones warm up.
    pub milliseconds: f64,
    /// The mesh on its way, where the system has one.
    pub sequence: Vec<TriMesh>,
    /// What else the system knows; see [`Predictor::details`].
    pub details: Vec<Detail>,
}

/// Applies a system and takes the time.
///
/// # Errors
/// Why the material does not serve, in one sentence.
pub fn predict<S: Predictor>(system: &S, material: &Material) -> Result<Prediction, String> {
    let mut times = Vec::with_capacity(TIMED);
    let mut timed = || {
        let start = Instant::now();
        let mesh = system.mesh(material)?;
        times.push(1e3 * start.elapsed().as_secs_f64());
        Ok::<_, String>(mesh)
    };
    let mesh = timed()?;
    for _ in 1..TIMED {
        timed()?;
    }
    times.sort_by(f64::total_cmp);
    let sequence = system.sequence(material)?;
    let details = system.details(material)?;
    Ok(Prediction { mesh, milliseconds: times[TIMED / 2], sequence, details })
}
