//! Predictions beside the truth.

use train::{DataError, Subset};

use super::deformer::Deformer;
use super::single_view::SingleView;
use crate::mesh_pairs::{MeshPair, MeshPairs};
use crate::paired::Pairs;

impl<D: Deformer> MeshPairs for SingleView<D> {
    fn scored_objects(&self, data: &Pairs) -> Vec<String> {
        let known =
            |&&object: &&usize| data.surface(object).is_ok_and(|known| known.mesh.is_some());
        // Either all have a mesh or none: they are of one layout.
        let tested = data.listed(Subset::Test);
        if tested.first().as_ref().is_some_and(known) {
            tested.iter().map(|&object| data.name(object).join("/")).collect()
        } else {
            Vec::new()
        }
    }

    fn mesh_pair(&self, data: &Pairs, name: &str) -> Result<Option<MeshPair>, DataError> {
        let named = |&object: &usize| data.name(object).join("/") == name;
        let Some(at) = data.listed(Subset::Test).iter().position(named) else { return Ok(None) };
        let (object, pair) = data.trial(Subset::Test, 1, at)?;
        let Some(truth) = data.surface(object)?.mesh.clone() else { return Ok(None) };
        let mesh = self.mesh_of(&pair.image).ok().map(|(mesh, _)| mesh);
        let mesh = mesh.map(|mesh| pair.image.frame.mesh_in_world(mesh));
        Ok(Some(MeshPair { name: name.to_owned(), mesh, truth }))
    }
}
