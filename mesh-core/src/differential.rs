//! Discrete differential operators on triangle meshes, as sparse rows.

use crate::vector::{area_vector, cross, dot, norm, sub, triangle};
use crate::{Csr, Scalar, Topology};

/// A square sparse matrix over the vertices: rows of columns, and a value beside each.
///
/// Values are `f32` or `f64`, as where it is used asks for. On a tape, `losses::sparse_matrix` makes a matrix of it
/// that variables are multiplied with; other libraries take its three lists.
///
/// ```
/// use mesh_core::{Topology, primitives, uniform_laplacian};
/// let ball = primitives::icosphere(1);
/// let topology = Topology::new(ball.positions.len(), &ball.faces);
/// let (rows, columns, values) = uniform_laplacian::<f64>(&topology).into_csr();
/// assert_eq!((rows.len(), columns.len()), (42 + 1, values.len()));
/// assert!(values[..6].iter().sum::<f64>().abs() < 1e-12); // the first row: a vertex of five neighbours
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SparseRows<T: Scalar = f32> {
    /// The columns of each row, ascending.
    pub rows: Csr,
    /// The values, in the order of `rows.indices`.
    pub values: Vec<T>,
}

impl<T: Scalar> SparseRows<T> {
    /// The product with a column per component of `x`, `[V, K]`.
    ///
    /// # Panics
    /// If `x` has not one row per vertex.
    pub fn apply<const K: usize>(&self, x: &[[T; K]]) -> Vec<[T; K]> {
        assert_eq!(x.len(), self.rows.len(), "SparseRows::apply: one row per vertex");
        (0..self.rows.len())
            .map(|row| {
                let mut sum = [T::default(); K];
                for slot in self.rows.range(row) {
                    let (x, w) = (x[self.rows.indices[slot] as usize], self.values[slot]);
                    for k in 0..K {
                        sum[k] = sum[k] + w * x[k];
                    }
                }
                sum
            })
            .collect()
    }

    /// The value at `(row, column)`, zero where there is no entry.
    pub fn at(&self, row: usize, column: u32) -> T {
        let found = self.rows.row(row).binary_search(&column);
        found.map(|k| self.values[self.rows.range(row).start + k]).unwrap_or_default()
    }

    /// The lists of compressed sparse rows, as other libraries name them: where each row begins and the last ends,
    /// the column of each entry, and its value.
    pub fn into_csr(self) -> (Vec<u32>, Vec<u32>, Vec<T>) {
        (self.rows.offsets, self.rows.indices, self.values)
    }
}

/// The uniform Laplacian `D⁻¹ A - I`: from each vertex to the mean of its neighbours.
///
/// What "Laplacian smoothing" means in Pixel2Mesh and PyTorch3D (`method="uniform"`). The row of an
/// isolated vertex is empty, so it feels nothing.
pub fn uniform_laplacian<T: Scalar>(topology: &Topology) -> SparseRows<T> {
    // The quotient in the precision of the values: rounded once.
    let share = |degree: usize| T::narrowed(1.0 / degree as f64);
    with_diagonal(topology, |_, degree| share(degree), |_| T::narrowed(-1.0))
}

/// The adjacency matrix `A`: 1 between vertices that an edge joins.
pub fn adjacency<T: Scalar>(topology: &Topology) -> SparseRows<T> {
    let rows = topology.vertex_vertices.clone();
    let values = vec![T::narrowed(1.0); rows.indices.len()];
    SparseRows { rows, values }
}

/// The combinatorial Laplacian `D - A`, symmetric and positive semi-definite.
///
/// # References
/// Nicolet et al. 2021, *Large Steps in Inverse Rendering of Geometry*, section 3.1; its solver is
/// [`DiffusionSolver`](crate::DiffusionSolver).
pub fn combinatorial_laplacian<T: Scalar>(topology: &Topology) -> SparseRows<T> {
    with_diagonal(topology, |_, _| T::narrowed(-1.0), |degree| T::narrowed(degree as f64))
}

