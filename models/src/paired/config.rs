//! Which images and surfaces.

use synth::families_named;
use train::settings::LARGEST;

train::options! {
    /// Options of the data, in one table with those of the system that learns from it.
    pub struct PairsConfig {
        /// Side of the images, pixels; others are resized.
        pub image_size: usize = 64, in 32..=1024;
        /// What lengths are multiplied by. 0.57 is published for ShapeNet's objects.
        pub scale: f64 = 0.57, in 1e-6..=1e6;
        /// Points of the true surface that a mesh is compared with at a step.
        pub points: usize = 1500, in 16..=100_000;
        /// Every how many objects one is held out where the data has no split of its own; without, scores are then of
        /// what was trained on.
        #[serde(with = "train::settings::optional")]
        pub hold_out: Option<usize> = Some(5), in 2..=LARGEST as usize;
        /// Views of each held-out object that are scored.
        pub scored_views: usize = 2, in 1..=1000;
        /// Views that are made of each object when no data is given.
        pub synthetic_views: usize = 24, in 1..=1000;
        /// Seed of the data that is made when none is given; that of the run decides all else.
        pub data_seed: u64 = 0, in ..=LARGEST;
        /// Procedural objects of each family to train on when no data is given.
        pub objects: usize = 100, in 1..=100_000;
        /// More of each family that are held out.
        pub test_objects: usize = 20, in 0..=100_000;
        /// The number of the first of these in its family, so that runs on more and on fewer objects are scored on
        /// the same; at least `objects`, which is taken where this is less.
        pub test_from: usize = 0, in 0..=100_000;
        /// The families; empty takes all.
        pub families: Vec<String> = vec!["airplane".to_owned()];
    }
}

impl PairsConfig {
    /// What is wrong beside ranges, one sentence each.
    pub(crate) fn conflicts(&self) -> Vec<String> {
        let unknown = families_named(&self.families).err();
        unknown.map(|error| format!("`families`: {error}")).into_iter().collect()
    }
}
