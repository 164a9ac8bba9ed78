//! The surface on which values of a grid have a given level.

use crate::vector::narrow;
use crate::{Bounds, TriMesh};

/// The surface where values at the points of a grid pass `level`, by marching cubes.
///
/// A point is inside where its value is at least `level` (an occupancy, a density); give a signed distance that is
/// negative inside with its sign turned. Vertices lie on the grid's edges, where the value between their ends,
/// interpolated linearly, is `level`. Faces are counter-clockwise seen from outside.
///
/// The mesh has no hole: each edge has two faces, but for those on the border of the grid, where the surface ends; put
/// a layer of low values around it to close it. Where two opposite corners of a cell's side are inside and the others
/// are not, the surface separates the two, seen from either cell. A value that is exactly `level` makes faces without
/// area. Not a number is outside.
///
/// ```
/// use mesh_core::marching_cubes;
///
/// // A ball of radius 0.8 in 24³ points over the box from -1 to 1, x fastest.
/// let place = |i: usize| i as f32 / 11.5 - 1.0;
/// let values: Vec<f32> = (0..24 * 24 * 24)
///     .map(|i| 0.8 - (place(i % 24).powi(2) + place(i / 24 % 24).powi(2) + place(i / 576).powi(2)).sqrt())
///     .collect();
/// let ball = marching_cubes([24; 3], ([-1.0; 3], [1.0; 3]), &values, 0.0);
/// assert!(ball.health().is_watertight());
/// assert!((ball.volume() / (4.0 / 3.0 * std::f64::consts::PI * 0.8_f64.powi(3)) - 1.0).abs() < 0.01);
/// ```
///
/// # Shapes
/// `dims` points along x, y and z; the first stands at `bounds.0`, the last at `bounds.1`; `values` are x fastest and z
/// slowest, an array `[D, H, W]` row-major. PyTorch3D's local coordinates are the box from -1 to 1, its values above
/// the level are inside too.
/// # Cost
/// One pass over the grid; memory for two layers of it beside the mesh.
/// # Panics
/// If there is not one value per point, or there are 2³² vertices.
/// # References
/// Lorensen and Cline 1987, *Marching cubes: a high resolution 3D surface construction algorithm*. The table of cases is
/// computed by following the surface around each cell's sides, so that cells agree where published tables have holes.
pub fn marching_cubes(dims: [usize; 3], bounds: Bounds, values: &[f32], level: f32) -> TriMesh {
    let points = dims.iter().try_fold(1_usize, |n, &d| n.checked_mul(d));
    assert_eq!(Some(values.len()), points, "marching_cubes: values at {dims:?} points");
    let mut mesh = TriMesh::default();
    if dims.contains(&0) || dims.contains(&1) {
        return mesh;
    }
    let grid = Grid { dims, bounds, values, level };
    let table: Vec<Vec<[u8; 3]>> = (0..=u8::MAX).map(triangles).collect();
    let mut layers = Layers::new(dims);
    grid.vertices_of_layer(0, &mut layers.upper, &mut mesh.positions);
    for z in 0..dims[2] - 1 {
        std::mem::swap(&mut layers.lower, &mut layers.upper);
        grid.vertices_of_layer(z + 1, &mut layers.upper, &mut mesh.positions);
        grid.vertices_between(z, &mut layers.between, &mut mesh.positions);
        for y in 0..dims[1] - 1 {
            for x in 0..dims[0] - 1 {
                let case = (0..8).fold(0_u8, |case, corner| {
                    let [dx, dy, dz] = offsets(corner);
                    case | u8::from(grid.is_inside([x + dx, y + dy, z + dz])) << corner
                });
                for triangle in &table[usize::from(case)] {
                    mesh.faces.push(triangle.map(|edge| layers.vertex([x, y], edge)));
                }
            }
        }
    }
    mesh
}

/// Where a corner of a cell lies: bit 0 of its number is along x, bit 1 along y, bit 2 along z.
fn offsets(corner: u8) -> [usize; 3] {
    [0, 1, 2].map(|axis| usize::from(corner >> axis & 1))
}

/// An edge of a cell: `8 axis + the corner at its lower end`.
fn edge_between(a: u8, b: u8) -> u8 {
    8 * (a ^ b).trailing_zeros() as u8 + (a & b)
}

/// The corners around the sides of a cell, counter-clockwise from outside.
fn sides() -> [[u8; 4]; 6] {
    std::array::from_fn(|side| {
        let (axis, upper) = (side as u8 / 2, side as u8 % 2);
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let around = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[p, q]| upper << axis | p << u | q << v);
        if upper == 1 { around } else { [around[3], around[2], around[1], around[0]] }
    })
}

