//! Sums, maxima and minima, over fixed chunks: the result does not depend on the number of threads.

use crate::Real;
use crate::kernels::blocks::for_each_part;
use crate::kernels::columns::column_sums;
use crate::kernels::elementwise::{CHUNK, PARALLEL_FROM};
use crate::kernels::extent::elements;
use crate::kernels::simd::clones;

/// Partial sums side by side: they vectorise, and they lose less than one running sum.
const LANES: usize = 64;

#[inline(always)]
fn sum_body<F: Real>(x: &[F]) -> F {
    if x.len() < LANES {
        // The lanes would all stay zero.
        return x.iter().fold(F::zero(), |sum, &x| sum + x);
    }
    let (blocks, rest) = x.as_chunks::<LANES>();
    let mut lanes = [F::zero(); LANES];
    for block in blocks {
        for k in 0..LANES {
            lanes[k] += block[k];
        }
    }
    let mut width = LANES / 2;
    while width > 0 {
        for k in 0..width {
            let other = lanes[k + width];
            lanes[k] += other;
        }
        width /= 2;
    }
    rest.iter().fold(lanes[0], |sum, &x| sum + x)
}

clones!(fn sum_chunk[F: Real](x: &[F]) -> F = sum_body);

/// `Σ x`: chunks of fixed length are summed in the type, their sums in double precision.
pub fn sum<F: Real>(x: &[F]) -> F {
    if x.len() <= CHUNK {
        return sum_chunk(x);
    }
    let total: f64 = if x.len() < PARALLEL_FROM {
        x.chunks(CHUNK).map(|x| sum_chunk(x).to_f64()).sum()
    } else {
        // Each at its place, then added in order.
        let mut parts = vec![0.0; x.len().div_ceil(CHUNK)];
        for_each_part(&mut parts, 1, true, |k, part| {
            let start = k * CHUNK;
            part[0] = sum_chunk(&x[start..(start + CHUNK).min(x.len())]).to_f64();
        });
        parts.iter().sum()
    };
    F::from_f64(total)
}

#[inline(always)]
fn squares_body<F: Real>(x: &[F]) -> f64 {
    let square = |x: F| x.to_f64() * x.to_f64();
    let (blocks, rest) = x.as_chunks::<16>();
    // Sixteen sums side by side: one alone would wait for each addition.
    let mut sums = [0.0; 16];
    for block in blocks {
        for k in 0..16 {
            sums[k] += square(block[k]);
        }
    }
    sums.iter().sum::<f64>() + rest.iter().map(|&x| square(x)).sum::<f64>()
}

clones!(
    /// `Σ x²` in double precision, in an order that depends on the length alone.
    pub fn sum_of_squares[F: Real](x: &[F]) -> f64 = squares_body
);

/// `y[o, i] = Σ_k x[o, k, i]` for `x [outer, n, inner]`.
///
/// # Panics
/// If a length does not fit.
pub fn sum_axis<F: Real>([outer, n, inner]: [usize; 3], x: &[F], y: &mut [F]) {
    assert_eq!(x.len(), elements(&[outer, n, inner]));
    assert_eq!(y.len(), elements(&[outer, inner]));
    if n == 0 || inner == 0 {
        y.fill(F::zero());
        return;
    }
    let (parallel, from) = (x.len() >= PARALLEL_FROM, n * inner);
    for_each_part(y, inner, parallel, |o, y| {
        let x = &x[o * from..][..from];
        match inner {
            1 => y[0] = sum(x),
            2..=WIDE => column_sums(x, y),
            _ => wide_sums(x, y, parallel),
        }
    });
}

/// Columns from which a sum over rows is cut into strips of columns, not into chunks of rows, whose sums would be as many
/// as what is summed.
const WIDE: usize = 512;

/// Sums over rows of more than [`WIDE`] numbers, strip by strip.
fn wide_sums<F: Real>(x: &[F], y: &mut [F], parallel: bool) {
    let inner = y.len();
    for_each_part(y, WIDE, parallel, |strip, y| {
        let mut sums = [F::zero(); WIDE];
        let sums = &mut sums[..y.len()];
        y.fill(F::zero());
        // Sums of so many rows, then the sum of those: it keeps more digits than one running sum.
        for rows in x.chunks(64 * inner) {
            sums.fill(F::zero());
            for row in rows.chunks_exact(inner) {
                add_chunk(&row[strip * WIDE..][..sums.len()], sums);
            }
            add_chunk(sums, y);
        }
    });
}

