//! Occupancy grids, and meshes turned into them.

mod snapped_face;
mod triangle_in_box;

use crate::bounds::Bounds;
use crate::vector::Vec3;
use crate::{TriMesh, iou};
use snapped_face::SnappedFace;
use triangle_in_box::TriangleInBox;

/// Which cells of a regular grid are occupied.
#[derive(Clone, Debug, PartialEq)]
pub struct VoxelGrid {
    /// The number of cells along x, y and z.
    pub dims: [usize; 3],
    /// The corner of the first cell.
    pub origin: [f32; 3],
    /// The sides of a cell.
    pub cell: [f32; 3],
    /// One value per cell, x fastest and z slowest: index `(z · ny + y) · nx + x`.
    pub bits: Vec<bool>,
}

impl VoxelGrid {
    /// An empty grid of `dims` cells over the box `(low, high)`.
    ///
    /// A box without extent along an axis, as a flat mesh has it, grows to both sides there until its
    /// cells are as long as the longest of the other axes.
    ///
    /// # Panics
    /// If a dimension is zero, there are more than 2^32 cells, or the box is not finite or upside
    /// down.
    pub fn new(dims: [usize; 3], (low, high): Bounds) -> Self {
        let cells = dims.iter().try_fold(1_usize, |n, &d| n.checked_mul(d));
        let cells = cells.filter(|&n| n > 0 && n <= 1 << 32);
        let cells = cells.unwrap_or_else(|| panic!("VoxelGrid: {dims:?} cells"));
        let (low64, high64) = (low.map(f64::from), high.map(f64::from));
        assert!(
            (0..3).all(|k| low64[k].is_finite() && high64[k].is_finite() && low64[k] <= high64[k]),
            "VoxelGrid: box {low:?} to {high:?}, expected two finite corners, the lower first"
        );
        // In f64: between the ends of f32 there is more than f32 can hold.
        let side = |k: usize| ((high64[k] - low64[k]) / dims[k] as f64).min(f32::MAX.into()) as f32;
        let cell: [f32; 3] = std::array::from_fn(side);
        let reach = low.iter().chain(&high).fold(0.0, |most: f32, x| most.max(x.abs()));
        // What makes a difference at the place of the box; 1 for a single point at the origin.
        let least = if reach > 0.0 { (reach / 1024.0).max(f32::MIN_POSITIVE) } else { 1.0 };
        let longest = cell.into_iter().fold(0.0, f32::max);
        let grown = if longest > 0.0 { longest } else { least };
        let origin = std::array::from_fn(|k| {
            if cell[k] > 0.0 {
                return low[k];
            }
            let half = f64::from(grown) * dims[k] as f64 / 2.0;
            (low64[k] - half).max(f32::MIN.into()) as f32
        });
        let cell = cell.map(|side| if side > 0.0 { side } else { grown });
        Self { dims, origin, cell, bits: vec![false; cells] }
    }

    /// The cells whose value is at least `threshold`; values are in the order of [`bits`](Self::bits). Not a
    /// number is not occupied.
    ///
    /// # Panics
    /// As [`new`](Self::new), or if there is not one value per cell.
    pub fn from_values(dims: [usize; 3], bounds: Bounds, values: &[f32], threshold: f32) -> Self {
        Self::gathered(dims, bounds, values, |cell| values[cell] >= threshold)
    }

    fn gathered(
        dims: [usize; 3],
        bounds: Bounds,
        values: &[f32],
        occupied: impl Fn(usize) -> bool,
    ) -> Self {
        let mut grid = Self::new(dims, bounds);
        assert_eq!(values.len(), grid.bits.len(), "VoxelGrid: values of {dims:?} cells");
        grid.bits.iter_mut().enumerate().for_each(|(cell, bit)| *bit = occupied(cell));
        grid
    }

