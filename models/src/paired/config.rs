//! Which images and surfaces, and what of a prediction is scored.

use mesh_core::TriMesh;
use synth::families_named;
use train::settings::LARGEST;

use crate::parts::{counts, finished};

train::options! {
    /// Options of the data, in one table with those of the system that learns from it.
    ///
    /// Configurations of before may have `test-from`, where the numbers of scored objects began: a hash deals these now.
    pub struct PairsConfig retires ["test-from"] {
        /// Side of the images, pixels; others are resized.
        pub image_size: usize = 64, in 32..=1024;
        /// What lengths are multiplied by. 0.57 is published for ShapeNet's objects.
        pub scale: f64 = 0.57, in 1e-6..=1e6;
        /// Points of the true surface that a mesh is compared with at a step.
        pub points: usize = 1500, in 16..=100_000;
        /// One of so many objects is held out where the data has no lists of its own, by a hash of its name: half of these
        /// for validation, half for tests. Without, scores are of what was trained on.
        #[serde(with = "train::settings::optional")]
        pub hold_out: Option<usize> = Some(5), in 2..=LARGEST as usize;
        /// Views of each object that are scored.
        pub scored_views: usize = 2, in 1..=1000;
        /// Views that are made of each object when no data is given.
        pub synthetic_views: usize = 24, in 1..=1000;
        /// Seed of the data that is made when none is given; without, that of the run, so that each seed learns from its
        /// own.
        #[serde(serialize_with = "train::settings::optional::serialize", deserialize_with = "train::settings::optional::or_zero")]
        pub data_seed: Option<u64> = None, in ..=LARGEST;
        /// Procedural objects of each family to train on when no data is given.
        pub objects: usize = 100, in 1..=100_000;
        /// Others of each family for validation, by which checkpoints are chosen; without, half as many as `test-objects`.
        #[serde(with = "train::settings::optional")]
        pub validation_objects: Option<usize> = None, in 1..=100_000;
        /// Others of each family that are scored at the end.
        pub test_objects: usize = 20, in 0..=100_000;
        /// Whether what passes through itself is moved apart in the mesh that the network puts out
        /// (`mesh_core::TriMesh::untangle`), before it is scored or written.
        pub untangle: bool = false;
        /// The families; empty takes all.
        pub families: Vec<String> = vec!["airplane".to_owned()];
    }
}

impl PairsConfig {
    /// Seed of the data that is made; 0 where neither the options nor a run say one.
    pub fn data_seed(&self) -> u64 {
        self.data_seed.unwrap_or(0)
    }

    /// Procedural objects of each family for training, validation and test.
    pub(super) fn counts(&self) -> [usize; 3] {
        counts(self.objects, self.validation_objects, self.test_objects)
    }

    /// The mesh as it is scored and delivered.
    pub(crate) fn finished(&self, mesh: TriMesh) -> TriMesh {
        finished(mesh, self.untangle)
    }

    /// What is wrong beside ranges, one sentence each.
    pub(crate) fn conflicts(&self) -> Vec<String> {
        let unknown = families_named(&self.families).err();
        unknown.map(|error| format!("`families`: {error}")).into_iter().collect()
    }
}
