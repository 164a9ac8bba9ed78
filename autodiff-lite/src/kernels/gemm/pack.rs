//! B as the tiles read it: in panels of two vectors of columns, which have all products after each other; columns that do
//! not exist are zero. It is packed once for a whole product.

use std::ops::Range;

use pulp::{Simd, WithSimd};

use crate::kernels::blocks::{SERIAL_ELEMENTS, Shared, for_each_block};
use crate::kernels::isa::Isa;
use crate::kernels::lane::Lane;

use super::Matrix;
use super::transpose::transpose;

/// Rows of B that a task packs.
const ROWS: usize = 16;

/// Panels of a B of `k` rows and `n` columns, of `2 lanes` columns each, into `to`.
///
/// # Safety
/// The machine has the instructions.
///
/// # Panics
/// If `to` is shorter than the panels, or B reaches past its end, or `isa` is not AVX-512.
pub(super) unsafe fn panels<F: Lane>(
    isa: Isa,
    lanes: usize,
    [k, n]: [usize; 2],
    b: Matrix<'_, F>,
    parallel: bool,
    to: &mut [F],
) {
    let width = 2 * lanes;
    let count = n.div_ceil(width);
    let whole = count * width * k;
    let to = Shared::new(&mut to[..whole]);
    let parallel = parallel && whole >= SERIAL_ELEMENTS;
    if b.steps[1] == 1 {
        for_each_block(k.div_ceil(ROWS), parallel, |task| {
            let rows = task * ROWS..k.min(task * ROWS + ROWS);
            let last = b.data[(rows.end - 1) * b.steps[0]..].as_ptr().wrapping_add(n);
            assert!(last <= b.data.as_ptr_range().end, "a row beyond the end");
            // SAFETY: the caller's promise.
            unsafe { isa.run_wide(RowsOfB { b, k, n, range: rows, to }) };
        });
        return;
    }
    for_each_block(count, parallel, |panel| {
        let first = panel * width;
        let columns = width.min(n - first);
        // SAFETY: each panel is its task's.
        let to = unsafe { to.slice(first * k, width * k) };
        if columns < width {
            to.fill(F::zero());
        }
        let from = &b.data[first * b.steps[1]..];
        if b.steps[0] == 1 {
            assert!((columns - 1) * b.steps[1] + k <= from.len(), "a column beyond the end");
            // SAFETY: so many columns of `k` contiguous numbers lie in B, and as many rows of `width` in the panel.
            unsafe {
                transpose(isa, [columns, k], from.as_ptr(), b.steps[1], to.as_mut_ptr(), width);
            }
            return;
        }
        for (row, to) in to.chunks_exact_mut(width).enumerate() {
            for (column, to) in to[..columns].iter_mut().enumerate() {
                *to = from[row * b.steps[0] + column * b.steps[1]];
            }
        }
    });
}

/// Rows of B whose columns are contiguous, into all panels.
struct RowsOfB<'a, F> {
    b: Matrix<'a, F>,
    k: usize,
    n: usize,
    range: Range<usize>,
    to: Shared<F>,
}

impl<F: Lane> WithSimd for RowsOfB<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        let lanes = F::lanes::<S>();
        let width = 2 * lanes;
        for first in (0..self.n).step_by(width) {
            let columns = width.min(self.n - first);
            for row in self.range.clone() {
                let from = self.b.data.as_ptr().wrapping_add(row * self.b.steps[0] + first);
                let to = self.to.at(first * self.k + row * width, width);
                // SAFETY: whoever made this saw that all rows lie in B with their `n` columns; rows of a panel are one
                // task's.
                unsafe {
                    if columns == width {
                        F::store(s, to, F::load(s, from));
                        F::store(s, to.wrapping_add(lanes), F::load(s, from.wrapping_add(lanes)));
                    } else {
                        let (low, high) = (columns.min(lanes), columns.saturating_sub(lanes));
                        F::store(s, to, F::load_first(s, low, from));
                        let rest = F::load_first(s, high, from.wrapping_add(low));
                        F::store(s, to.wrapping_add(lanes), rest);
                    }
                }
            }
        }
    }
}
