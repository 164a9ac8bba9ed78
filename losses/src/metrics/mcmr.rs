//! The 3D IoU of the MCMR tables: align bounding boxes, voxelise the surfaces at 32³, fill, compare.

use mesh_core::{TriMesh, VoxelGrid};

use super::bounds::bounds;

/// Cells along each edge of the grid, which covers the unit cube centred at the origin.
pub(super) const GRID: usize = 32;
/// Faces are split until their longest edge is shorter than this many cells.
const STEP: f64 = 0.5;

/// A translation followed by a scaling about the origin, which brings predictions to the truth.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct McmrAlignment {
    /// Added first.
    pub translation: [f64; 3],
    /// Multiplied afterwards.
    pub scale: f64,
}

impl McmrAlignment {
    /// Leaves the prediction as it is.
    pub const IDENTITY: Self = Self { translation: [0.0; 3], scale: 1.0 };

    /// The alignment of one pair: difference of the boxes' centres, cube root of the ratio of their volumes.
    ///
    /// `None` when a box has no volume or a mesh no vertices.
    pub fn of(prediction: &TriMesh, truth: &TriMesh) -> Option<Self> {
        let ((p0, p1), (t0, t1)) = (bounds(prediction)?, bounds(truth)?);
        let translation = std::array::from_fn(|k| 0.5 * ((t0[k] + t1[k]) - (p0[k] + p1[k])));
        let volume = |lo: [f64; 3], hi: [f64; 3]| (0..3).map(|k| hi[k] - lo[k]).product::<f64>();
        let scale = (volume(t0, t1) / volume(p0, p1)).cbrt();
        (scale.is_finite() && scale > 0.0).then_some(Self { translation, scale })
    }

    /// The mean alignment, the one that the published figures use for a whole class; `None` for no pairs.
    pub fn mean(alignments: &[Self]) -> Option<Self> {
        let n = alignments.len() as f64;
        (!alignments.is_empty()).then(|| Self {
            translation: std::array::from_fn(|k| {
                alignments.iter().map(|a| a.translation[k]).sum::<f64>() / n
            }),
            scale: alignments.iter().map(|a| a.scale).sum::<f64>() / n,
        })
    }

    fn apply(self, p: [f32; 3]) -> [f64; 3] {
        std::array::from_fn(|k| (f64::from(p[k]) + self.translation[k]) * self.scale)
    }
}

/// Intersection over union of two meshes as filled 32³ grids over the unit cube centred at the origin.
///
/// The prediction is moved by `alignment` first. Surfaces are rasterised by splitting every face until
/// its longest edge is under half a cell and marking the cells of all corners; parts outside the grid are
/// dropped; then every empty cell that is not 6-connected to the border of the grid is filled. A mesh
/// that is open at this resolution therefore stays a shell. 1 when both grids are empty.
///
/// Vertex indices must be valid.
///
/// # References
/// The evaluation of U-CMR (branch `pascal`, `eval_mean_iou.m`), used by Simoni et al. 2021.
pub fn mcmr_iou(prediction: &TriMesh, truth: &TriMesh, alignment: McmrAlignment) -> f64 {
    solid(prediction, alignment).iou(&solid(truth, McmrAlignment::IDENTITY))
}

fn solid(mesh: &TriMesh, alignment: McmrAlignment) -> VoxelGrid {
    // The evaluation turns its models by (x, y, z) → (-y, x, z) before it voxelises.
    let place = |p: [f32; 3]| {
        let [x, y, z] = alignment.apply(p);
        [-y, x, z].map(|v| GRID as f64 * (v + 0.5))
    };
    let mut cells = VoxelGrid::new([GRID; 3], ([0.0; 3], [GRID as f32; 3]));
    let mut pending = Vec::new();
    for face in &mesh.faces {
        pending.push(face.map(|v| place(mesh.positions[v as usize])));
        while let Some(triangle) = pending.pop() {
            split_or_mark(triangle, &mut cells, &mut pending);
        }
    }
    cells.fill_enclosed();
    cells
}