    /// [`from_values`](Self::from_values) of values with z fastest, then x, then y, as a network leaves
    /// them that has the steps in depth in its channels: `[H, W, C]`.
    ///
    /// # Panics
    /// As [`from_values`](Self::from_values).
    pub fn from_channels(dims: [usize; 3], bounds: Bounds, values: &[f32], threshold: f32) -> Self {
        let order = channel_order(dims);
        Self::gathered(dims, bounds, values, |cell| values[order[cell]] >= threshold)
    }

    /// 1 where a cell is occupied, in the order of [`from_channels`](Self::from_channels).
    pub fn to_channels(&self) -> Vec<f32> {
        let mut values = vec![0.0; self.bits.len()];
        for (&bit, place) in self.bits.iter().zip(channel_order(self.dims)) {
            values[place] = f32::from(u8::from(bit));
        }
        values
    }

    /// Where cell `(x, y, z)` stands in `bits`.
    pub fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        debug_assert!(x < self.dims[0] && y < self.dims[1] && z < self.dims[2]);
        (z * self.dims[1] + y) * self.dims[0] + x
    }

    /// Whether cell `(x, y, z)` is occupied.
    pub fn get(&self, cell: [usize; 3]) -> bool {
        self.bits[self.index(cell)]
    }

    /// The middle of cell `(x, y, z)`.
    pub fn center(&self, cell: [usize; 3]) -> [f32; 3] {
        std::array::from_fn(|k| self.origin[k] + self.cell[k] * (cell[k] as f32 + 0.5))
    }

    /// The number of occupied cells.
    pub fn count(&self) -> usize {
        self.bits.iter().filter(|&&bit| bit).count()
    }

    /// The volume of the occupied cells.
    pub fn volume(&self) -> f64 {
        self.count() as f64 * self.cell.iter().map(|&side| f64::from(side)).product::<f64>()
    }

    /// Intersection over union with a grid of the same dimensions; 1 where both are empty.
    ///
    /// # Panics
    /// If the dimensions differ.
    pub fn iou(&self, other: &Self) -> f64 {
        assert_eq!(self.dims, other.dims, "VoxelGrid::iou: dimensions");
        iou(self.bits.iter().copied().zip(other.bits.iter().copied())).unwrap_or(1.0)
    }

    /// Occupies every empty cell that is cut off from the border of the grid.
    ///
    /// Cells are neighbours through their sides (6-connected), as in MATLAB's
    /// `imfill(V, "holes")`.
    pub fn fill_enclosed(&mut self) {
        let [nx, ny, nz] = self.dims;
        let mut outside = self.bits.clone();
        let mut open = Vec::new();
        let reach = |outside: &mut Vec<bool>, open: &mut Vec<[usize; 3]>, cell: [usize; 3]| {
            let index = (cell[2] * ny + cell[1]) * nx + cell[0];
            if !std::mem::replace(&mut outside[index], true) {
                open.push(cell);
            }
        };
        // `outside` begins as the walls; what is not reached from the border stays false.
        for z in 0..nz {
            for y in 0..ny {
                let inner_row = z > 0 && z + 1 < nz && y > 0 && y + 1 < ny;
                let step = if inner_row { (nx - 1).max(1) } else { 1 };
                for x in (0..nx).step_by(step) {
                    reach(&mut outside, &mut open, [x, y, z]);
                }
            }
        }
        while let Some(cell) = open.pop() {
            for axis in 0..3 {
                if cell[axis] > 0 {
                    let mut next = cell;
                    next[axis] -= 1;
                    reach(&mut outside, &mut open, next);
                }
                if cell[axis] + 1 < self.dims[axis] {
                    let mut next = cell;
                    next[axis] += 1;
                    reach(&mut outside, &mut open, next);
                }
            }
        }
        for (bit, outside) in self.bits.iter_mut().zip(outside) {
            *bit |= !outside;
        }
    }

    /// A point in units of cells.
    fn local(&self, p: [f32; 3]) -> Vec3 {
        std::array::from_fn(|k| {
            (f64::from(p[k]) - f64::from(self.origin[k])) / f64::from(self.cell[k])
        })
    }

    /// The cells along `axis` that an interval reaches, both ends included.
    fn span(&self, axis: usize, low: f64, high: f64) -> std::ops::Range<usize> {
        let last = self.dims[axis] as f64;
        let (low, high) = (low.floor().clamp(0.0, last), (high.floor() + 1.0).clamp(0.0, last));
        low as usize..high as usize
    }
}

