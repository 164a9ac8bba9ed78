//! Predictions beside the truth.

use train::{DataError, Subset};

use super::Mcmr;
use super::data::Data;
use crate::mesh_pairs::{MeshPair, MeshPairs};

impl MeshPairs for Mcmr {
    fn scored_objects(&self, data: &Data) -> Vec<String> {
        data.listed(Subset::Test).iter().map(|&object| data.name(object)).collect()
    }

    /// In the object's own frame, which is where the 3D IoU compares them.
    fn mesh_pair(&self, data: &Data, name: &str) -> Result<Option<MeshPair>, DataError> {
        let named = |&&object: &&usize| data.name(object) == name;
        let Some(&object) = data.listed(Subset::Test).iter().find(named) else { return Ok(None) };
        let Some(truth) = data.truth(object)? else { return Ok(None) };
        let sample = data.photo(object)?.plain(Subset::Test, &self.config);
        let mesh = self.mesh_of_sample(&sample);
        let truth = (*truth).clone();
        Ok(Some(MeshPair { name: name.to_owned(), mesh: Some(mesh), truth }))
    }
}
