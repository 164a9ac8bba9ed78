//! Matrix products `C = alpha A B + beta C` of any strides, for `f32` and `f64`.

use crate::kernels::blocks::{SERIAL_BELOW, Shared, for_each_block};
use crate::kernels::lane::Lane;

/// A matrix within a slice.
#[derive(Clone, Copy, Debug)]
pub struct Matrix<'a, F> {
    /// Its elements, the first at the front.
    pub data: &'a [F],
    /// Steps between rows and between columns.
    pub steps: [usize; 2],
}

impl<'a, F> Matrix<'a, F> {
    /// A contiguous matrix of `columns` columns.
    pub fn rows(data: &'a [F], columns: usize) -> Self {
        Self { data, steps: [columns, 1] }
    }

    /// The transpose of a contiguous matrix that has `columns` columns as it lies.
    pub fn transposed(data: &'a [F], columns: usize) -> Self {
        Self { data, steps: [1, columns] }
    }
}

/// Elements that a matrix reaches over.
fn reach([rows, columns]: [usize; 2], steps: [usize; 2]) -> usize {
    if rows == 0 || columns == 0 {
        return 0;
    }
    (rows - 1) * steps[0] + (columns - 1) * steps[1] + 1
}

/// `C = alpha A B + beta C` where `A` is `m x k`, `B` is `k x n` and `C` is `m x n`, contiguous.
/// With `beta = 0`, `C` is only written.
///
/// Large products are cut into blocks of `C` that depend on the sizes alone, and each block is
/// one product of one thread: the same bits for any number of threads.
///
/// # Panics
/// If a matrix reaches past the end of its slice.
pub fn gemm<F: Lane>(
    [m, k, n]: [usize; 3],
    alpha: F,
    a: Matrix<'_, F>,
    b: Matrix<'_, F>,
    beta: F,
    c: &mut [F],
) {
    assert!(reach([m, k], a.steps) <= a.data.len(), "the left matrix reaches past its end");
    assert!(reach([k, n], b.steps) <= b.data.len(), "the right matrix reaches past its end");
    assert!(c.len() >= m * n, "the product is longer than its slice");
    if m == 0 || n == 0 {
        return;
    }
    if k == 0 {
        for c in &mut c[..m * n] {
            *c = if beta == F::zero() { F::zero() } else { beta * *c };
        }
        return;
    }
    let out = Shared::new(c);
    let [rows, columns] = block([m, k, n]);
    let across = n.div_ceil(columns);
    let count = m.div_ceil(rows) * across;
    let parallel = 2 * m * k * n >= SERIAL_BELOW;
    for_each_block(count, parallel, |task| {
        let (i, j) = (task / across * rows, task % across * columns);
        let (here_m, here_n) = (rows.min(m - i), columns.min(n - j));
        // SAFETY: all three matrices were checked to lie in their slices; blocks of C are
        // disjoint.
        unsafe {
            gemm::gemm(
                here_m,
                here_n,
                k,
                out.at(i * n + j),
                1,
                n as isize,
                beta != F::zero(),
                a.data.as_ptr().add(i * a.steps[0]),
                a.steps[1] as isize,
                a.steps[0] as isize,
                b.data.as_ptr().add(j * b.steps[1]),
                b.steps[1] as isize,
                b.steps[0] as isize,
                beta,
                alpha,
                false,
                false,
                false,
                gemm::Parallelism::None,
            );
        }
    });
}

/// Rows and columns of a block of C: enough blocks to share out, each large enough that packing
/// both of its operands is little beside its products.
fn block([m, k, n]: [usize; 3]) -> [usize; 2] {
    let blocks = (2 * m * k * n / 40_000_000).clamp(1, 16);
    if blocks == 1 {
        return [m, n];
    }
    if m >= n {
        [m.div_ceil(blocks).next_multiple_of(16), n]
    } else {
        [m, n.div_ceil(blocks).next_multiple_of(64)]
    }
}
