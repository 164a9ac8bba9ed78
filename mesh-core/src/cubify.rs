//! The surface of the occupied cells of a grid.

use crate::{TriMesh, VoxelGrid};

/// What the surface of a grid without any occupied cell is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum EmptyGrid {
    /// A mesh of nothing.
    #[default]
    Nothing,
    /// The surface of the central block, cells `n/4` to `3n/4` along each axis: what Mesh R-CNN goes on
    /// with, so that its later stages have a mesh to move. Along an axis of one cell it is that cell.
    CentralBlock,
}

/// The surface of the occupied cells: two triangles for each side between an occupied and an empty cell.
///
/// What lies beyond the grid is empty. Faces are counter-clockwise seen from the empty side. Corners of cells
/// that meet are one vertex, so the surface has no border: each edge is shared by two faces, or by four where
/// two occupied cells touch along that edge alone. Vertices are numbered as they are met, cell by cell.
///
/// PyTorch3D puts the corner of cell `i` of `n` at `2 i / (n - 1) - 1` (`align = "topleft"`): a grid over the
/// box from -1 to `1 + 2 / (n - 1)` gives that.
///
/// ```
/// use mesh_core::{EmptyGrid, VoxelGrid, cubify};
/// let mut grid = VoxelGrid::new([3; 3], ([0.0; 3], [3.0; 3]));
/// let middle = grid.index([1, 1, 1]);
/// grid.bits[middle] = true;
/// let cube = cubify(&grid, EmptyGrid::Nothing);
/// assert_eq!((cube.positions.len(), cube.faces.len(), cube.volume()), (8, 12, 1.0));
/// ```
///
/// # Cost
/// Two passes over the grid, one to count and one to fill. A ball in 48³ cells: see `benches/results`.
/// # Panics
/// If the surface has more than 2³² vertices.
/// # References
/// Gkioxari, Malik, Johnson 2019, *Mesh R-CNN*, section 3.2.
pub fn cubify(grid: &VoxelGrid, empty: EmptyGrid) -> TriMesh {
    let block;
    let bits = if empty == EmptyGrid::CentralBlock && !grid.bits.contains(&true) {
        block = central_block(grid.dims);
        &block
    } else {
        &grid.bits
    };
    let mut sides = 0;
    each_pair(grid.dims, |_, _, run| sides += run.differences(bits));
    let mut surface = Surface {
        corners: Corners::new(grid),
        mesh: TriMesh::new(Vec::new(), Vec::with_capacity(2 * sides)),
    };
    // A closed surface of squares has about as many vertices as squares.
    surface.mesh.positions.reserve(sides + 2);
    each_pair(grid.dims, |axis, start, run| {
        run.sides(bits, |along, inside_first| {
            let mut cell = start;
            cell[0] += along;
            surface.add_side(axis, cell, inside_first);
        });
    });
    surface.mesh.positions.shrink_to_fit();
    surface.mesh
}

/// Cells `n/4..3n/4` along each axis, and at least one.
fn central_block(dims: [usize; 3]) -> Vec<bool> {
    let within = |k: usize, i: usize| {
        let first = dims[k] / 4;
        (first..(3 * dims[k] / 4).max(first + 1)).contains(&i)
    };
    let mut bits = Vec::with_capacity(dims.iter().product());
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            bits.extend((0..dims[0]).map(|x| within(0, x) && within(1, y) && within(2, z)));
        }
    }
    bits
}

/// A row of pairs of neighbouring cells; beyond the grid there is no cell.
#[derive(Clone, Copy)]
struct Run {
    /// Where the first cell of the first pair stands, and that of the second; `None` beyond the grid.
    first: Option<usize>,
    second: Option<usize>,
    len: usize,
}

impl Run {
    fn row(at: Option<usize>, bits: &[bool], len: usize) -> &[bool] {
        at.map_or(&[], |at| &bits[at..at + len])
    }

    /// How many pairs are of an occupied and an empty cell.
    fn differences(self, bits: &[bool]) -> usize {
        let (a, b) =
            (Self::row(self.first, bits, self.len), Self::row(self.second, bits, self.len));
        match (a, b) {
            (row, []) | ([], row) => row.iter().map(|&bit| usize::from(bit)).sum(),
            (a, b) => a.iter().zip(b).map(|(a, b)| usize::from(a != b)).sum(),
        }
    }

    /// Calls `side(place along the run, whether the first is the occupied one)` for those pairs.
    fn sides(self, bits: &[bool], mut side: impl FnMut(usize, bool)) {
        let (a, b) =
            (Self::row(self.first, bits, self.len), Self::row(self.second, bits, self.len));
        if a == b {
            return;
        }
        for i in 0..self.len {
            let inside = a.get(i).copied().unwrap_or(false);
            if inside != b.get(i).copied().unwrap_or(false) {
                side(i, inside);
            }
        }
    }
}

