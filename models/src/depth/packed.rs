//! Meshes of different topology in one batch: their vertices one after the other.

use std::ops::Range;
use std::sync::{Arc, OnceLock};

use autodiff_lite::{SparseMatrix, Var};
use diff_raster::Faces;
use mesh_core::{Subdivision, Topology, TriMesh};

/// The faces of a mesh and who is next to whom, without positions.
#[derive(Debug)]
pub struct Shape {
    /// Its faces.
    pub faces: Vec<[u32; 3]>,
    /// Its edges.
    pub topology: Topology,
    drawn: OnceLock<Arc<Faces>>,
}

impl Shape {
    /// Of a mesh.
    pub fn of(mesh: &TriMesh) -> Self {
        Self::new(mesh.positions.len(), mesh.faces.clone())
    }

    fn new(vertices: usize, faces: Vec<[u32; 3]>) -> Self {
        let topology = Topology::new(vertices, &faces);
        Self { faces, topology, drawn: OnceLock::new() }
    }

    /// Every face made four: the new vertices, one an edge, follow the old ones.
    #[must_use]
    pub fn divided(&self) -> Self {
        let finer = Subdivision::along(&self.topology, &self.faces);
        Self::new(finer.vertex_count(), finer.faces)
    }

    /// Number of vertices.
    pub fn vertices(&self) -> usize {
        self.topology.vertex_count()
    }

    /// Its faces as the rasteriser takes them.
    pub fn drawn(&self) -> &Arc<Faces> {
        self.drawn.get_or_init(|| Faces::of_valid(self.vertices(), &self.faces))
    }
}

/// The shapes of a batch. Positions and features are `[1, ΣV, D]`, and where every mesh needs its own camera or maps
/// `[N, Vmax, D]`, with the first vertex of all repeated at the ends of the shorter ones.
#[derive(Clone, Debug)]
pub struct Packed {
    /// One a mesh.
    pub shapes: Vec<Arc<Shape>>,
    starts: Vec<usize>,
    longest: usize,
    spread: Vec<u32>,
    gathered: Vec<u32>,
    /// Over all vertices: 1 for each neighbour.
    pub graph: SparseMatrix,
}

impl Packed {
    /// Of meshes in their order.
    ///
    /// # Panics
    /// If there is none, or they have more than 2³² vertices.
    pub fn new(shapes: Vec<Arc<Shape>>) -> Self {
        let mut starts = vec![0];
        for shape in &shapes {
            starts.push(starts[starts.len() - 1] + shape.vertices());
        }
        let longest = shapes.iter().map(|shape| shape.vertices()).max().expect("a mesh");
        let (mut spread, mut gathered) = (Vec::new(), Vec::new());
        for (n, shape) in shapes.iter().enumerate() {
            let own = |v: usize| if v < shape.vertices() { (starts[n] + v) as u32 } else { 0 };
            spread.extend((0..longest).map(own));
            gathered.extend((0..shape.vertices()).map(|v| (n * longest + v) as u32));
        }
        let (mut offsets, mut indices) = (vec![0], Vec::new());
        for (shape, &start) in shapes.iter().zip(&starts) {
            let around = &shape.topology.vertex_vertices;
            for v in 0..shape.vertices() {
                indices.extend(around.row(v).iter().map(|&u| u + start as u32));
                offsets.push(indices.len() as u32);
            }
        }
        let (total, values) = (starts[shapes.len()], vec![1.0; indices.len()]);
        let graph = SparseMatrix::from_csr(total, total, offsets, indices, values)
            .expect("neighbours are vertices");
        Self { shapes, starts, longest, spread, gathered, graph }
    }

    /// Vertices of all meshes.
    pub fn vertices(&self) -> usize {
        self.starts[self.shapes.len()]
    }

    /// Where the vertices of a mesh are.
    pub fn range(&self, mesh: usize) -> Range<usize> {
        self.starts[mesh]..self.starts[mesh + 1]
    }

