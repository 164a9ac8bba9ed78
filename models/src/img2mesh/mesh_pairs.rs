//! Predictions beside the truth.

use autodiff_lite::Tape;
use train::{DataError, Subset};

use super::Img2Mesh;
use super::data::Data;
use crate::mesh_pairs::{MeshPair, MeshPairs};

impl MeshPairs for Img2Mesh {
    fn scored_objects(&self, data: &Data) -> Vec<String> {
        data.tested()
    }

    fn mesh_pair(&self, data: &Data, name: &str) -> Result<Option<MeshPair>, DataError> {
        let named = |known: &String| known == name;
        let Some(at) = data.tested().iter().position(named) else { return Ok(None) };
        let trial = data.trial(&self.config, (Subset::Test, self.config.views), at)?;
        let Some(truth) = trial.truth else { return Ok(None) };
        let tape = Tape::eval();
        let mesh = self.mesh(self.meshes(&tape, &trial.given));
        Ok(Some(MeshPair { name: name.to_owned(), mesh: Some(mesh), truth }))
    }
}