/// Calls `f(axis, cell, run)` for all pairs of neighbours along each axis, in runs along x; `cell` is the
/// second cell of the first pair, which may lie one beyond the grid.
fn each_pair([nx, ny, nz]: [usize; 3], mut f: impl FnMut(usize, [usize; 3], Run)) {
    let at = |y: usize, z: usize| (z * ny + y) * nx;
    for z in 0..=nz {
        for y in 0..=ny {
            let inside = |y: usize, z: usize| (y < ny && z < nz).then(|| at(y, z));
            if let Some(row) = inside(y, z) {
                f(0, [0, y, z], Run { first: None, second: Some(row), len: 1 });
                f(0, [1, y, z], Run { first: Some(row), second: Some(row + 1), len: nx - 1 });
                f(0, [nx, y, z], Run { first: Some(row + nx - 1), second: None, len: 1 });
            }
            if z < nz {
                let first = y.checked_sub(1).map(|y| at(y, z));
                f(1, [0, y, z], Run { first, second: inside(y, z), len: nx });
            }
            if y < ny {
                let first = z.checked_sub(1).map(|z| at(y, z));
                f(2, [0, y, z], Run { first, second: inside(y, z), len: nx });
            }
        }
    }
}

/// The numbers of the corners of cells that are vertices.
struct Corners<'a> {
    grid: &'a VoxelGrid,
    numbers: Vec<u32>,
}

impl<'a> Corners<'a> {
    const NONE: u32 = u32::MAX;

    fn new(grid: &'a VoxelGrid) -> Self {
        let count = grid.dims.iter().map(|d| d + 1).product();
        Self { grid, numbers: vec![Self::NONE; count] }
    }

    /// The number of the vertex at a corner; a new one goes to the end of `positions`.
    fn vertex(&mut self, corner: [usize; 3], positions: &mut Vec<[f32; 3]>) -> u32 {
        let [nx, ny, _] = self.grid.dims;
        let number = &mut self.numbers[(corner[2] * (ny + 1) + corner[1]) * (nx + 1) + corner[0]];
        if *number == Self::NONE {
            *number = u32::try_from(positions.len()).expect("less than 2^32 vertices");
            let place = |k: usize| self.grid.origin[k] + self.grid.cell[k] * corner[k] as f32;
            positions.push(std::array::from_fn(place));
        }
        *number
    }
}

struct Surface<'a> {
    corners: Corners<'a>,
    mesh: TriMesh,
}

