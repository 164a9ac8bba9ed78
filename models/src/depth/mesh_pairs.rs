//! Predictions beside the truth.

use train::{DataError, Subset};

use super::mesh_init::MeshInit;
use super::refined::Refined;
use super::scenes::Scenes;
use crate::mesh_pairs::{MeshPair, MeshPairs};

impl<B: MeshInit> MeshPairs for Refined<B> {
    fn scored_objects(&self, data: &Scenes) -> Vec<String> {
        let pairs = data.pairs();
        pairs.listed(Subset::Test).iter().map(|&object| pairs.name(object).join("/")).collect()
    }

    fn mesh_pair(&self, data: &Scenes, name: &str) -> Result<Option<MeshPair>, DataError> {
        let pairs = data.pairs();
        let named = |&object: &usize| pairs.name(object).join("/") == name;
        let Some(at) = pairs.listed(Subset::Test).iter().position(named) else { return Ok(None) };
        let (object, scene) = data.trial(Subset::Test, 1, at)?;
        let Some(truth) = data.mesh(object)?.mesh.clone() else { return Ok(None) };
        let (mesh, _) = self.mesh_of(&scene);
        let mesh = scene.depth_targets.frame.mesh_in_world(mesh);
        Ok(Some(MeshPair { name: name.to_owned(), mesh: Some(mesh), truth }))
    }
}
