//! Predictions for the objects that are scored, as meshes beside the truth: for whoever draws or compares them.

use mesh_core::TriMesh;
use train::{DataError, System};

/// A prediction beside its truth, both in one frame: the world of the object's cameras, or the object's own.
#[derive(Clone, Debug)]
pub struct MeshPair {
    /// The object: `category/name`.
    pub name: String,
    /// What was predicted; none where nothing came of it.
    pub mesh: Option<TriMesh>,
    /// What is true.
    pub truth: TriMesh,
}

/// A system that predicts meshes of objects whose true mesh its data may have.
pub trait MeshPairs: System {
    /// The names of the objects that are tested; empty where they have no true mesh.
    fn scored_objects(&self, data: &Self::Data) -> Vec<String>;

    /// The prediction for one of them, from the first of the images that it is scored with; none if it is none of them.
    ///
    /// # Errors
    /// If a file cannot be read.
    fn mesh_pair(&self, data: &Self::Data, name: &str) -> Result<Option<MeshPair>, DataError>;
}
