//! Softmax of rows.

use crate::Real;
use crate::kernels::blocks::{SERIAL_ELEMENTS, for_each_part};
use crate::kernels::simd::clones;

/// Elements of one task.
const CHUNK: usize = 16 * 1024;

#[inline(always)]
fn largest<F: Real>(x: &[F]) -> F {
    let mut lanes = [F::neg_infinity(); 16];
    let chunks = x.chunks_exact(16);
    let rest = chunks.remainder();
    for chunk in chunks {
        for (best, &x) in lanes.iter_mut().zip(chunk) {
            *best = if x > *best { x } else { *best };
        }
    }
    let mut best = F::neg_infinity();
    for &x in lanes.iter().chain(rest) {
        best = if x > best { x } else { best };
    }
    // A row of -inf alone would subtract infinities.
    if best == F::neg_infinity() { F::zero() } else { best }
}

#[inline(always)]
fn total<F: Real>(x: &[F]) -> F {
    let mut lanes = [F::zero(); 16];
    let chunks = x.chunks_exact(16);
    let rest = chunks.remainder();
    for chunk in chunks {
        for (sum, &x) in lanes.iter_mut().zip(chunk) {
            *sum += x;
        }
    }
    let mut sum = F::zero();
    for &x in lanes.iter().chain(rest) {
        sum += x;
    }
    sum
}

#[inline(always)]
fn softmax_body<F: Real>(x: &[F], width: usize, y: &mut [F]) {
    for (x, y) in x.chunks_exact(width).zip(y.chunks_exact_mut(width)) {
        let top = largest(x);
        for (y, &x) in y.iter_mut().zip(x) {
            *y = (x - top).fast_exp();
        }
        let scale = F::one() / total(y);
        for y in y {
            *y *= scale;
        }
    }
}

#[inline(always)]
fn log_softmax_body<F: Real>(x: &[F], width: usize, y: &mut [F]) {
    for (x, y) in x.chunks_exact(width).zip(y.chunks_exact_mut(width)) {
        let top = largest(x);
        for (y, &x) in y.iter_mut().zip(x) {
            *y = (x - top).fast_exp();
        }
        let log = total(y).ln();
        for (y, &x) in y.iter_mut().zip(x) {
            // The large parts first: their difference is exact.
            *y = (x - top) - log;
        }
    }
}

/// `g` becomes `y (g - Σ y g)`.
#[inline(always)]
fn softmax_grad_body<F: Real>(y: &[F], width: usize, g: &mut [F]) {
    for (y, g) in y.chunks_exact(width).zip(g.chunks_exact_mut(width)) {
        let mut lanes = [F::zero(); 16];
        for (y, g) in y.chunks(16).zip(g.chunks(16)) {
            for (sum, (&y, &g)) in lanes.iter_mut().zip(y.iter().zip(g)) {
                *sum += y * g;
            }
        }
        let dot = total(&lanes);
        for (g, &y) in g.iter_mut().zip(y) {
            *g = y * (*g - dot);
        }
    }
}

/// `g` becomes `g - exp(y) Σ g`.
#[inline(always)]
fn log_softmax_grad_body<F: Real>(y: &[F], width: usize, g: &mut [F]) {
    for (y, g) in y.chunks_exact(width).zip(g.chunks_exact_mut(width)) {
        let sum = total(g);
        for (g, &y) in g.iter_mut().zip(y) {
            *g -= y.fast_exp() * sum;
        }
    }
}

clones!(fn softmax_rows[F: Real](x: &[F], width: usize, y: &mut [F]) = softmax_body);
clones!(fn log_softmax_rows[F: Real](x: &[F], width: usize, y: &mut [F]) = log_softmax_body);
clones!(fn softmax_grad_rows[F: Real](y: &[F], width: usize, g: &mut [F]) = softmax_grad_body);
clones!(fn log_softmax_grad_rows[F: Real](y: &[F], width: usize, g: &mut [F]) = log_softmax_grad_body);

/// Runs `rows` over chunks of whole rows.
fn by_rows<F: Real>(x: &[F], width: usize, y: &mut [F], rows: fn(&[F], usize, &mut [F])) {
    assert_eq!(x.len(), y.len());
    if x.is_empty() {
        return;
    }
    let chunk = (CHUNK / width).max(1) * width;
    // The exponential weighs as much as several moves.
    let parallel = x.len() >= SERIAL_ELEMENTS / 4;
    for_each_part(y, chunk, parallel, |i, y| rows(&x[i * chunk..][..y.len()], width, y));
}

/// `y = exp(x) / Σ exp(x)` for each row of `width` numbers; finite for any finite row.
///
/// # Panics
/// If the lengths differ.
pub fn softmax<F: Real>(x: &[F], width: usize, y: &mut [F]) {
    by_rows(x, width, y, softmax_rows::<F>);
}

/// `y = x - ln Σ exp(x)` for each row of `width` numbers.
///
/// # Panics
/// If the lengths differ.
pub fn log_softmax<F: Real>(x: &[F], width: usize, y: &mut [F]) {
    by_rows(x, width, y, log_softmax_rows::<F>);
}

/// Turns the gradient of [`softmax`]'s output `y` into that of its input.
///
/// # Panics
/// If the lengths differ.
pub fn softmax_grad<F: Real>(y: &[F], width: usize, g: &mut [F]) {
    by_rows(y, width, g, softmax_grad_rows::<F>);
}

/// Turns the gradient of [`log_softmax`]'s output `y` into that of its input.
///
/// # Panics
/// If the lengths differ.
pub fn log_softmax_grad<F: Real>(y: &[F], width: usize, g: &mut [F]) {
    by_rows(y, width, g, log_softmax_grad_rows::<F>);
}
