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

/// Rows of a chunk: at least so many that the sums of all chunks are far fewer than what is summed, at most so many that
/// one running sum in single precision keeps its digits.
pub(crate) fn rows_of_chunk(columns: usize) -> usize {
    (CHUNK / columns.max(1)).clamp(16, 512)
}

/// `y = Σ_chunks part(chunk)`: `part` adds rows of a fixed chunk to sums that begin at zero, and the parts are added in
/// pairs, pairs of pairs and so on, which loses less than one running sum. `work` numbers are read per column.
pub(crate) fn fold_rows<F: Real>(
    rows: usize,
    columns: usize,
    work: usize,
    y: &mut [F],
    part: impl Fn(std::ops::Range<usize>, &mut [F]) + Sync + Send,
) {
    let chunk = rows_of_chunk(columns);
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
        let mut left = count;
        while left > 1 {
            let half = left.div_ceil(2);
            let (first, second) = parts[..left * sums].split_at_mut(half * sums);
            super::elementwise::add_to(second, &mut first[..second.len()]);
            left = half;
        }
        y.copy_from_slice(&parts[..sums]);
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A running sum in single precision is off by a hundredth here.
    #[test]
    fn sums_of_many_rows_keep_their_digits() {
        for (rows, columns) in [(1_000_000, 2), (100_000, 3), (20_000, 70), (200, 20_000)] {
            let mut y = vec![0.0_f32; columns];
            column_sums(&vec![0.1_f32; rows * columns], &mut y);
            let exact = rows as f64 * f64::from(0.1_f32);
            for y in y {
                assert!((f64::from(y) / exact - 1.0).abs() < 1e-5, "{rows} x {columns}: {y}");
            }
        }
    }
}