/// For each cell in the order of `bits` its place among values with z fastest, then x, then y.
fn channel_order([nx, ny, nz]: [usize; 3]) -> Vec<usize> {
    let cells = (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])));
    cells.map(|[x, y, z]| (y * nx + x) * nz + z).collect()
}

/// The cells that the surface of a mesh touches, borders of cells included.
///
/// # Cost
/// One separating-axis test for each cell in the box of each face.
/// # Panics
/// As [`VoxelGrid::new`], or if a face names a vertex that does not exist.
pub fn voxelize_surface(mesh: &TriMesh, dims: [usize; 3], bounds: Bounds) -> VoxelGrid {
    let mut grid = VoxelGrid::new(dims, bounds);
    for face in &mesh.faces {
        let corners = face.map(|v| grid.local(mesh.positions[v as usize]));
        if corners.iter().flatten().any(|x| !x.is_finite()) {
            continue;
        }
        let [xs, ys, zs] = std::array::from_fn(|k| {
            let low = corners.iter().map(|p| p[k]).fold(f64::INFINITY, f64::min);
            let high = corners.iter().map(|p| p[k]).fold(f64::NEG_INFINITY, f64::max);
            // A side that lies exactly between two cells touches both.
            let low = if low.fract() == 0.0 { low - 1.0 } else { low };
            grid.span(k, low, high)
        });
        let test = TriangleInBox::new(corners);
        for z in zs {
            for y in ys.clone() {
                for x in xs.clone() {
                    let index = grid.index([x, y, z]);
                    if !grid.bits[index] {
                        let center = [x as f64 + 0.5, y as f64 + 0.5, z as f64 + 0.5];
                        grid.bits[index] = test.touches(center);
                    }
                }
            }
        }
    }
    grid
}

/// The cells whose middle is inside a closed mesh: where the winding number is not zero.
///
/// Right for nested and overlapping pieces that are oriented alike. [`voxelize_parity`] does not
/// look at orientation, [`voxelize_enclosed`] needs no closed mesh.
///
/// # Cost
/// One test for each column of cells under each face, then one pass over the grid.
/// # Panics
/// As [`VoxelGrid::new`], or if a face names a vertex that does not exist.
pub fn voxelize_solid(mesh: &TriMesh, dims: [usize; 3], bounds: Bounds) -> VoxelGrid {
    scan(mesh, dims, bounds, |winding, _| winding != 0)
}

/// The cells whose middle sees the surface an odd number of times in any one direction.
///
/// For closed meshes of unknown orientation; a piece inside another is a hole.
///
/// # Panics
/// As [`voxelize_solid`].
pub fn voxelize_parity(mesh: &TriMesh, dims: [usize; 3], bounds: Bounds) -> VoxelGrid {
    scan(mesh, dims, bounds, |_, crossings| crossings % 2 == 1)
}

/// The surface, and everything that it cuts off from the border of the grid.
///
/// For meshes with holes smaller than a cell, as real models have. About half a cell thicker on all
/// sides than [`voxelize_solid`].
///
/// # Panics
/// As [`voxelize_surface`].
pub fn voxelize_enclosed(mesh: &TriMesh, dims: [usize; 3], bounds: Bounds) -> VoxelGrid {
    let mut grid = voxelize_surface(mesh, dims, bounds);
    grid.fill_enclosed();
    grid
}

