//! Mesh R-CNN's voxel branch: cells of what the camera sees, and the mesh around those that are occupied.

use std::sync::Arc;

use autodiff_lite::{Var, impl_module};
use mesh_core::{CameraVolume, EmptyGrid, TriMesh, VoxelGrid, cubify};
use ndarray::Array3;
use nets::{Init, VoxelHead};
use train::Compiled;
use train::settings::Options as _;

use super::carving::{carved, keep_joined};
use super::config::{DepthKind, RefineConfig, VoxelConfig};
use super::mesh_init::{InitialMeshes, MeshInit};
use super::packed::{Packed, Shape};
use super::refined::Refined;
use super::scenes::{Scene, Scenes};
use crate::instance::Instance;
use crate::stacked::stacked;

/// The voxel head, and its probabilities made a mesh.
///
/// Where no cell is occupied, as in the first steps, the mesh is that of the central block
/// ([`EmptyGrid::CentralBlock`]): there is always something to refine, and it gives the backbone a gradient. Which cells
/// are occupied has no gradient; the head learns by its own loss.
#[derive(Clone, Debug)]
pub struct Voxels {
    head: VoxelHead,
    threshold: f32,
    corner_aligned: bool,
    /// By which depth cells are carved, where they are.
    carving: Option<DepthKind>,
    manifold: bool,
}
impl_module!(Voxels: f32 { head } fixed { threshold, corner_aligned, carving, manifold });

/// Where a surface of `cells` along each axis of the cube goes if corner `i` stands where the middles of the first and the
/// last cell are the ends: at `2 i / (cells - 1) - 1`.
fn to_corners(cells: usize, surface: TriMesh) -> TriMesh {
    let factor = cells as f32 / (cells - 1) as f32;
    surface.map_positions(|p| p.map(|x| (x + 1.0) * factor - 1.0))
}