/// Marks the corners' cells of a small triangle; cuts a larger one across its longest edge.
fn split_or_mark(triangle: [[f64; 3]; 3], cells: &mut VoxelGrid, pending: &mut Vec<[[f64; 3]; 3]>) {
    let [a, b, c] = triangle;
    // What lies outside on one side, or is not a number, can mark nothing.
    let inside = (0..3).all(|k| {
        let (lo, hi) = (a[k].min(b[k]).min(c[k]), a[k].max(b[k]).max(c[k]));
        (a[k] + b[k] + c[k]).is_finite() && hi >= 0.0 && lo < GRID as f64
    });
    if !inside {
        return;
    }
    let square =
        |p: [f64; 3], q: [f64; 3]| (0..3).map(|k| (p[k] - q[k]) * (p[k] - q[k])).sum::<f64>();
    let middle = |p: [f64; 3], q: [f64; 3]| std::array::from_fn(|k| 0.5 * (p[k] + q[k]));
    let (ab, bc, ca) = (square(a, b), square(b, c), square(c, a));
    let longest = ab.max(bc).max(ca);
    if longest < STEP * STEP {
        for corner in triangle {
            if corner.iter().all(|&v| v >= 0.0 && v < GRID as f64) {
                let cell = cells.index(corner.map(|v| v as usize));
                cells.bits[cell] = true;
            }
        }
        return;
    }
    let [p, q, r] = if longest == ab {
        [a, b, c]
    } else if longest == bc {
        [b, c, a]
    } else {
        [c, a, b]
    };
    let m = middle(p, q);
    pending.push([p, m, r]);
    pending.push([m, q, r]);
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    /// A box from `lo` to `hi`, outward.
    fn cuboid(lo: [f32; 3], hi: [f32; 3]) -> TriMesh {
        let positions = (0..8)
            .map(|i| std::array::from_fn(|k| if i >> k & 1 == 1 { hi[k] } else { lo[k] }))
            .collect();
        let quads =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let faces = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
        TriMesh::new(positions, faces)
    }

    #[test]
    fn a_box_becomes_a_filled_box() {
        // From -0.25 to 0.25 is from cell 8 to the border of cell 24: 17 cells along x and z, and along
        // -y too, all inclusive of the cell that the upper face touches.
        let cells = solid(&cuboid([-0.25; 3], [0.25; 3]), McmrAlignment::IDENTITY);
        assert_eq!(cells.count(), 17 * 17 * 17);
    }

    #[test]
    fn alignment_undoes_a_shift_and_a_scaling() {
        let truth = cuboid([-0.3, -0.2, -0.4], [0.3, 0.2, 0.4]);
        let mut prediction = truth.clone();
        for p in &mut prediction.positions {
            *p = [2.0 * p[0] + 5.0, 2.0 * p[1] - 1.0, 2.0 * p[2] + 0.5];
        }
        let alignment = McmrAlignment::of(&prediction, &truth).unwrap();
        assert!((alignment.scale - 0.5).abs() < 1e-6);
        assert!(mcmr_iou(&prediction, &truth, alignment) > 0.9);
        assert_eq!(mcmr_iou(&truth, &truth, McmrAlignment::of(&truth, &truth).unwrap()), 1.0);
        assert_eq!(McmrAlignment::mean(&[alignment, alignment]), Some(alignment));
    }

    #[test]
    fn a_flat_prediction_cannot_be_aligned() {
        let flat = TriMesh::new(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2]]);
        assert_eq!(McmrAlignment::of(&flat, &cuboid([0.0; 3], [1.0; 3])), None);
    }

    #[test]
    fn boxes_side_by_side_overlap_as_their_cells_do() {
        // Each box is 17 cells wide; they share the columns 12..=24 of 8..=28.
        let a = cuboid([-0.25; 3], [0.25; 3]);
        let b = cuboid([-0.125, -0.25, -0.25], [0.375, 0.25, 0.25]);
        let iou = mcmr_iou(&a, &b, McmrAlignment::IDENTITY);
        assert!((iou - 13.0 / 21.0).abs() < 1e-12, "{iou}");
    }

    #[test]
    fn huge_and_infinite_coordinates_are_dropped() {
        let mut mesh = cuboid([-1e30; 3], [1e30; 3]);
        assert_eq!(solid(&mesh, McmrAlignment::IDENTITY).count(), 0);
        mesh.positions[0] = [f32::NAN; 3];
        assert_eq!(solid(&mesh, McmrAlignment::IDENTITY).count(), 0);
    }
}
