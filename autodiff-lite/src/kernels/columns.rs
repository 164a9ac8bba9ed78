//! Sums over the rows of a matrix: the gradient of a bias, and statistics of channels.

use crate::Real;
use crate::kernels::blocks::{SERIAL_ELEMENTS, Shared, for_each_block};
use crate::kernels::extent::{self, elements};
use crate::kernels::simd::clones;
use crate::kernels::workspace;

/// Elements of one partial sum. Fixed, so that rounding does not depend on the threads.
pub(crate) const CHUNK: usize = 16 * 1024;

#[inline(always)]
fn add_body<F: Real>(x: &[F], sums: &mut [F]) {
    for row in x.chunks_exact(sums.len()) {
        for (sum, &x) in sums.iter_mut().zip(row) {
            *sum += x;
        }
    }
}

clones!(fn add_rows[F: Real](x: &[F], sums: &mut [F]) = add_body);

/// `y[c] = Σ_rows x[row][c]`.
///
/// # Panics
/// If `x` is not whole rows.
pub fn column_sums<F: Real>(x: &[F], y: &mut [F]) {
    let columns = y.len();
    if columns == 0 {
        return;
    }
    assert!(x.len().is_multiple_of(columns), "the matrix is not whole rows");
    fold_rows(x.len() / columns, columns, 1, y, |rows, sums| {
        add_rows(&x[rows.start * columns..rows.end * columns], sums);
    });
}

/// `y = Σ_chunks part(chunk)`: `part` adds rows of a fixed chunk to sums that begin at zero, and
/// the parts are added in order. `work` numbers are read per column.
pub(crate) fn fold_rows<F: Real>(
    rows: usize,
    columns: usize,
    work: usize,
    y: &mut [F],
    part: impl Fn(std::ops::Range<usize>, &mut [F]) + Sync + Send,
) {
    let chunk = (CHUNK / columns.max(1)).max(1);
    let (count, sums) = (rows.div_ceil(chunk), y.len());
    if count <= 1 {
        y.fill(F::zero());
        part(0..rows, y);
        return;
    }
    workspace::with(elements(&[count, sums]), |parts: &mut [F]| {
        let shared = Shared::new(parts);
        for_each_block(count, extent::work(&[rows, columns, work]) >= SERIAL_ELEMENTS, |k| {
            // SAFETY: each chunk has sums of its own.
            let sums = unsafe { shared.slice(k * sums, sums) };
            sums.fill(F::zero());
            part(k * chunk..((k + 1) * chunk).min(rows), sums);
        });
        y.fill(F::zero());
        add_rows(parts, y);
    });
}
