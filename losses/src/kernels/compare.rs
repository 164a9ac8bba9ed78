//! Sums over two images, value by value or weighted by pixel.

use std::ops::Range;

use autodiff_lite::Real;

use super::chunks;

/// Values per chunk at least.
const CHUNK: usize = 16 * 1024;
/// Values that each lane adds up in `F` before they join a sum in `f64`: in single precision the
/// rounding of more of them would be seen.
const BLOCK: usize = 64;
const LANES: usize = 16;

/// `Σ f(a, b)`.
pub fn sum<F: Real>(a: &[F], b: &[F], f: impl Fn(F, F) -> F + Sync) -> f64 {
    chunks::sum(a.len(), CHUNK, 1, |range| blocks(&a[range.clone()], &b[range], &f))
}

fn blocks<F: Real>(a: &[F], b: &[F], f: &impl Fn(F, F) -> F) -> f64 {
    let mut total = 0.0;
    for (a, b) in a.chunks(BLOCK * LANES).zip(b.chunks(BLOCK * LANES)) {
        let mut lanes = [F::zero(); LANES];
        let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
        for (a, b) in a.iter().zip(b) {
            for l in 0..LANES {
                lanes[l] += f(a[l], b[l]);
            }
        }
        for (&a, &b) in a_rest.iter().zip(b_rest) {
            lanes[0] += f(a, b);
        }
        total += Real::to_f64(lanes.into_iter().sum::<F>());
    }
    total
}

/// `Σ_p w_p Σ_c f(a_pc, b_pc)`, with one weight per pixel of `channels` values.
pub fn weighted_sum<F: Real>(
    a: &[F],
    b: &[F],
    weights: &[F],
    channels: usize,
    f: impl Fn(F, F) -> F + Sync,
) -> f64 {
    let part = |pixels: Range<usize>| {
        let mut total = 0.0;
        let mut first = pixels.start;
        while first < pixels.end {
            let last = (first + BLOCK).min(pixels.end);
            let mut block = F::zero();
            for p in first..last {
                block += weights[p] * pixel(a, b, channels, p, &f);
            }
            total += Real::to_f64(block);
            first = last;
        }
        total
    };
    chunks::sum(weights.len(), CHUNK / 4, channels, part)
}

/// `Σ_c f(a_c, b_c)` of one pixel.
#[inline]
fn pixel<F: Real>(a: &[F], b: &[F], channels: usize, p: usize, f: &impl Fn(F, F) -> F) -> F {
    let range = p * channels..(p + 1) * channels;
    a[range.clone()].iter().zip(&b[range]).fold(F::zero(), |sum, (&a, &b)| sum + f(a, b))
}

/// `out = scale derivative(a, b)`.
pub fn derivatives<F: Real>(
    a: &[F],
    b: &[F],
    scale: F,
    out: &mut [F],
    derivative: impl Fn(F, F) -> F + Sync,
) {
    chunks::fill(out, CHUNK, 1, |first, out| {
        let (a, b) = (&a[first..first + out.len()], &b[first..first + out.len()]);
        for ((out, &a), &b) in out.iter_mut().zip(a).zip(b) {
            *out = scale * derivative(a, b);
        }
    });
}

/// `out_pc = scale w_p derivative(a_pc, b_pc)`.
pub fn weighted_derivatives<F: Real>(
    a: &[F],
    b: &[F],
    weights: &[F],
    channels: usize,
    scale: F,
    out: &mut [F],
    derivative: impl Fn(F, F) -> F + Sync,
) {
    chunks::fill_pixels(out, channels, CHUNK / 4, |first, out| {
        for (p, out) in out.chunks_mut(channels).enumerate() {
            let w = scale * weights[first + p];
            let range = (first + p) * channels..(first + p + 1) * channels;
            for ((out, &a), &b) in out.iter_mut().zip(&a[range.clone()]).zip(&b[range]) {
                *out = w * derivative(a, b);
            }
        }
    });
}

/// `out_p = scale Σ_c f(a_pc, b_pc)`: the gradient of [`weighted_sum`] by its weights.
pub fn pixel_sums<F: Real>(
    a: &[F],
    b: &[F],
    channels: usize,
    scale: F,
    out: &mut [F],
    f: impl Fn(F, F) -> F + Sync,
) {
    chunks::fill(out, CHUNK / 4, channels, |first, out| {
        for (p, out) in out.iter_mut().enumerate() {
            *out = scale * pixel(a, b, channels, first + p, &f);
        }
    });
}
