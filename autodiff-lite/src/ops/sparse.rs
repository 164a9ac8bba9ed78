//! Products with constant sparse matrices.

use crate::kernels::isa::Isa;
use crate::kernels::sparse::csr_times_rows;
use crate::{Backward, Real, SparseMatrix, Var};

impl<F: Real> Var<'_, F> {
    /// `A x` for each batch element.
    ///
    /// No gradient to the entries of `A`. Where a weight follows, multiply first by whichever makes `D` smaller.
    ///
    /// # Shapes
    /// `self [.., V, D]`, `matrix [K, V]` → `[.., K, D]`.
    ///
    /// # Cost
    /// `2 entries D` flops per batch element, the gradient (with `Aᵀ`) as many.
    ///
    /// # Panics
    /// If `x` has fewer than two axes, or `V` differs.
    #[track_caller]
    #[inline(never)]
    pub fn sparse_matmul(self, matrix: &SparseMatrix<F>) -> Self {
        let x = self.value();
        let mut shape = x.shape().to_vec();
        let [.., v, d] = shape[..] else {
            let operands = [("input", &shape[..], ".., V, D")];
            self.tape.refuse("sparse_matmul", "at least two axes expected", &operands)
        };
        if v != matrix.columns() {
            let sides = [matrix.rows(), matrix.columns()];
            let operands = [("matrix", &sides[..], "K, V"), ("input", &shape, ".., V, D")];
            self.tape.refuse("sparse_matmul", "V differs", &operands);
        }
        let axis = shape.len() - 2;
        let batch = shape[..axis].iter().product();
        shape[axis] = matrix.rows();
        let mut y = self.tape.array(&shape);
        csr_times_rows(Isa::best(), matrix.view(), v, batch, d, x.as_slice(), y.as_slice_mut());
        let transpose = matrix.transposed();
        self.tape.record_fn("sparse_matmul", &[self], y, move |cx: &mut Backward<'_, F>| {
            let (g, matrix) = (cx.grad_out(), transpose.view());
            let rows = transpose.columns();
            cx.give_with(0, |gx| {
                csr_times_rows(Isa::best(), matrix, rows, batch, d, g.as_slice(), gx);
            });
        })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use crate::kernels::isa::Isa;
    use crate::kernels::sparse::csr_times_rows;
    use crate::testkit::gradcheck;
    use crate::{SparseError, SparseMatrix};

    fn matrix() -> SparseMatrix<f64> {
        let entries =
            [(0, 1, 0.5), (0, 4, -2.0), (2, 0, 1.5), (2, 0, 0.25), (3, 3, 1.0), (3, 4, 3.0)];
        SparseMatrix::from_triplets(4, 5, &entries).unwrap()
    }

    gradcheck!(product: |x| x.sparse_matmul(&matrix()), shapes [[[5, 3]], [[2, 5, 1]], [[5, 17]]]);
    gradcheck!(with_the_transpose: |x| x.sparse_matmul(&matrix().transposed()), shapes [[[4, 3]]]);

    #[test]
    fn every_instruction_set_equals_the_dense_product() {
        let a = matrix();
        let dense = {
            let mut dense = [[0.0; 5]; 4];
            for (i, row) in dense.iter_mut().enumerate() {
                let view = a.view();
                for at in view.offsets[i] as usize..view.offsets[i + 1] as usize {
                    row[view.indices[at] as usize] += view.values[at];
                }
            }
            dense
        };
        assert_eq!(dense[2][0], 1.75);
        for width in [1, 3, 12, 16, 67, 192] {
            let x: Vec<f64> = (0..2 * 5 * width).map(|i| (i * 37 % 101) as f64 / 50.0).collect();
            let xf: Vec<f32> = x.iter().map(|&x| x as f32).collect();
            let mut bits: Option<Vec<f32>> = None;
            for isa in Isa::available() {
                let mut y = vec![f64::NAN; 2 * 4 * width];
                let mut yf = vec![f32::NAN; 2 * 4 * width];
                csr_times_rows(isa, a.view(), 5, 2, width, &x, &mut y);
                csr_times_rows(isa, a.convert::<f32>().view(), 5, 2, width, &xf, &mut yf);
                for (at, &y) in y.iter().enumerate() {
                    let (b, i, c) = (at / (4 * width), at / width % 4, at % width);
                    let expected: f64 =
                        (0..5).map(|j| dense[i][j] * x[(b * 5 + j) * width + c]).sum();
                    assert!((y - expected).abs() < 1e-12);
                    assert!((yf[at] as f64 - expected).abs() < 1e-5);
                }
                // Vectors are fused, and ends of rows, of which a longer vector leaves more.
                if isa != Isa::Scalar {
                    assert_eq!(*bits.get_or_insert_with(|| yf.clone()), yf, "{isa:?}");
                }
            }
        }
    }

    #[test]
    fn entries_outside_are_named() {
        let error = SparseMatrix::from_triplets(2, 2, &[(0, 0, 1.0), (1, 2, 1.0)]).unwrap_err();
        assert_eq!(
            error,
            SparseError::OutOfRange { entry: 1, row: 1, column: 2, rows: 2, columns: 2 }
        );
        let error = SparseMatrix::from_csr(1, 2, vec![0, 2], vec![0], vec![1.0_f32]).unwrap_err();
        assert_eq!(error, SparseError::Offsets { entries: 1 });
        let of_rows = |rows, column| {
            SparseMatrix::from_csr(rows, 2, vec![0, 1, 2], vec![0, column], vec![1.0_f32; 2])
        };
        assert!(of_rows(2, 1).is_ok() && of_rows(2, 2).is_err());
        assert_eq!(of_rows(3, 1).unwrap_err(), SparseError::Offsets { entries: 2 });
    }
}