/// Whether two edges lie on one side of a cell.
fn share_a_side(a: u8, b: u8) -> bool {
    let on = |side: &[u8; 4], edge: u8| {
        let (low, axis) = (edge % 8, edge / 8);
        side.contains(&low) && side.contains(&(low | 1 << axis))
    };
    sides().iter().any(|side| on(side, a) && on(side, b))
}

/// The triangles of a case, a bit for each corner that is inside, as edges of the cell.
fn triangles(case: u8) -> Vec<[u8; 3]> {
    let inside = |corner: u8| case >> corner & 1 == 1;
    // On each side, from where a run of inside corners begins to where it ends. An edge is passed into the solid on one
    // of its sides and out of it on the other, so it has one successor.
    let mut next = [None; 24];
    for side in sides() {
        for i in 0..4 {
            if inside(side[i]) || !inside(side[(i + 1) % 4]) {
                continue;
            }
            let mut last = (i + 1) % 4;
            while inside(side[(last + 1) % 4]) {
                last = (last + 1) % 4;
            }
            let from = edge_between(side[i], side[(i + 1) % 4]);
            next[usize::from(from)] = Some(edge_between(side[last], side[(last + 1) % 4]));
        }
    }
    let mut found = Vec::new();
    for start in 0..24 {
        let (mut around, mut edge) = (Vec::new(), start);
        while let Some(following) = next[usize::from(edge)].take() {
            around.push(edge);
            edge = following;
        }
        found.extend(fan(&around));
    }
    found
}

/// A polygon cut into triangles along diagonals within the cell: one on its side might be an edge of the neighbour's
/// surface too, which would then have four faces.
fn fan(around: &[u8]) -> impl Iterator<Item = [u8; 3]> {
    let n = around.len();
    let at = move |i: usize| around[i % n];
    let good = |&apex: &usize| (2..n - 1).all(|j| !share_a_side(at(apex), at(apex + j)));
    let apex = if n == 0 { 0 } else { (0..n).find(good).expect("tested for all cases") };
    (1..n.max(2) - 1).map(move |j| [at(apex), at(apex + j), at(apex + j + 1)])
}

struct Grid<'a> {
    dims: [usize; 3],
    bounds: Bounds,
    values: &'a [f32],
    level: f32,
}

impl Grid<'_> {
    fn value(&self, [x, y, z]: [usize; 3]) -> f32 {
        self.values[(z * self.dims[1] + y) * self.dims[0] + x]
    }

    fn is_inside(&self, point: [usize; 3]) -> bool {
        self.value(point) >= self.level
    }

    /// The vertex between a point and the next along an axis, if the surface passes there.
    fn add(&self, point: [usize; 3], axis: usize, positions: &mut Vec<[f32; 3]>) -> u32 {
        let mut other = point;
        other[axis] += 1;
        if self.is_inside(point) == self.is_inside(other) {
            return u32::MAX;
        }
        let (a, b) = (f64::from(self.value(point)), f64::from(self.value(other)));
        let along = (f64::from(self.level) - a) / (b - a);
        // Beside a value that is not finite there is no place to find.
        let along = if along.is_finite() { along } else { 0.5 };
        let place = |k: usize| {
            let step = point[k] as f64 + if k == axis { along } else { 0.0 };
            let (low, high) = (f64::from(self.bounds.0[k]), f64::from(self.bounds.1[k]));
            low + (high - low) * (step / (self.dims[k] - 1) as f64)
        };
        let index = u32::try_from(positions.len()).ok().filter(|&i| i != u32::MAX);
        positions.push(narrow([0, 1, 2].map(place)));
        index.expect("marching_cubes: fewer than 2³² vertices")
    }

    /// The vertices on the edges along x and y of a layer of points.
    fn vertices_of_layer(&self, z: usize, layer: &mut [Vec<u32>; 2], out: &mut Vec<[f32; 3]>) {
        let [nx, ny, _] = self.dims;
        for y in 0..ny {
            for x in 0..nx {
                let edge = |axis: usize, last: bool, out: &mut Vec<[f32; 3]>| {
                    if last { u32::MAX } else { self.add([x, y, z], axis, out) }
                };
                layer[0][y * nx + x] = edge(0, x + 1 == nx, out);
                layer[1][y * nx + x] = edge(1, y + 1 == ny, out);
            }
        }
    }

    /// The vertices on the edges along z from a layer of points to the next.
    fn vertices_between(&self, z: usize, between: &mut [u32], out: &mut Vec<[f32; 3]>) {
        let [nx, ny, _] = self.dims;
        for y in 0..ny {
            for x in 0..nx {
                between[y * nx + x] = self.add([x, y, z], 2, out);
            }
        }
    }
}

