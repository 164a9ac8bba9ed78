//! What the two systems differ in: the mesh that refinement begins with.

use std::fmt::Debug;
use std::sync::Arc;

use autodiff_lite::{Module, Tape, Var};
use mesh_core::TriMesh;
use nets::{Init, VoxelHead};
use train::Compiled;
use train::settings::Options;

use super::config::RefineConfig;
use super::packed::{Packed, Shape};
use super::refined::Refined;
use super::scenes::{Scene, Scenes};
use crate::instance::Instance;

/// Where the meshes come from that are refined.
pub trait MeshInit: Module<f32> + Debug + Send + Sync + Sized + 'static {
    /// The name of its system.
    const NAME: &'static str;
    /// Its system's configurations by name.
    const PRESETS: &'static [(&'static str, &'static str)];
    /// How a checkpoint is had.
    const TRAINING: &'static str;
    /// Steps of refinement where a user says nothing of it; see [`Predictor::REFINE`](crate::predict::Predictor::REFINE).
    const REFINE: usize = 0;
    /// Whether both sides of an object are refined by its image; see [`RefineConfig::symmetry`](recon::fit::RefineConfig::symmetry). Meshes that are
    /// most often far from the object are their own mirror image in a plane that is not the object's.
    const SYMMETRY: bool = false;
    /// What its system does, in one sentence.
    const ABOUT: &'static str;

    /// Its system's options.
    type Config: Options + Clone + Debug + PartialEq + Send + Sync;

    /// The options that both have.
    fn refine(config: &Self::Config) -> &RefineConfig;

    /// Cells along each axis of the volume; 0 if there are none.
    fn cells(config: &Self::Config) -> usize;

    /// The weight of the cells' loss.
    fn voxel_weight(config: &Self::Config) -> f64;

    /// What is wrong with options, one sentence each.
    fn check(config: &Self::Config) -> Vec<String>;

    /// Its trained numbers, and the rows of the table of shapes between backbone and mesh.
    fn size(config: &Self::Config) -> (usize, Vec<(String, String)>);

    /// With fresh parameters.
    fn new(config: &Self::Config, init: &Init) -> Self;

    /// The loop of its system; see [`Compile::compiled`](train::Compile::compiled).
    fn compiled() -> Compiled<Refined<Self>>;

    /// What of its system runs the network.
    fn instance(system: &Refined<Self>) -> &dyn Instance<Scenes, Scene>;

    /// The first meshes of scenes, from the backbone's last map.
    ///
    /// # Shapes
    /// `coarsest [N, S/32, S/32, C]`, `S` the side of the images in pixels; N scenes.
    fn init<'t>(&self, coarsest: Var<'t>, scenes: &[&Scene]) -> InitialMeshes<'t>;

    /// Steps at first in which random meshes stand in for these.
    fn random_steps(_: &Self::Config) -> u64 {
        0
    }

    /// What gives the cells' logits, where there are cells.
    fn voxel_head(&self) -> Option<&VoxelHead> {
        None
    }

    /// Which cells one image's logits say are occupied.
    fn occupied_cells(&self, logits: &[f32]) -> Vec<bool>;

    /// The shape that the meshes of a stage are brought to before the next one; none leaves them as they are.
    fn divided(&self, stage: usize) -> Option<Arc<Shape>>;
}

/// Vertices of a tetrahedron for each of `n` scenes, all coordinates normal, around the camera: what Mesh R-CNN refines where
/// it has no mesh.
pub(super) fn tetrahedra(tape: &Tape, n: usize, seed: u64) -> (Packed, Var<'_>) {
    const FACES: [[u32; 3]; 4] = [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]];
    let drawn = Init::new(seed).at("tetrahedra").normal::<f32>(&[1, 4 * n, 3], 0.0, 1.0);
    let positions = drawn.value.clone();
    let shape = Arc::new(Shape::of(&TriMesh::new(vec![[0.0; 3]; 4], FACES.to_vec())));
    (Packed::new(vec![shape; n]), tape.constant(positions))
}

/// The meshes before the first stage.
#[derive(Clone, Debug)]
pub struct InitialMeshes<'t> {
    /// Their shapes.
    pub packed: Packed,
    /// `[1, ΣV, 3]`, each in the frame of its camera.
    pub positions: Var<'t>,
    /// The logits of the cells, `[N, V, V, V]`: row, column, step in depth.
    pub logits: Option<Var<'t>>,
}
