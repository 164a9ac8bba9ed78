//! Matrix products of any strides: what is asked for, looked at, and handed to the [compiled](Compiled) [kernels](crate::kernels::gemm).

use crate::kernels::compiled::Compiled;
use crate::kernels::extent::{elements, reach};
use crate::kernels::gemm::{Finish, Joined, Matrix, scale};

/// `C = alpha A B + beta C` where `A` is `m x k`, `B` is `k x n` and `C` is `m x n`, contiguous.
/// With `beta = 0`, `C` is only written.
///
/// Large products are shared out to threads: the same bits for any number of them.
///
/// # Panics
/// If a matrix reaches past the end of its slice.
pub fn gemm<F: Compiled>(
    sizes: [usize; 3],
    alpha: F,
    a: Matrix<'_, F>,
    b: Matrix<'_, F>,
    beta: F,
    c: &mut [F],
) {
    gemm_joined(Joined::Sum, sizes, alpha, &[a], &[b], beta, &mut [c], None);
}

/// [`gemm()`], and then `finish(part, place)` for each part of a row of `C`, `place` its row and first column, while it
/// is still in cache: bias and activation.
///
/// # Panics
/// If a matrix reaches past the end of its slice.
pub fn gemm_then<F: Compiled>(
    sizes: [usize; 3],
    alpha: F,
    a: Matrix<'_, F>,
    b: Matrix<'_, F>,
    beta: F,
    c: &mut [F],
    finish: impl Fn(&mut [F], [usize; 2]) + Sync,
) {
    let finish = |part: &mut [F], [_, row, column]: [usize; 3]| finish(part, [row, column]);
    gemm_joined(Joined::Sum, sizes, alpha, &[a], &[b], beta, &mut [c], Some(&finish));
}

/// Several products of the same sizes that have a side in [common](Joined), in one sweep. The common side is one matrix,
/// the others are as many as there are products.
///
/// # Panics
/// If there are other numbers of matrices, or one reaches past the end of its slice.
pub fn gemm_joined<F: Compiled>(
    joined: Joined,
    sizes: [usize; 3],
    alpha: F,
    a: &[Matrix<'_, F>],
    b: &[Matrix<'_, F>],
    beta: F,
    c: &mut [&mut [F]],
    finish: Option<Finish<'_, F>>,
) {
    let [m, k, n] = sizes;
    let counts = [a.len(), b.len(), c.len()];
    let count = a.len().max(b.len());
    let fits = match joined {
        Joined::Rows => counts == [count, 1, count],
        Joined::Columns => counts == [1, count, count],
        Joined::Sum => counts == [count, count, 1],
    };
    assert!(fits && count > 0, "{counts:?} matrices are not joined by {joined:?}");
    for a in a {
        assert!(reach([m, k], a.steps) <= a.data.len(), "the left matrix reaches past its end");
    }
    for b in b {
        assert!(reach([k, n], b.steps) <= b.data.len(), "the right matrix reaches past its end");
    }
    for c in &*c {
        assert!(c.len() >= elements(&[m, n]), "the product is longer than its slice");
    }
    if m == 0 || n == 0 {
        return;
    }
    if k == 0 {
        for (i, c) in c.iter_mut().enumerate() {
            for (row, part) in c[..m * n].chunks_exact_mut(n).enumerate() {
                scale(beta, part);
                if let Some(finish) = finish {
                    finish(part, [i, row, 0]);
                }
            }
        }
        return;
    }
    F::products(joined, sizes, alpha, a, b, beta, c, finish);
}
