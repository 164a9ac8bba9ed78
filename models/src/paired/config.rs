//! Which images and surfaces.

use serde::{Deserialize, Serialize};
use synth::families_named;
use train::settings::in_toml;

/// Options of the data, in one table with those of the system that learns from it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case")]
pub struct PairsConfig {
    /// Side of the images, pixels, 32 to 1024; others are resized. Default 64.
    pub image_size: usize,
    /// What lengths are multiplied by. Default 0.57, as published for ShapeNet's objects.
    pub scale: f64,
    /// Points of the true surface that a mesh is compared with at a step, 16 to 100,000. Default 1500.
    pub points: usize,
    /// Every how many objects one is held out where the data has no split of its own, at least 2; 0 is none, and
    /// scores are then of what was trained on. Default 5.
    pub hold_out: usize,
    /// Views of each held-out object that are scored. Default 2.
    pub scored_views: usize,
    /// Views that are made of each object when no data is given. Default 24.
    pub synthetic_views: usize,
    /// Seed of the data that is made when none is given; that of the run decides all else. Default 0.
    pub data_seed: u64,
    /// Procedural objects of each family to train on when no data is given. Default 100.
    pub objects: usize,
    /// More of each family that are held out. Default 20.
    pub test_objects: usize,
    /// The number of the first of these in its family, so that runs on more and on fewer objects are scored on the same;
    /// at least `objects`, which is taken where this is less. Default 0.
    pub test_from: usize,
    /// The families; empty takes all. Default `["airplane"]`.
    pub families: Vec<String>,
}

impl Default for PairsConfig {
    fn default() -> Self {
        Self {
            image_size: 64,
            scale: 0.57,
            points: 1500,
            hold_out: 5,
            scored_views: 2,
            synthetic_views: 24,
            data_seed: 0,
            objects: 100,
            test_objects: 20,
            test_from: 0,
            families: vec!["airplane".to_owned()],
        }
    }
}

impl PairsConfig {
    /// What is wrong, one sentence each.
    pub fn check(&self) -> Vec<String> {
        let mut problems = Vec::new();
        let mut count = |value: usize, low: usize, high: usize, field: &str| {
            if !(low..=high).contains(&value) {
                problems.push(format!("`{field}` is {value}, expected {low} to {high}"));
            }
        };
        count(self.image_size, 32, 1024, "image-size");
        count(self.points, 16, 100_000, "points");
        count(self.scored_views, 1, 1000, "scored-views");
        count(self.synthetic_views, 1, 1000, "synthetic-views");
        count(self.objects, 1, 100_000, "objects");
        count(self.test_objects, 0, 100_000, "test-objects");
        count(self.test_from, 0, 100_000, "test-from");
        if !(self.scale >= 1e-6 && self.scale <= 1e6) {
            problems.push(format!("`scale` is {}, expected 1e-6 to 1e6", self.scale));
        }
        let held = self.hold_out;
        if held == 1 || !in_toml(held) {
            problems.push(format!("`hold-out` is {held}, expected 0 (none) or 2 to 2^63 - 1"));
        }
        if !in_toml(self.data_seed) {
            problems.push(format!("`data-seed` is {}, expected at most 2^63 - 1", self.data_seed));
        }
        problems.extend(
            families_named(&self.families).err().map(|error| format!("`families`: {error}")),
        );
        problems
    }
}