/// The cotangent weight of every edge, `[E]`: `w = (cot α + cot β) / 2`.
///
/// α and β are the angles opposite to the edge, one in each face on it. They come from the Dirichlet
/// energy of a function that is linear on each face: on a face with corners `i, j, k` the gradient
/// of the hat function of `i` is the opposite side turned by 90° over twice the area, so that
///
/// ```text
/// ∫ ∇φi · ∇φj  =  area · (e_i · e_j) / (2 area)²  =  -|e_i| |e_j| cos γ / (4 area)  =  -cot γ / 2,
/// ```
///
/// where γ is the angle at `k`, between the sides `e_i` and `e_j`, and `2 area = |e_i| |e_j| sin γ`.
/// Summing over the faces on the edge gives `-w`. A weight is negative where `α + β > 180°`. Faces
/// without area add nothing; a border has one angle only.
///
/// # Panics
/// If `topology` was made of other faces, or a face names a vertex that does not exist.
/// # References
/// Pinkall and Polthier 1993, *Computing Discrete Minimal Surfaces and Their Conjugates*.
pub fn cotangent_weights<T: Scalar>(
    positions: &[[T; 3]],
    faces: &[[u32; 3]],
    topology: &Topology,
) -> Vec<T> {
    wide_weights(positions, faces, topology).into_iter().map(T::narrowed).collect()
}

fn wide_weights<T: Scalar>(
    positions: &[[T; 3]],
    faces: &[[u32; 3]],
    topology: &Topology,
) -> Vec<f64> {
    assert_eq!(faces.len(), topology.face_count(), "cotangent_weights: another mesh");
    let mut weights = vec![0.0_f64; topology.edges.len()];
    for (&face, &edges) in faces.iter().zip(&topology.face_edges) {
        let corners = triangle(positions, face);
        for k in 0..3 {
            // The edge from corner k to the next is seen from the one after.
            let apex = corners[(k + 2) % 3];
            let (u, v) = (sub(corners[k], apex), sub(corners[(k + 1) % 3], apex));
            let sine = norm(cross(u, v));
            if edges[k] != Topology::NONE && sine > 0.0 {
                weights[edges[k] as usize] += 0.5 * dot(u, v) / sine;
            }
        }
    }
    weights
}

/// The cotangent Laplacian: `(L x)_i = Σ_j w_ij (x_j - x_i)` with [`cotangent_weights`].
///
/// Symmetric, negative semi-definite where no weight is negative. Applied to the positions of a
/// closed surface and divided by the area of each vertex it is the mean curvature normal, `-2 H n`
/// (on average: with the thirds of [`vertex_areas`] single vertices are off by up to 15 %).
///
/// # Panics
/// As [`cotangent_weights`].
pub fn cotangent_laplacian<T: Scalar>(
    positions: &[[T; 3]],
    faces: &[[u32; 3]],
    topology: &Topology,
) -> SparseRows<T> {
    let weights = cotangent_weights(positions, faces, topology);
    let mut sums = vec![0.0_f64; topology.vertex_count()];
    for (&[a, b], &w) in topology.edges.iter().zip(&weights) {
        sums[a as usize] += w.widened();
        sums[b as usize] += w.widened();
    }
    let mut matrix = with_diagonal(topology, |_, _| T::default(), |_| T::default());
    for row in 0..matrix.rows.len() {
        for slot in matrix.rows.range(row) {
            let column = matrix.rows.indices[slot];
            matrix.values[slot] = if column as usize == row {
                T::narrowed(-sums[row])
            } else {
                let edge = topology.edge_between(row as u32, column);
                edge.map(|e| weights[e as usize]).unwrap_or_default()
            };
        }
    }
    matrix
}

/// A third of the area of the faces around each vertex, `[V]`: a share of the surface each.
///
/// # Panics
/// If a face names a vertex that does not exist.
pub fn vertex_areas<T: Scalar>(positions: &[[T; 3]], faces: &[[u32; 3]]) -> Vec<T> {
    let mut areas = vec![0.0_f64; positions.len()];
    for &face in faces {
        let third = norm(area_vector(triangle(positions, face))) / 6.0;
        for v in face {
            areas[v as usize] += third;
        }
    }
    areas.into_iter().map(T::narrowed).collect()
}