/// The vertices on the edges of one layer of cells, `u32::MAX` where there is none.
struct Layers {
    width: usize,
    /// Along x and y, on the points below and above.
    lower: [Vec<u32>; 2],
    upper: [Vec<u32>; 2],
    between: Vec<u32>,
}

impl Layers {
    fn new([nx, ny, _]: [usize; 3]) -> Self {
        let layer = || vec![u32::MAX; nx * ny];
        let both = || [layer(), layer()];
        Self { width: nx, lower: both(), upper: both(), between: layer() }
    }

    fn vertex(&self, [x, y]: [usize; 2], edge: u8) -> u32 {
        let [dx, dy, dz] = offsets(edge % 8);
        let at = (y + dy) * self.width + x + dx;
        match edge / 8 {
            2 => self.between[at],
            axis => [&self.lower, &self.upper][dz][usize::from(axis)][at],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Topology;
    use proptest::prelude::*;

    proptest! {
        /// Noise has all cases: still every edge has two faces that run along it in opposite directions.
        #[test]
        fn any_values_make_a_closed_surface(
            dims in [2_usize..6, 2_usize..6, 2_usize..6],
            seed in proptest::collection::vec(-1.0_f32..1.0, 125),
        ) {
            let padded = dims.map(|d| d + 2);
            let mut values = vec![-1.0; padded.iter().product()];
            for (i, value) in values.iter_mut().enumerate() {
                let at = [i % padded[0], i / padded[0] % padded[1], i / padded[0] / padded[1]];
                if (0..3).all(|k| at[k] > 0 && at[k] + 1 < padded[k]) {
                    *value = seed[(at[0] + 5 * at[1] + 25 * at[2]) % 125];
                }
            }
            let mesh = marching_cubes(padded, ([0.0; 3], [1.0; 3]), &values, 0.0);
            let topology = Topology::of(&mesh);
            prop_assert!(topology.is_closed());
            let mut edges = std::collections::HashSet::new();
            for &[a, b, c] in &mesh.faces {
                for edge in [[a, b], [b, c], [c, a]] {
                    prop_assert!(edges.insert(edge), "{:?} twice in one direction", edge);
                }
            }
            prop_assert!(mesh.faces.is_empty() || mesh.volume() > 0.0);
            prop_assert!(topology.vertex_faces.rows().all(|faces| !faces.is_empty()));
        }
    }

    #[test]
    fn a_single_point_is_an_octahedron() {
        let mut values = vec![0.0; 27];
        values[13] = 4.0;
        let mesh = marching_cubes([3; 3], ([-1.0; 3], [1.0; 3]), &values, 1.0);
        assert_eq!((mesh.positions.len(), mesh.faces.len()), (6, 8));
        // Three quarters of the way to the neighbours: 4/3 r³.
        assert!((mesh.volume() - 4.0 / 3.0 * 0.75_f64.powi(3)).abs() < 1e-6);
        assert_eq!(Topology::of(&mesh).euler_number(), 2);
    }

    #[test]
    fn a_plane_ends_at_the_border_and_faces_the_empty_side() {
        let values: Vec<f32> = (0..2 * 3 * 4).map(|i| -((i / 6) as f32)).collect();
        let mesh = marching_cubes([2, 3, 4], ([0.0; 3], [1.0, 2.0, 3.0]), &values, -1.5);
        assert!(mesh.positions.iter().all(|p| (p[2] - 1.5).abs() < 1e-6));
        assert!((mesh.area() - 2.0).abs() < 1e-6);
        let normals = crate::face_normals(&mesh.positions, &mesh.faces);
        assert!(normals.iter().all(|n| n[2] > 0.99));
        assert!(!Topology::of(&mesh).is_closed());
    }

    #[test]
    fn nothing_makes_nothing_and_no_number_is_outside() {
        let empty = |dims: [usize; 3], values: &[f32]| {
            marching_cubes(dims, ([0.0; 3], [1.0; 3]), values, 0.0).faces.is_empty()
        };
        assert!(empty([0, 2, 2], &[]) && empty([1, 2, 2], &[1.0; 4]));
        assert!(empty([2; 3], &[1.0; 8]) && empty([2; 3], &[f32::NAN; 8]));
        let mut values = [f32::NAN; 8];
        values[0] = f32::INFINITY;
        let mesh = marching_cubes([2; 3], ([0.0; 3], [1.0; 3]), &values, 0.0);
        assert_eq!(mesh.faces.len(), 1);
        assert!(mesh.positions.iter().flatten().all(|x| x.is_finite()));
    }
}