#[inline(always)]
fn add_body<F: Real>(x: &[F], sums: &mut [F]) {
    sums.iter_mut().zip(x).for_each(|(sum, &x)| *sum += x);
}

clones!(fn add_chunk[F: Real](x: &[F], sums: &mut [F]) = add_body);

/// `y[o, i] = max_k x[o, k, i]`, and the first `k` that reaches it.
///
/// # Panics
/// If a length does not fit, or `n` is 0.
pub fn max_axis<F: Real>(dims: [usize; 3], x: &[F], y: &mut [F], argument: &mut [u32]) {
    extreme_axis(dims, x, y, argument, |x, y| x > y);
}

/// `y[o, i] = min_k x[o, k, i]`, and the first `k` that reaches it.
///
/// # Panics
/// If a length does not fit, or `n` is 0.
pub fn min_axis<F: Real>(dims: [usize; 3], x: &[F], y: &mut [F], argument: &mut [u32]) {
    extreme_axis(dims, x, y, argument, |x, y| x < y);
}

/// The first element along the axis that is `before` all others, or is not a number.
fn extreme_axis<F: Real>(
    [outer, n, inner]: [usize; 3],
    x: &[F],
    y: &mut [F],
    argument: &mut [u32],
    before: impl Fn(F, F) -> bool,
) {
    assert!(n > 0, "the extreme of nothing");
    assert_eq!(x.len(), elements(&[outer, n, inner]));
    assert_eq!(y.len(), elements(&[outer, inner]));
    assert_eq!(argument.len(), y.len());
    for o in 0..outer {
        let (y, argument) =
            (&mut y[o * inner..(o + 1) * inner], &mut argument[o * inner..(o + 1) * inner]);
        y.copy_from_slice(&x[o * n * inner..][..inner]);
        argument.fill(0);
        for k in 1..n {
            let row = &x[(o * n + k) * inner..][..inner];
            for ((y, best), &x) in y.iter_mut().zip(argument.iter_mut()).zip(row) {
                if before(x, *y) || x.is_nan() {
                    *y = x;
                    *best = k as u32;
                }
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    /// Along any axis, of the same number over and over, where a running sum is off by a hundredth.
    #[test]
    fn sums_along_an_axis_keep_their_digits() {
        for [outer, n, inner] in
            [[1, 1_000_000, 2], [2, 300_000, 1], [1, 100_000, 40], [3, 5_000, 700], [1, 300, 9_000]]
        {
            let mut y = vec![0.0_f32; outer * inner];
            sum_axis([outer, n, inner], &vec![0.1_f32; outer * n * inner], &mut y);
            let exact = n as f64 * f64::from(0.1_f32);
            for y in y {
                let error = (f64::from(y) / exact - 1.0).abs();
                assert!(error < 1e-5, "{outer} x {n} x {inner}: {y}");
            }
        }
    }

    #[test]
    fn sums_along_an_axis_do_not_depend_on_threads() {
        for dims in [[1, 200_000, 3], [4, 300, 600], [70_000, 3, 1]] {
            let x: Vec<f32> = (0..dims.iter().product()).map(|k: usize| (k as f32).sin()).collect();
            let [one, three] = [1, 3].map(|n| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
                let mut y = vec![0.0; dims[0] * dims[2]];
                pool.install(|| sum_axis(dims, &x, &mut y));
                y
            });
            assert_eq!(one, three);
        }
    }

    #[test]
    fn sums_are_accurate_and_do_not_depend_on_threads() {
        let x: Vec<f32> =
            (0..PARALLEL_FROM + 12345).map(|k| (k as f32 * 0.7).sin() + 0.1).collect();
        let exact: f64 = x.iter().map(|&x| x as f64).sum();
        let sums: Vec<f32> = [1, 2, 3]
            .iter()
            .map(|&n| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
                pool.install(|| sum(&x))
            })
            .collect();
        assert!((sums[0] as f64 - exact).abs() < 1e-3);
        assert_eq!(sums[0].to_bits(), sums[1].to_bits());
        assert_eq!(sums[0].to_bits(), sums[2].to_bits());
        assert_eq!(sum::<f32>(&[]), 0.0);
        assert_eq!(sum_chunk(&x[..5000]), sum_body(&x[..5000]), "instruction sets agree");
    }
}
