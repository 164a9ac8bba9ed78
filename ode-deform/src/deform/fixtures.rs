//! What tests deform: five vertices on a path, seen by two cameras.

use autodiff_lite::{SparseMatrix, Var};
use ndarray::{Array3, Array4};

pub(super) fn path(v: usize) -> SparseMatrix<f64> {
    let ends = (1..v).flat_map(|i| [(i - 1, i, 0.4), (i, i - 1, 0.4)]);
    let entries: Vec<_> = ends.chain((0..v).map(|i| (i, i, -0.3))).collect();
    SparseMatrix::from_triplets(v, v, &entries).expect("in range")
}

pub(super) fn mesh() -> Array3<f64> {
    Array3::from_shape_fn((2, 5, 3), |(n, i, k)| ((n * 15 + i * 3 + k) as f64 * 0.7).sin() * 0.4)
}

pub(super) fn state(augment_dim: usize) -> Array3<f64> {
    Array3::from_shape_fn((2, 5, 3 + augment_dim), |(n, i, k)| {
        if k < 3 { mesh()[[n, i, k]] } else { ((n + i + k) as f64).cos() }
    })
}

pub(super) fn cameras() -> Array3<f64> {
    let rows = [[1.9, 0.1, 0.0, 0.02], [0.0, 2.1, 0.1, -0.01], [0.1, 0.0, -1.0, 2.5]];
    Array3::from_shape_fn((2, 3, 4), |(_, i, j)| rows[i][j])
}

pub(super) fn map(side: usize, channels: usize) -> Array4<f64> {
    Array4::from_shape_fn((2, side, side, channels), |(n, i, j, c)| {
        ((n * 31 + i * 7 + j * 3 + c) as f64 * 0.37).cos()
    })
}

/// Says that a closure works for tapes of any life.
pub(super) fn function<C>(c: C) -> C
where
    C: for<'t> Fn(&[Var<'t, f64>]) -> Var<'t, f64>,
{
    c
}