/// Walks along x through each row of cell middles and counts the faces that are passed.
///
/// Vertices are snapped to 1/65536 of a cell in y and z. In integers a middle is on exactly one
/// side of every edge, so a row that meets an edge or a vertex passes exactly one face there.
fn scan(
    mesh: &TriMesh,
    dims: [usize; 3],
    bounds: Bounds,
    inside: impl Fn(i32, i32) -> bool,
) -> VoxelGrid {
    let mut grid = VoxelGrid::new(dims, bounds);
    let [nx, ny, _] = dims;
    // What changes on the way from each middle to the one before it: (winding, crossings).
    let mut steps = vec![(0_i32, 0_i32); grid.bits.len()];
    for face in &mesh.faces {
        let corners = face.map(|v| grid.local(mesh.positions[v as usize]));
        let Some(face) = SnappedFace::new(corners) else { continue };
        let [ys, zs] = face.bounds().map(|(axis, low, high)| grid.span(axis, low, high));
        for z in zs {
            for y in ys.clone() {
                if !face.covers(y, z) {
                    continue;
                }
                // The first middle at or beyond the crossing.
                let first = (face.crossing(y, z) - 0.5).ceil().max(0.0);
                if first < nx as f64 {
                    let step = &mut steps[(z * ny + y) * nx + first as usize];
                    // A face whose normal points towards smaller x is where the row enters.
                    step.0 -= face.turn;
                    step.1 += 1;
                }
            }
        }
    }
    for (bits, steps) in grid.bits.chunks_mut(nx).zip(steps.chunks(nx)) {
        let (mut winding, mut crossings) = (0, 0);
        for (bit, step) in bits.iter_mut().zip(steps) {
            winding += step.0;
            crossings += step.1;
            *bit = inside(winding, crossings);
        }
    }
    grid
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::primitives;
    use crate::vector::{norm, widen};

    const BOX: Bounds = ([-1.5; 3], [1.5; 3]);

    #[test]
    fn a_cuboid_on_the_grid_is_exact() {
        // Sides exactly through middles of cells: each counted once, whatever the direction.
        let cube = primitives::cuboid([1.0, 2.0, 1.5]);
        let grid = voxelize_solid(&cube, [12, 12, 12], BOX);
        assert_eq!(grid.volume(), cube.volume());
        assert_eq!(grid, voxelize_parity(&cube, [12, 12, 12], BOX));
        assert_eq!(grid, voxelize_solid(&cube.clone().flipped(), [12, 12, 12], BOX));
        let odd = voxelize_solid(&primitives::cuboid([1.0; 3]), [3, 3, 3], BOX);
        assert_eq!(odd.count(), 1);
        assert!(odd.get([1, 1, 1]));
    }

    #[test]
    fn volumes_approach_the_analytic_ones() {
        let ball = primitives::icosphere(4);
        let grid = voxelize_solid(&ball, [64; 3], BOX);
        approx::assert_relative_eq!(grid.volume(), ball.volume(), max_relative = 0.01);
        for (i, &bit) in grid.bits.iter().enumerate() {
            let center = grid.center([i % 64, i / 64 % 64, i / 4096]);
            let radius = norm(widen(center));
            if (radius - 1.0).abs() > 0.01 {
                assert_eq!(bit, radius < 1.0, "{center:?}");
            }
        }
        let ring = primitives::torus(1.0, 0.4, 64, 32);
        let grid = voxelize_solid(&ring, [50, 40, 60], BOX);
        approx::assert_relative_eq!(grid.volume(), ring.volume(), max_relative = 0.02);
    }

    #[test]
    fn the_surface_encloses_the_solid() {
        let ball = primitives::icosphere(3);
        let solid = voxelize_solid(&ball, [40; 3], BOX);
        let surface = voxelize_surface(&ball, [40; 3], BOX);
        let enclosed = voxelize_enclosed(&ball, [40; 3], BOX);
        assert!(!surface.get([20, 20, 20]) && enclosed.get([20, 20, 20]));
        for i in 0..solid.bits.len() {
            assert!(enclosed.bits[i] || !solid.bits[i]);
            assert_eq!(enclosed.bits[i], surface.bits[i] || solid.bits[i]);
        }
        assert!(surface.iou(&enclosed) < solid.iou(&enclosed));
        // Without one face nothing is enclosed in exact terms, but the hole is below a cell.
        let mut open = primitives::icosphere(4);
        open.faces.pop();
        assert!(voxelize_enclosed(&open, [16; 3], BOX).get([8, 8, 8]));
    }

    #[test]
    fn nested_pieces() {
        let mut shell = primitives::cuboid([2.0; 3]);
        shell.append(&primitives::cuboid([1.0; 3])).unwrap();
        let dims = [6; 3];
        assert_eq!(voxelize_solid(&shell, dims, BOX).volume(), 8.0);
        assert_eq!(voxelize_parity(&shell, dims, BOX).volume(), 7.0);
        let mut hollow = primitives::cuboid([2.0; 3]);
        hollow.append(&primitives::cuboid([1.0; 3]).flipped()).unwrap();
        assert_eq!(voxelize_solid(&hollow, dims, BOX).volume(), 7.0);
    }

    #[test]
    fn values_in_either_order() {
        let (dims, bounds) = ([2, 3, 4], ([0.0; 3], [2.0, 3.0, 4.0]));
        // Each value names its cell: 100 z + 10 y + x.
        let named = |x: usize, y: usize, z: usize| (100 * z + 10 * y + x) as f32;
        let plain: Vec<f32> = (0..24).map(|i| named(i % 2, i / 2 % 3, i / 6)).collect();
        let deep: Vec<f32> = (0..24).map(|i| named(i / 4 % 2, i / 8, i % 4)).collect();
        for threshold in [0.0, 1.0, 111.0, 321.0, 400.0] {
            let grid = VoxelGrid::from_values(dims, bounds, &plain, threshold);
            assert_eq!(grid, VoxelGrid::from_channels(dims, bounds, &deep, threshold));
            let expected: Vec<f32> =
                deep.iter().map(|&v| f32::from(u8::from(v >= threshold))).collect();
            assert_eq!(grid.to_channels(), expected);
        }
        let odd = VoxelGrid::from_values([1; 3], ([0.0; 3], [1.0; 3]), &[f32::NAN], 0.0);
        assert_eq!(odd.count(), 0);
    }

    #[test]
    fn overlap_by_hand() {
        let mut a = VoxelGrid::new([2, 1, 2], ([0.0; 3], [2.0, 1.0, 2.0]));
        let mut b = a.clone();
        assert_eq!(a.iou(&b), 1.0);
        a.bits = vec![true, true, false, false];
        b.bits = vec![false, true, true, true];
        assert_eq!(a.iou(&b), 0.25);
        assert_eq!(a.center([1, 0, 1]), [1.5, 0.5, 1.5]);
    }

    #[test]
    fn meshes_beyond_the_grid_are_cut() {
        let cube = primitives::cuboid([10.0; 3]);
        assert_eq!(voxelize_solid(&cube, [4; 3], BOX).count(), 64);
        assert_eq!(voxelize_surface(&cube, [4; 3], BOX).count(), 0);
        let far = cube.translated([100.0, 0.0, 0.0]);
        assert_eq!(voxelize_solid(&far, [4; 3], BOX).count(), 0);
    }

    /// A side that lies on a row of middles but for its last bits is almost along x: its plane goes on far beyond it.
    #[test]
    fn a_side_along_a_row_of_middles_leaves_no_rods() {
        let place = |u: f32| f32::from_bits(0.5_f32.to_bits() + u as u32);
        for order in
            [[2.0, 0.0, 1.0, 3.0], [0.0, 3.0, 1.0, 2.0], [3.0, 1.0, 0.0, 2.0], [1.0, 2.0, 3.0, 0.0]]
        {
            let mut cube = crate::primitives::cuboid([1.0; 3]);
            let mut ulps = order.into_iter();
            for p in cube.positions.iter_mut().filter(|p| p[1] > 0.0) {
                p[1] = place(ulps.next().unwrap());
            }
            let solid = voxelize_solid(&cube, [250; 3], ([-1.0; 3], [1.0; 3]));
            let rods = solid.bits.iter().enumerate();
            let rods = rods.filter(|(i, bit)| **bit && !(62..=187).contains(&(i % 250))).count();
            assert_eq!(rods, 0, "{order:?}");
        }
    }
}