/// Rows of neighbours with the vertex itself in its sorted place.
fn with_diagonal<T: Scalar>(
    topology: &Topology,
    off: impl Fn(u32, usize) -> T,
    diagonal: impl Fn(usize) -> T,
) -> SparseRows<T> {
    let mut matrix =
        SparseRows { rows: Csr { offsets: vec![0], indices: Vec::new() }, values: Vec::new() };
    for (vertex, ring) in topology.vertex_vertices.rows().enumerate() {
        let here = vertex as u32;
        let split = ring.partition_point(|&v| v < here);
        if !ring.is_empty() {
            let (below, above) = ring.split_at(split);
            let indices = &mut matrix.rows.indices;
            indices.extend_from_slice(below);
            indices.push(here);
            indices.extend_from_slice(above);
            let values = &mut matrix.values;
            values.extend(below.iter().map(|&v| off(v, ring.len())));
            values.push(diagonal(ring.len()));
            values.extend(above.iter().map(|&v| off(v, ring.len())));
        }
        matrix.rows.offsets.push(matrix.rows.indices.len() as u32);
    }
    matrix
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{TriMesh, primitives, vector::widen};

    fn topology(mesh: &TriMesh) -> Topology {
        Topology::new(mesh.positions.len(), &mesh.faces)
    }

    #[test]
    fn uniform_is_the_way_to_the_mean() {
        let mesh = TriMesh::new(
            vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [7.0, 7.0, 7.0]],
            vec![[0, 1, 2]],
        );
        let moved = uniform_laplacian(&topology(&mesh)).apply(&mesh.positions);
        assert_eq!(moved[0], [0.5, 0.5, 0.0]);
        assert_eq!(moved[1], [-1.0, 0.5, 0.0]);
        assert_eq!(moved[3], [0.0; 3]);
        let combinatorial = combinatorial_laplacian(&topology(&mesh));
        assert_eq!((combinatorial.at(0, 0), combinatorial.at(0, 2)), (2.0, -1.0));
        assert_eq!(combinatorial.at(3, 3), 0.0);
    }

    #[test]
    fn weights_of_right_and_equilateral_triangles() {
        // A unit square cut by its diagonal: both angles opposite to the diagonal are 90°.
        let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        let faces = [[0, 1, 2], [0, 2, 3]];
        let square = Topology::new(4, &faces);
        let weights = cotangent_weights(&positions, &faces, &square);
        for (edge, w) in square.edges.iter().zip(weights) {
            let expected = if *edge == [0, 2] { 0.0 } else { 0.5 };
            approx::assert_abs_diff_eq!(w, expected, epsilon = 1e-6);
        }
        // cot 60° = 1/√3, twice one half of it.
        let ico = primitives::icosphere(0);
        for w in cotangent_weights(&ico.positions, &ico.faces, &topology(&ico)) {
            approx::assert_abs_diff_eq!(w, 1.0 / 3.0_f32.sqrt(), epsilon = 1e-5);
        }
    }

    #[test]
    fn curvature_of_the_unit_sphere_is_one() {
        let mesh = primitives::icosphere(4);
        let areas = vertex_areas(&mesh.positions, &mesh.faces);
        approx::assert_relative_eq!(
            areas.iter().map(|&a| f64::from(a)).sum::<f64>(),
            mesh.area(),
            max_relative = 1e-5
        );
        let bent = cotangent_laplacian(&mesh.positions, &mesh.faces, &topology(&mesh))
            .apply(&mesh.positions);
        let mut energy = 0.0;
        for ((p, l), area) in mesh.positions.iter().zip(&bent).zip(&areas) {
            // -2 H n with H = 1 and n = p; thirds of areas are 15 % off at the 12 corners.
            let along = -dot(widen(*p), widen(*l));
            approx::assert_relative_eq!(along / f64::from(*area), 2.0, max_relative = 0.15);
            energy += along;
        }
        // The Dirichlet energy of the positions is the area: exact on any mesh.
        approx::assert_relative_eq!(energy, 2.0 * mesh.area(), max_relative = 1e-5);
    }

    #[test]
    fn rows_sum_to_nothing_and_sides_are_equal() {
        let mesh = primitives::torus(1.0, 0.4, 13, 9);
        let matrix = cotangent_laplacian(&mesh.positions, &mesh.faces, &topology(&mesh));
        for row in 0..matrix.rows.len() {
            let sum: f32 = matrix.values[matrix.rows.range(row)].iter().sum();
            approx::assert_abs_diff_eq!(sum, 0.0, epsilon = 1e-5);
            for &column in matrix.rows.row(row) {
                assert_eq!(matrix.at(row, column), matrix.at(column as usize, row as u32));
            }
        }
    }
}