impl MeshInit for Voxels {
    const NAME: &'static str = "mesh-rcnn";
    const PRESETS: &'static [(&'static str, &'static str)] = &[
        ("tiny", include_str!("presets/mesh-rcnn/tiny.toml")),
        ("small", include_str!("presets/mesh-rcnn/small.toml")),
        ("paper", include_str!("presets/mesh-rcnn/paper.toml")),
        ("paper-table", include_str!("presets/mesh-rcnn/paper-table.toml")),
        ("table", include_str!("presets/mesh-rcnn/table.toml")),
    ];
    const ABOUT: &'static str = "One image, with or without depth, to a mesh through voxels";
    const TRAINING: &'static str = "`unsphere train mesh-rcnn -o runs/mine` trains one on procedural objects, in five minutes of one core";
    const REFINE: usize = 50;
    const SYMMETRY: bool = true;

    type Config = VoxelConfig;

    #[inline(never)]
    fn compiled() -> Compiled<Refined<Self>> {
        Compiled::here()
    }

    #[inline(never)]
    fn instance(system: &Refined<Self>) -> &dyn Instance<Scenes, Scene> {
        system
    }

    fn refine(config: &VoxelConfig) -> &RefineConfig {
        &config.refine
    }

    fn cells(config: &VoxelConfig) -> usize {
        config.cells
    }

    fn voxel_weight(config: &VoxelConfig) -> f64 {
        config.voxel_weight
    }

    fn random_steps(config: &VoxelConfig) -> u64 {
        config.voxel_only_steps
    }

    fn check(config: &VoxelConfig) -> Vec<String> {
        let mut problems = config.out_of_range();
        problems.extend(config.refine.conflicts());
        if !config.cells.is_multiple_of(2) {
            problems.push(format!("`cells` is {}, expected an even number", config.cells));
        }
        problems
    }

    fn size(config: &VoxelConfig) -> (usize, Vec<(String, String)>) {
        let (cells, hidden) = (config.cells, config.voxel_hidden);
        let channels = config.refine.resnet().channels()[3];
        let conv = |inputs: usize, area: usize, outputs: usize| outputs * (area * inputs + 1);
        let mut total = 0;
        let mut inputs = channels;
        for _ in 0..config.voxel_convolutions {
            total += conv(inputs, 9, hidden);
            inputs = hidden;
        }
        total += 4 * inputs * hidden + hidden + conv(hidden, 1, cells);
        let half = cells / 2;
        let rows = vec![
            ("(6) (5) bilinear interpolation".to_owned(), format!("{half} x {half} x {channels}")),
            ("(7) (6) voxel branch".to_owned(), format!("{cells} x {cells} x {cells}")),
            ("(8) (7) cubify".to_owned(), "V x 3, F x 3".to_owned()),
        ];
        (total, rows)
    }

    fn new(config: &VoxelConfig, init: &Init) -> Self {
        let channels = config.refine.resnet().channels()[3];
        let (hidden, depth) = (config.voxel_hidden, config.voxel_convolutions);
        let mut head = VoxelHead::new(&init.at("head"), channels, hidden, depth, config.cells);
        let bias = (config.prior / (1.0 - config.prior)).ln() as f32;
        if let Some(param) = &mut head.predictor.bias {
            param.as_slice_mut().fill(bias);
        }
        let corner_aligned = config.corner_aligned;
        let carving = config.carving && !config.refine.blind;
        Self {
            head,
            threshold: config.threshold as f32,
            corner_aligned,
            carving: carving.then_some(config.refine.depth),
            manifold: config.manifold,
        }
    }

    fn voxel_head(&self) -> Option<&VoxelHead> {
        Some(&self.head)
    }

    fn init<'t>(&self, coarsest: Var<'t>, scenes: &[&Scene]) -> InitialMeshes<'t> {
        let tape = coarsest.tape();
        let logits = tape.scope("voxels", || self.head.forward(coarsest));
        let cells = self.head.cells();
        let known: Vec<Vec<f32>> = match self.carving {
            Some(depth) => scenes.iter().map(|scene| carved(scene, cells, depth)).collect(),
            None => Vec::new(),
        };
        let logits = if self.carving.is_some() {
            let shape = [scenes.len(), cells, cells, cells];
            logits + stacked(tape, known.iter().map(|known| &known[..]), &shape)
        } else {
            logits
        };
        let value = logits.value();
        let value = value.as_slice();
        let (mut shapes, mut rows) = (Vec::new(), Vec::new());
        for (n, (scene, logits)) in scenes.iter().zip(value.chunks_exact(cells.pow(3))).enumerate()
        {
            let mut occupied = self.occupied_cells(logits);
            if let Some(known) = known.get(n) {
                keep_joined(&mut occupied, known, cells);
            }
            let occupied: Vec<f32> = occupied.into_iter().map(|o| f32::from(u8::from(o))).collect();
            let grid = VoxelGrid::from_channels([cells; 3], CameraVolume::CUBE, &occupied, 0.5);
            let surface = cubify(&grid, EmptyGrid::CentralBlock);
            let surface = if self.manifold { surface.split_nonmanifold() } else { surface };
            let surface = if self.corner_aligned { to_corners(cells, surface) } else { surface };
            let mesh = scene.depth_targets.volume(&scene.image).to_world(surface);
            shapes.push(Arc::new(Shape::of(&mesh)));
            rows.extend_from_slice(mesh.positions.as_flattened());
        }
        let packed = Packed::new(shapes);
        let positions = Array3::from_shape_vec((1, packed.vertices(), 3), rows);
        let positions = tape.constant(positions.expect("three coordinates a vertex"));
        InitialMeshes { packed, positions, logits: Some(logits) }
    }

    fn occupied_cells(&self, logits: &[f32]) -> Vec<bool> {
        // The logistic function rises: comparing logits is comparing probabilities.
        let least = (self.threshold / (1.0 - self.threshold)).ln();
        logits.iter().map(|&x| x >= least).collect()
    }

    fn divided(&self, _: usize) -> Option<Arc<Shape>> {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// PyTorch3D's corner `i` of four cells: at -1, -1/3, 1/3, 1 and, behind the last, 5/3.
    #[test]
    fn corners_stand_where_middles_are() {
        let line = |x: f32| TriMesh::new(vec![[x, 1.0, -1.0]], Vec::new());
        for (i, x) in [-1.0, -0.5, 0.0, 0.5, 1.0].into_iter().enumerate() {
            let found = to_corners(4, line(x)).positions[0];
            let expected = 2.0 * i as f32 / 3.0 - 1.0;
            assert!((found[0] - expected).abs() < 1e-6, "{i}: {found:?}");
            assert!((found[1] - 5.0 / 3.0).abs() < 1e-6 && found[2] == -1.0);
        }
    }
}
