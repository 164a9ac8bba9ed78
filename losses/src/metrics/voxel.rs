//! The strict 3D IoU: solid voxels of both meshes on one grid, nothing aligned.

use mesh_core::{TriMesh, voxelize_solid};

use super::bounds::bounds;
use super::overlap;

/// Intersection over union of two solids on one grid over their common bounding box.
///
/// The box is widened by one cell on each side; its cells are cubes, `resolution` of them along the
/// longest edge. Neither mesh is moved. Inside is what [`voxelize_solid`] says it is, so the meshes
/// should be closed. 1 when both are empty.
///
/// Cost: `O(resolution³)` bits and the voxelisation.
///
/// # Panics
/// If `resolution` is zero.
pub fn voxel_iou(prediction: &TriMesh, truth: &TriMesh, resolution: usize) -> f64 {
    assert!(resolution > 0, "voxel_iou: the resolution is zero");
    let (lo, hi) = match (bounds(prediction), bounds(truth)) {
        (None, None) => return 1.0,
        (None, Some(_)) | (Some(_), None) => return 0.0,
        (Some((a, b)), Some((c, d))) => {
            let lo: [f64; 3] = std::array::from_fn(|k| a[k].min(c[k]));
            let hi: [f64; 3] = std::array::from_fn(|k| b[k].max(d[k]));
            (lo, hi)
        }
    };
    let longest = (0..3).map(|k| hi[k] - lo[k]).fold(0.0, f64::max);
    if !longest.is_finite() || longest <= 0.0 {
        return 1.0;
    }
    let cell = longest / resolution as f64;
    let dims: [usize; 3] = std::array::from_fn(|k| ((hi[k] - lo[k]) / cell).ceil().max(1.0) as usize + 2);
    let low: [f32; 3] = std::array::from_fn(|k| (lo[k] - cell) as f32);
    let high: [f32; 3] = std::array::from_fn(|k| (lo[k] + cell * (dims[k] as f64 - 1.0)) as f32);
    let a = voxelize_solid(prediction, dims, (low, high));
    let b = voxelize_solid(truth, dims, (low, high));
    overlap(a.bits.iter().zip(&b.bits).map(|(&a, &b)| (a, b)))
}
