//! The strict 3D IoU: solid voxels of both meshes on one grid, nothing aligned.

use mesh_core::bounds::longest_side;
use mesh_core::{TriMesh, voxelize_solid};

use super::bounds::bounds;

/// Intersection over union of two solids on one grid over their common bounding box.
///
/// The cells are cubes, `resolution` of them along the longest edge of the box and one more on each side.
/// Neither mesh is moved against the other. Inside is what [`voxelize_solid`] says it is, so the meshes
/// should be closed. 1 when both are empty.
///
/// Vertex indices must be valid and coordinates finite.
///
/// # Cost
/// `O(resolution³)` bits and two voxelisations.
/// # Panics
/// If `resolution` is zero, or the grid has more than 2³² cells.
///
/// ```
/// use mesh_core::primitives::cuboid;
/// let cube = cuboid([1.0, 1.0, 1.0]);
/// let mut moved = cube.clone();
/// moved.positions.iter_mut().for_each(|p| p[0] += 0.5);
/// let iou = losses::metrics::voxel_iou(&cube, &moved, 48);
/// assert!((iou - 1.0 / 3.0).abs() < 1e-3);
/// ```
pub fn voxel_iou(prediction: &TriMesh, truth: &TriMesh, resolution: usize) -> f64 {
    assert!(resolution > 0, "voxel_iou: the resolution is zero");
    let (low, high) = match (bounds(prediction), bounds(truth)) {
        (None, None) => return 1.0,
        (None, Some(_)) | (Some(_), None) => return 0.0,
        (Some((a, b)), Some((c, d))) => {
            let low: [f64; 3] = std::array::from_fn(|k| a[k].min(c[k]));
            let high: [f64; 3] = std::array::from_fn(|k| b[k].max(d[k]));
            (low, high)
        }
    };
    let longest = longest_side((low, high));
    if longest <= 0.0 {
        return 1.0;
    }
    // In units of cells, so that neither tiny nor far-away meshes lose the grid to rounding.
    let cell = longest / resolution as f64;
    let dims = std::array::from_fn(|k| ((high[k] - low[k]) / cell).ceil().max(1.0) as usize + 2);
    let place =
        |p: &[f32; 3]| std::array::from_fn(|k| ((f64::from(p[k]) - low[k]) / cell + 1.0) as f32);
    let solid = |mesh: &TriMesh| {
        let placed = TriMesh::new(mesh.positions.iter().map(place).collect(), mesh.faces.clone());
        voxelize_solid(&placed, dims, ([0.0; 3], dims.map(|d| d as f32)))
    };
    solid(prediction).iou(&solid(truth))
}

#[cfg(test)]
mod tests {
    use mesh_core::primitives::{cuboid, icosphere};

    use super::*;

    fn scaled(mesh: &TriMesh, s: f32, by: f32) -> TriMesh {
        let place = |p: &[f32; 3]| p.map(|v| s * v + by);
        TriMesh::new(mesh.positions.iter().map(place).collect(), mesh.faces.clone())
    }

    #[test]
    fn concentric_balls_differ_by_their_volumes() {
        let ball = icosphere(4);
        let iou = voxel_iou(&scaled(&ball, 0.8, 0.0), &ball, 64);
        assert!((iou - 0.512).abs() < 0.01, "{iou}");
    }

    #[test]
    fn a_mesh_fills_itself() {
        for (scale, by) in [(1.0, 0.0), (1e-6, 1e-3), (1e4, -1e6)] {
            let mesh = scaled(&cuboid([1.0, 0.5, 0.2]), scale, by);
            assert_eq!(voxel_iou(&mesh, &mesh, 32), 1.0);
        }
    }

    #[test]
    fn apart_is_zero_and_nothing_is_nothing() {
        let ball = icosphere(1);
        assert_eq!(voxel_iou(&ball, &scaled(&ball, 1.0, 5.0), 40), 0.0);
        assert_eq!(voxel_iou(&TriMesh::default(), &ball, 8), 0.0);
        assert_eq!(voxel_iou(&TriMesh::default(), &TriMesh::default(), 8), 1.0);
    }
}
