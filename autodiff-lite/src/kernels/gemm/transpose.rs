//! Squares of numbers that change places in registers.

use crate::kernels::isa::Isa;
use crate::kernels::lane::Lane;

/// `to[j][i] = from[i][j]` for `rows x columns` elements, in rows that lie `from_step` and `to_step` apart.
///
/// # Safety
/// Both matrices lie within memory that `from` may be read in and `to` written, and the machine has the instructions.
pub(super) unsafe fn transpose<F: Lane>(
    isa: Isa,
    [rows, columns]: [usize; 2],
    from: *const F,
    from_step: usize,
    to: *mut F,
    to_step: usize,
) {
    const SIDE: usize = 16;
    for i in (0..rows).step_by(SIDE) {
        for j in (0..columns).step_by(SIDE) {
            let from = from.wrapping_add(i * from_step + j);
            let to = to.wrapping_add(j * to_step + i);
            let (high, wide) = (SIDE.min(rows - i), SIDE.min(columns - j));
            #[cfg(target_arch = "x86_64")]
            if high == SIDE && wide == SIDE && size_of::<F>() == 4 && isa == Isa::Avx512 {
                // SAFETY: a whole square of 4 bytes each lies in both, and the machine has the instructions, by the
                // caller's promise.
                unsafe { sixteen(from.cast(), from_step, to.cast(), to_step) };
                continue;
            }
            // SAFETY: the part lies in both, by the caller's promise.
            unsafe { plain([high, wide], from, from_step, to, to_step) };
        }
    }
}

/// # Safety
/// As [`transpose`].
#[inline(always)]
unsafe fn plain<F: Copy>(
    [rows, columns]: [usize; 2],
    from: *const F,
    from_step: usize,
    to: *mut F,
    to_step: usize,
) {
    for j in 0..columns {
        for i in 0..rows {
            // SAFETY: the caller's promise.
            unsafe {
                *to.wrapping_add(j * to_step + i) = *from.wrapping_add(i * from_step + j);
            }
        }
    }
}

/// 16 by 16.
///
/// # Safety
/// As [`transpose`].
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
unsafe fn sixteen(from: *const f32, from_step: usize, to: *mut f32, to_step: usize) {
    use std::arch::x86_64::{
        _mm512_castpd_ps, _mm512_castps_pd, _mm512_loadu_ps, _mm512_setzero_ps,
        _mm512_shuffle_f32x4, _mm512_storeu_ps, _mm512_unpackhi_pd, _mm512_unpackhi_ps,
        _mm512_unpacklo_pd, _mm512_unpacklo_ps,
    };
    let zero = _mm512_setzero_ps();
    let (mut x, mut y) = ([zero; 16], [zero; 16]);
    for i in 0..16 {
        // SAFETY: the caller's promise.
        x[i] = unsafe { _mm512_loadu_ps(from.wrapping_add(i * from_step)) };
    }
    // Pairs of rows, then fours: each 128 bits hold four rows of one column.
    for i in 0..8 {
        y[2 * i] = _mm512_unpacklo_ps(x[2 * i], x[2 * i + 1]);
        y[2 * i + 1] = _mm512_unpackhi_ps(x[2 * i], x[2 * i + 1]);
    }
    let low = |a, b| _mm512_castpd_ps(_mm512_unpacklo_pd(_mm512_castps_pd(a), _mm512_castps_pd(b)));
    let high =
        |a, b| _mm512_castpd_ps(_mm512_unpackhi_pd(_mm512_castps_pd(a), _mm512_castps_pd(b)));
    for i in 0..4 {
        let rows = [y[4 * i], y[4 * i + 1], y[4 * i + 2], y[4 * i + 3]];
        x[4 * i] = low(rows[0], rows[2]);
        x[4 * i + 1] = high(rows[0], rows[2]);
        x[4 * i + 2] = low(rows[1], rows[3]);
        x[4 * i + 3] = high(rows[1], rows[3]);
    }
    // `x[4 i + c]` has rows 4 i .. 4 i + 4 of columns c, 4 + c, 8 + c, 12 + c: a transpose of 128-bit quarters.
    for c in 0..4 {
        let [a, b, d, e] = [x[c], x[4 + c], x[8 + c], x[12 + c]];
        let (ab, ba) = (_mm512_shuffle_f32x4::<0x44>(a, b), _mm512_shuffle_f32x4::<0xee>(a, b));
        let (de, ed) = (_mm512_shuffle_f32x4::<0x44>(d, e), _mm512_shuffle_f32x4::<0xee>(d, e));
        y[c] = _mm512_shuffle_f32x4::<0x88>(ab, de);
        y[4 + c] = _mm512_shuffle_f32x4::<0xdd>(ab, de);
        y[8 + c] = _mm512_shuffle_f32x4::<0x88>(ba, ed);
        y[12 + c] = _mm512_shuffle_f32x4::<0xdd>(ba, ed);
    }
    for j in 0..16 {
        // SAFETY: the caller's promise.
        unsafe { _mm512_storeu_ps(to.wrapping_add(j * to_step), y[j]) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check<F: Lane>(isa: Isa, [rows, columns]: [usize; 2]) {
        let from: Vec<F> =
            (0..rows * (columns + 3)).map(|i| F::from(i).unwrap_or_default()).collect();
        let mut to = vec![F::zero(); columns * (rows + 1)];
        // SAFETY: both are as long as their rows and steps say.
        unsafe {
            transpose(isa, [rows, columns], from.as_ptr(), columns + 3, to.as_mut_ptr(), rows + 1);
        }
        for i in 0..rows {
            for j in 0..columns {
                assert_eq!(to[j * (rows + 1) + i], from[i * (columns + 3) + j], "{isa:?} {i} {j}");
            }
        }
    }

    #[test]
    fn rows_become_columns() {
        for isa in Isa::available() {
            for size in [[16, 16], [32, 48], [17, 33], [8, 8], [3, 40], [1, 1]] {
                check::<f32>(isa, size);
                check::<f64>(isa, size);
            }
        }
    }
}
