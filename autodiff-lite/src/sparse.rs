//! Sparse matrices that operations hold.

use std::sync::Arc;

use crate::Real;
use crate::kernels::sparse::CsrRows;

/// A constant sparse matrix, with its transpose for backward; cheap to clone.
///
/// Graph convolutions, Laplacians and unpooling are products with one; its entries are data, not
/// parameters: no gradient flows into them.
///
/// ```
/// use autodiff_lite::{SparseMatrix, Tape};
///
/// // Row 0 averages two rows, row 1 copies one.
/// let a = SparseMatrix::from_triplets(2, 3, &[(0, 0, 0.5), (0, 2, 0.5), (1, 1, 1.0)])?;
/// let tape = Tape::<f32>::eval();
/// let x = tape.constant(ndarray::arr2(&[[1.0], [2.0], [3.0]]));
/// assert_eq!(x.sparse_matmul(&a).value(), ndarray::arr2(&[[2.0], [2.0]]));
/// # Ok::<(), autodiff_lite::SparseError>(())
/// ```
#[derive(Clone, Debug)]
pub struct SparseMatrix<F: Real = f32> {
    rows: usize,
    columns: usize,
    matrix: Arc<Csr<F>>,
    transpose: Arc<Csr<F>>,
}

#[derive(Debug)]
struct Csr<F> {
    offsets: Vec<u32>,
    indices: Vec<u32>,
    values: Vec<F>,
}

/// Why entries do not make a sparse matrix.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SparseError {
    /// An entry lies outside the matrix.
    #[error("entry {entry} is at ({row}, {column}) of a {rows} x {columns} matrix")]
    OutOfRange {
        /// Which entry, in the order given.
        entry: usize,
        /// Its row.
        row: usize,
        /// Its column.
        column: usize,
        /// Rows of the matrix.
        rows: usize,
        /// Columns of the matrix.
        columns: usize,
    },
    /// The offsets do not begin at 0, rise, and end at the number of entries, or are not one more than the rows.
    #[error("the offsets of the rows do not run from 0 up to the {entries} entries")]
    Offsets {
        /// Number of entries.
        entries: usize,
    },
    /// More entries, rows or columns than 32-bit indices can name.
    #[error("the matrix is too large for 32-bit indices")]
    TooLarge,
}

impl<F: Real> Csr<F> {
    /// Sorts entries by row, stably: entries of a row keep their order.
    fn new(rows: usize, entries: impl Iterator<Item = (u32, u32, F)> + Clone) -> Self {
        let mut offsets = vec![0u32; rows + 1];
        for (row, ..) in entries.clone() {
            offsets[row as usize + 1] += 1;
        }
        for row in 0..rows {
            offsets[row + 1] += offsets[row];
        }
        let count = offsets[rows] as usize;
        let (mut indices, mut values) = (vec![0; count], vec![F::zero(); count]);
        let mut next = offsets.clone();
        for (row, column, value) in entries {
            let at = next[row as usize] as usize;
            (indices[at], values[at]) = (column, value);
            next[row as usize] += 1;
        }
        Self { offsets, indices, values }
    }

    fn view(&self) -> CsrRows<'_, F> {
        CsrRows { offsets: &self.offsets, indices: &self.indices, values: &self.values }
    }

    fn entries(&self) -> impl Iterator<Item = (u32, u32, F)> + Clone + '_ {
        (0..self.offsets.len() - 1).flat_map(move |row| {
            let range = self.offsets[row] as usize..self.offsets[row + 1] as usize;
            range.map(move |at| (row as u32, self.indices[at], self.values[at]))
        })
    }
}

impl<F: Real> SparseMatrix<F> {
    /// From `(row, column, value)`; entries of the same place add up.
    ///
    /// # Errors
    /// If an entry lies outside, or there are too many.
    #[inline(never)]
    pub fn from_triplets(
        rows: usize,
        columns: usize,
        triplets: &[(usize, usize, F)],
    ) -> Result<Self, SparseError> {
        if [rows, columns, triplets.len()].iter().any(|&n| n >= u32::MAX as usize) {
            return Err(SparseError::TooLarge);
        }
        let outside = |&(row, column, _): &(usize, usize, F)| row >= rows || column >= columns;
        if let Some(entry) = triplets.iter().position(outside) {
            let (row, column, _) = triplets[entry];
            return Err(SparseError::OutOfRange { entry, row, column, rows, columns });
        }
        let entries =
            triplets.iter().map(|&(row, column, value)| (row as u32, column as u32, value));
        Ok(Self::with_transpose(rows, columns, Csr::new(rows, entries)))
    }

    /// From compressed rows: row `i` has entries `offsets[i] .. offsets[i + 1]`.
    ///
    /// # Errors
    /// If the offsets do not fit the rows and the entries, or an index is not below `columns`.
    #[inline(never)]
    pub fn from_csr(
        rows: usize,
        columns: usize,
        offsets: Vec<u32>,
        indices: Vec<u32>,
        values: Vec<F>,
    ) -> Result<Self, SparseError> {
        let entries = indices.len();
        let ends = (offsets.first(), offsets.last().map(|&end| end as usize));
        let fits = ends == (Some(&0), Some(entries)) && offsets.len() - 1 == rows;
        if !fits || !offsets.is_sorted() || values.len() != entries {
            return Err(SparseError::Offsets { entries });
        }
        if let Some(entry) = indices.iter().position(|&j| j as usize >= columns) {
            let row = offsets.partition_point(|&offset| offset as usize <= entry) - 1;
            let column = indices[entry] as usize;
            return Err(SparseError::OutOfRange { entry, row, column, rows, columns });
        }
        Ok(Self::with_transpose(rows, columns, Csr { offsets, indices, values }))
    }

    fn with_transpose(rows: usize, columns: usize, matrix: Csr<F>) -> Self {
        let turned = matrix.entries().map(|(row, column, value)| (column, row, value));
        let transpose = Arc::new(Csr::new(columns, turned));
        Self { rows, columns, matrix: Arc::new(matrix), transpose }
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Number of entries.
    pub fn entries(&self) -> usize {
        self.matrix.indices.len()
    }

    /// The transpose; nothing is copied.
    #[must_use]
    #[inline(never)]
    pub fn transposed(&self) -> Self {
        Self {
            rows: self.columns,
            columns: self.rows,
            matrix: Arc::clone(&self.transpose),
            transpose: Arc::clone(&self.matrix),
        }
    }

    /// The rows, for kernels.
    pub fn view(&self) -> CsrRows<'_, F> {
        self.matrix.view()
    }

    /// The same matrix in the other precision, for gradient checks.
    pub fn convert<G: Real>(&self) -> SparseMatrix<G> {
        let convert = |csr: &Csr<F>| {
            Arc::new(Csr {
                offsets: csr.offsets.clone(),
                indices: csr.indices.clone(),
                values: csr.values.iter().map(|x| G::from_f64(Real::to_f64(*x))).collect(),
            })
        };
        SparseMatrix {
            rows: self.rows,
            columns: self.columns,
            matrix: convert(&self.matrix),
            transpose: convert(&self.transpose),
        }
    }
}
