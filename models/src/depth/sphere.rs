//! Pixel2Mesh as Mesh R-CNN's authors have it: an icosphere in front of the camera.

use std::sync::Arc;

use autodiff_lite::{Var, impl_module};
use mesh_core::primitives::icosphere;
use ndarray::Array3;
use nets::Init;
use train::Compiled;
use train::settings::Options as _;

use super::config::{RefineConfig, SphereConfig};
use super::mesh_init::{InitialMeshes, MeshInit};
use super::packed::{Packed, Shape};
use super::refined::Refined;
use super::scenes::{Scene, Scenes};
use crate::instance::Instance;

/// An icosphere where the middle of objects is, or around the camera, subdivided from stage to stage or not.
#[derive(Clone, Debug)]
pub struct Sphere {
    /// The shapes of the stages.
    shapes: Vec<Arc<Shape>>,
    positions: Vec<[f32; 3]>,
    radius: f32,
    subdivide: bool,
    around_camera: bool,
}

// There is nothing to train.
impl_module!(Sphere: f32 {} fixed { shapes, positions, radius, subdivide, around_camera });

impl MeshInit for Sphere {
    const NAME: &'static str = "depth-pixel2mesh";
    const PRESETS: &'static [(&'static str, &'static str)] = &[
        ("tiny", include_str!("presets/depth-pixel2mesh/tiny.toml")),
        ("small", include_str!("presets/depth-pixel2mesh/small.toml")),
        ("paper", include_str!("presets/depth-pixel2mesh/paper.toml")),
        ("paper-table", include_str!("presets/depth-pixel2mesh/paper-table.toml")),
        ("table", include_str!("presets/depth-pixel2mesh/table.toml")),
    ];
    const ABOUT: &'static str = "One image, with or without depth, to a mesh from a sphere";
    const TRAINING: &'static str =
        "`unsphere train depth-pixel2mesh -o runs/mine` trains one on procedural objects";

    type Config = SphereConfig;

    #[inline(never)]
    fn compiled() -> Compiled<Refined<Self>> {
        Compiled::here()
    }

    #[inline(never)]
    fn instance(system: &Refined<Self>) -> &dyn Instance<Scenes, Scene> {
        system
    }

    fn refine(config: &SphereConfig) -> &RefineConfig {
        &config.refine
    }

    fn cells(_: &SphereConfig) -> usize {
        0
    }

    fn voxel_weight(_: &SphereConfig) -> f64 {
        0.0
    }

    fn check(config: &SphereConfig) -> Vec<String> {
        let mut problems = config.out_of_range();
        problems.extend(config.refine.conflicts());
        if config.around_camera && !config.refine.published_places {
            let what =
                "expected false: without `published-places` what is behind the camera has no place";
            problems.push(format!("`around-camera` is true, {what}"));
        }
        // Ranges first: there is a level for each stage.
        if problems.is_empty() && config.levels().last().is_some_and(|&last| last > 6) {
            let what = "at most 6 in the last stage";
            problems.push(format!("`level` is {}, expected {what}", config.level));
        }
        problems
    }

    fn size(config: &SphereConfig) -> (usize, Vec<(String, String)>) {
        let counts: Vec<String> = config
            .levels()
            .iter()
            .map(|&level| (10 * 4_usize.pow(level) + 2).to_string())
            .collect();
        (
            0,
            vec![(
                "icosphere".to_owned(),
                format!("{} vertices, stage by stage", counts.join(", ")),
            )],
        )
    }

    fn new(config: &SphereConfig, _: &Init) -> Self {
        let ball = icosphere(config.level);
        let mut shapes = vec![Arc::new(Shape::of(&ball))];
        for _ in 1..config.refine.stages {
            let last = &shapes[shapes.len() - 1];
            shapes.push(if config.subdivide { Arc::new(last.divided()) } else { Arc::clone(last) });
        }
        let (radius, subdivide) = (config.radius as f32, config.subdivide);
        let around_camera = config.around_camera;
        Self { shapes, positions: ball.positions, radius, subdivide, around_camera }
    }

    fn init<'t>(&self, coarsest: Var<'t>, scenes: &[&Scene]) -> InitialMeshes<'t> {
        let packed = Packed::new(vec![Arc::clone(&self.shapes[0]); scenes.len()]);
        let count = self.positions.len();
        let place = |(_, i, k): (usize, usize, usize)| {
            let there = k == 2 && !self.around_camera;
            let middle = if there { -scenes[i / count].depth_targets.middle } else { 0.0 };
            self.radius * self.positions[i % count][k] + middle
        };
        let positions = Array3::from_shape_fn((1, count * scenes.len(), 3), place);
        InitialMeshes { packed, positions: coarsest.tape().constant(positions), logits: None }
    }

    fn occupied_cells(&self, _: &[f32]) -> Vec<bool> {
        Vec::new()
    }

    fn divided(&self, stage: usize) -> Option<Arc<Shape>> {
        self.shapes.get(stage + 1).filter(|_| self.subdivide).map(Arc::clone)
    }
}