    /// Rows of one mesh.
    ///
    /// # Shapes
    /// `x [1, ΣV, D]` → `[V, D]`.
    pub fn part<'t>(&self, x: Var<'t>, mesh: usize) -> Var<'t> {
        let columns = x.shape()[2];
        let range = self.range(mesh);
        let count = range.len();
        x.slice_axis(1, range).reshape(&[count, columns])
    }

    /// Meshes apart from one another, the shorter ones filled up.
    ///
    /// # Shapes
    /// `x [1, ΣV, D]` → `[N, Vmax, D]`.
    pub fn spread<'t>(&self, x: Var<'t>) -> Var<'t> {
        let columns = x.shape()[2];
        let rows = x.reshape(&[self.vertices(), columns]).gather_rows(&self.spread);
        rows.reshape(&[self.shapes.len(), self.longest, columns])
    }

    /// Meshes one behind the other: the inverse of [`spread`](Self::spread).
    ///
    /// # Shapes
    /// `x [N, Vmax, D]` → `[1, ΣV, D]`.
    pub fn gathered<'t>(&self, x: Var<'t>) -> Var<'t> {
        let columns = x.shape()[2];
        let rows = x.reshape(&[self.shapes.len() * self.longest, columns]);
        rows.gather_rows(&self.gathered).reshape(&[1, self.vertices(), columns])
    }

    /// The meshes with every face made four, and the matrix that brings `[1, ΣV, D]` there: old vertices, then the means
    /// of the ends of each edge. `finer` are the [divided](Shape::divided) shapes.
    pub fn divided(&self, finer: Vec<Arc<Shape>>) -> (Self, SparseMatrix) {
        let next = Self::new(finer);
        let mut entries = Vec::new();
        for (n, shape) in self.shapes.iter().enumerate() {
            let (from, to) = (self.starts[n], next.starts[n]);
            entries.extend((0..shape.vertices()).map(|v| (to + v, from + v, 1.0)));
            for (i, edge) in shape.topology.edges.iter().enumerate() {
                let row = to + shape.vertices() + i;
                entries.extend(edge.map(|v| (row, from + v as usize, 0.5)));
            }
        }
        let up = SparseMatrix::from_triplets(next.vertices(), self.vertices(), &entries);
        (next, up.expect("edges name vertices"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use autodiff_lite::Tape;
    use mesh_core::primitives::{cuboid, icosphere};
    use ndarray::Array3;

    #[test]
    fn packing_and_spreading_are_inverse_and_division_takes_midpoints() {
        let meshes = [icosphere(0), cuboid([1.0; 3])];
        let shapes: Vec<_> = meshes.iter().map(|mesh| Arc::new(Shape::of(mesh))).collect();
        let packed = Packed::new(shapes.clone());
        assert_eq!((packed.vertices(), packed.range(1)), (20, 12..20));
        let tape = Tape::eval();
        let x = tape.constant(Array3::from_shape_fn((1, 20, 3), |(_, v, k)| (3 * v + k) as f32));
        let spread = packed.spread(x);
        assert_eq!(spread.shape(), [2, 12, 3]);
        assert_eq!(spread.value()[[1, 0, 1]], 37.0);
        assert_eq!(packed.gathered(spread).value(), x.value());
        assert_eq!(packed.part(x, 1).value()[[0, 0]], 36.0);

        let finer: Vec<_> = shapes.iter().map(|shape| Arc::new(shape.divided())).collect();
        let (next, up) = packed.divided(finer);
        let rows: Vec<f32> =
            meshes.iter().flat_map(|m| m.positions.as_flattened()).copied().collect();
        let positions = tape.constant(Array3::from_shape_vec((1, 20, 3), rows).expect("20 points"));
        let fine = positions.sparse_matmul(&up);
        for (n, mesh) in meshes.iter().enumerate() {
            let expected = mesh_core::subdivide(mesh);
            assert_eq!(next.shapes[n].faces, expected.faces);
            let found = next.part(fine, n).value();
            let pairs = found.iter().zip(expected.positions.as_flattened());
            assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-6));
        }
    }

    /// Neighbours stay within their mesh.
    #[test]
    fn the_graph_is_that_of_each_mesh() {
        let shape = Arc::new(Shape::of(&icosphere(0)));
        let packed = Packed::new(vec![Arc::clone(&shape), shape]);
        let tape = Tape::eval();
        let mark = Array3::from_shape_fn((1, 24, 1), |(_, v, _)| if v < 12 { 1.0 } else { 100.0 });
        let sums = tape.constant(mark).sparse_matmul(&packed.graph).value();
        assert!(
            sums.iter().take(12).all(|&x| x == 5.0) && sums.iter().skip(12).all(|&x| x == 500.0)
        );
    }
}