impl Surface<'_> {
    /// Adds the side that `cell` shares with the one before it along `axis`.
    fn add_side(&mut self, axis: usize, cell: [usize; 3], faces_up: bool) {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut corner = |du: usize, dv: usize| {
            let mut corner = cell;
            corner[u] += du;
            corner[v] += dv;
            self.corners.vertex(corner, &mut self.mesh.positions)
        };
        // Counter-clockwise seen from larger coordinates along the axis.
        let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
        self.mesh.faces.extend(if faces_up {
            [[a, b, c], [a, c, d]]
        } else {
            [[a, c, b], [a, d, c]]
        });
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};

    use proptest::prelude::*;

    use super::*;
    use crate::{Topology, primitives, voxelize_solid};

    fn random_grid() -> impl Strategy<Value = VoxelGrid> {
        (1usize..6, 1usize..6, 1usize..6, 0.0f64..1.0).prop_flat_map(|(x, y, z, share)| {
            proptest::collection::vec(proptest::bool::weighted(share), x * y * z).prop_map(
                move |bits| {
                    let high = [x as f32, y as f32, z as f32];
                    VoxelGrid { bits, ..VoxelGrid::new([x, y, z], ([0.0; 3], high)) }
                },
            )
        })
    }

    fn occupied(grid: &VoxelGrid, cell: [i64; 3]) -> bool {
        let inside = (0..3).all(|k| (0..grid.dims[k] as i64).contains(&cell[k]));
        inside && grid.get(cell.map(|c| c as usize))
    }

    /// The definition, cell by cell: twice the middle of each exposed side, and twice its normal.
    fn exposed(grid: &VoxelGrid) -> BTreeSet<([i64; 3], [i64; 3])> {
        let mut sides = BTreeSet::new();
        for z in 0..grid.dims[2] as i64 {
            for y in 0..grid.dims[1] as i64 {
                for x in 0..grid.dims[0] as i64 {
                    for (axis, step) in (0..3).flat_map(|axis| [(axis, 1), (axis, -1)]) {
                        let cell = [x, y, z];
                        let mut next = cell;
                        next[axis] += step;
                        if occupied(grid, cell) && !occupied(grid, next) {
                            let middle = std::array::from_fn(|k| cell[k] + next[k] + 1);
                            let mut normal = [0; 3];
                            normal[axis] = step;
                            sides.insert((middle, normal));
                        }
                    }
                }
            }
        }
        sides
    }

    /// Corners and edges of the exposed sides, in coordinates doubled.
    fn complex(sides: &BTreeSet<([i64; 3], [i64; 3])>) -> [usize; 3] {
        let (mut squares, mut edges, mut corners) =
            (BTreeSet::new(), BTreeSet::new(), BTreeSet::new());
        for (middle, normal) in sides {
            squares.insert(*middle);
            let flat: Vec<usize> = (0..3).filter(|&k| normal[k] == 0).collect();
            for (du, dv) in (-1..=1).flat_map(|du| (-1..=1).map(move |dv| (du, dv))) {
                let mut at = *middle;
                at[flat[0]] += du;
                at[flat[1]] += dv;
                match du * du + dv * dv {
                    1 => drop(edges.insert(at)),
                    2 => drop(corners.insert(at)),
                    _ => {}
                }
            }
        }
        [corners.len(), edges.len(), squares.len()]
    }

    proptest! {
        #[test]
        fn equals_the_definition(grid in random_grid()) {
            let mesh = cubify(&grid, EmptyGrid::Nothing);
            prop_assert!(mesh.validate().is_ok());
            let sides = exposed(&grid);
            // Two triangles make a square: their shared corners are its diagonal, whose middle is its own.
            let mut found = BTreeSet::new();
            for pair in mesh.faces.chunks(2) {
                let [a, b, c] = pair[0].map(|v| mesh.positions[v as usize].map(|x| x as i64));
                let shared: Vec<_> = pair[0].iter().filter(|v| pair[1].contains(v)).collect();
                prop_assert_eq!(shared.len(), 2);
                let [p, q] = [shared[0], shared[1]].map(|&v| mesh.positions[v as usize].map(|x| x as i64));
                let normal = |[a, b, c]: [[i64; 3]; 3]| {
                    let [u, v]: [[i64; 3]; 2] = [b, c].map(|p| std::array::from_fn(|k| p[k] - a[k]));
                    std::array::from_fn(|k| {
                        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
                        u[i] * v[j] - u[j] * v[i]
                    })
                };
                let of = normal([a, b, c]);
                let other = pair[1].map(|v| mesh.positions[v as usize].map(|x| x as i64));
                prop_assert_eq!(of, normal(other));
                prop_assert!(found.insert((std::array::from_fn(|k| p[k] + q[k]), of)));
            }
            prop_assert_eq!(&found, &sides);
            // Merged: no two vertices in one place, none unused.
            let places: BTreeSet<_> = mesh.positions.iter().map(|p| p.map(|x| x as i64)).collect();
            prop_assert_eq!(places.len(), mesh.positions.len());
            let used: BTreeSet<_> = mesh.faces.iter().flatten().collect();
            prop_assert_eq!(used.len(), mesh.positions.len());
            // Volume of an oriented closed surface.
            prop_assert!((mesh.volume() - grid.volume()).abs() < 1e-6);
            // Euler's number, from the squares themselves.
            let topology = Topology::new(mesh.positions.len(), &mesh.faces);
            let [corners, edges, squares] = complex(&sides);
            prop_assert_eq!(mesh.positions.len(), corners);
            prop_assert_eq!(topology.edges.len(), edges + squares);
            prop_assert_eq!(mesh.faces.len(), 2 * squares);
        }

        #[test]
        fn every_edge_is_passed_both_ways_equally_often(grid in random_grid()) {
            let mesh = cubify(&grid, EmptyGrid::CentralBlock);
            prop_assert!(!mesh.faces.is_empty());
            let mut passes = BTreeMap::<[u32; 2], [u32; 2]>::new();
            for face in &mesh.faces {
                for k in 0..3 {
                    let (a, b) = (face[k], face[(k + 1) % 3]);
                    passes.entry([a.min(b), a.max(b)]).or_default()[usize::from(a > b)] += 1;
                }
            }
            prop_assert!(passes.values().all(|[up, down]| up == down && (1..=2).contains(up)));
        }
    }

    #[test]
    fn a_ball_and_a_ring_keep_their_holes() {
        let bounds = ([-1.5; 3], [1.5; 3]);
        for (mesh, holes) in
            [(primitives::icosphere(3), 0), (primitives::torus(1.0, 0.4, 40, 20), 1)]
        {
            let grid = voxelize_solid(&mesh, [24; 3], bounds);
            let surface = cubify(&grid, EmptyGrid::Nothing);
            let topology = Topology::new(surface.positions.len(), &surface.faces);
            let euler = surface.positions.len() as i64 - topology.edges.len() as i64
                + surface.faces.len() as i64;
            assert_eq!(euler, 2 - 2 * holes);
            assert!(topology.is_closed());
            let back = voxelize_solid(&surface, [24; 3], bounds);
            assert_eq!(back, grid);
        }
    }

    #[test]
    fn nothing_or_the_central_block() {
        let grid = VoxelGrid::new([8, 4, 1], ([0.0; 3], [8.0, 4.0, 1.0]));
        assert_eq!(cubify(&grid, EmptyGrid::Nothing), TriMesh::default());
        let block = cubify(&grid, EmptyGrid::CentralBlock);
        assert_eq!(block.bounds(), Some(([2.0, 1.0, 0.0], [6.0, 3.0, 1.0])));
        assert_eq!(block.volume(), 8.0);
        let mut one = grid;
        one.bits[0] = true;
        assert_eq!(cubify(&one, EmptyGrid::CentralBlock).volume(), 1.0);
    }
}
