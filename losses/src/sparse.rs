//! Matrices over the vertices of a mesh, for a tape.

use autodiff_lite::{Real, SparseMatrix};
use mesh_core::{Scalar, SparseRows};

/// A matrix of mesh-core as one that variables are multiplied with, in the tape's precision.
///
/// ```
/// use autodiff_lite::Tape;
/// use losses::sparse_matrix;
/// use mesh_core::{Topology, primitives, uniform_laplacian};
///
/// let ball = primitives::icosphere(2);
/// let laplacian = uniform_laplacian::<f64>(&Topology::of(&ball));
/// let tape = Tape::<f64>::train(0);
/// let x = tape.leaf(ball.vertices());
/// let bent = x.sparse_matmul(&sparse_matrix(&laplacian));
/// assert_eq!(bent.shape(), [162, 3]);
/// ```
///
/// # Panics
/// If the matrix is not square: a column lies beyond its rows.
pub fn sparse_matrix<F: Real, T: Scalar>(matrix: &SparseRows<T>) -> SparseMatrix<F> {
    let (side, rows) = (matrix.rows.len(), &matrix.rows);
    let values = matrix.values.iter().map(|w| F::from_f64(w.widened())).collect();
    let offsets = if rows.offsets.is_empty() { vec![0] } else { rows.offsets.clone() };
    SparseMatrix::from_csr(side, side, offsets, rows.indices.clone(), values)
        .expect("matrices over the vertices are square")
}

#[cfg(test)]
mod tests {
    use autodiff_lite::Tape;
    use mesh_core::{
        Topology, adjacency, combinatorial_laplacian, cotangent_laplacian, primitives,
    };

    use super::*;

    /// The product on a tape is the plain one, and the cotangent Laplacian keeps all its digits.
    #[test]
    fn products_are_those_of_the_plain_matrix() {
        let torus = primitives::torus(1.0, 0.3, 9, 6);
        let topology = Topology::of(&torus);
        let wide: Vec<[f64; 3]> = torus.positions.iter().map(|p| p.map(f64::from)).collect();
        let tape = Tape::<f64>::eval();
        let x = tape.constant(torus.vertices::<f64>());
        let matrices = [
            cotangent_laplacian(&wide, &torus.faces, &topology),
            combinatorial_laplacian(&topology),
            adjacency(&topology),
        ];
        for matrix in matrices {
            let found = x.sparse_matmul(&sparse_matrix(&matrix)).value();
            for (found, expected) in found.iter().zip(matrix.apply(&wide).as_flattened()) {
                assert!((found - expected).abs() < 1e-13);
            }
        }
        let none: SparseMatrix = sparse_matrix(&SparseRows::<f32>::default());
        assert_eq!((none.rows(), none.entries()), (0, 0));
    }
}
