//! Sums and fills over fixed chunks, so that no result depends on the number of threads.

use autodiff_lite::kernels::parallel::{InParts, Parts};
use std::ops::Range;

/// No sum is cut into more parts than this: the partial sums then fit on the stack.
const MAX_CHUNKS: usize = 256;

/// Below this many items a loop stays on the calling thread: waking the pool costs more.
pub const SERIAL: usize = 32 * 1024;

/// The length of the chunks that `len` items are cut into; a function of `len` and `least` alone.
pub fn chunk_len(len: usize, least: usize) -> usize {
    len.div_ceil(MAX_CHUNKS).max(least).max(1)
}

/// Sums `part(range)` over fixed chunks of `0..len`, the parts in parallel, their sum in order.
///
/// `cost` is the work per item in units of about one nanosecond's arithmetic; it decides only
/// whether the pool is woken, never how the range is cut.
pub fn sum(
    len: usize,
    least: usize,
    cost: usize,
    part: impl Fn(Range<usize>) -> f64 + Sync,
) -> f64 {
    let chunk = chunk_len(len, least);
    let count = len.div_ceil(chunk);
    let mut partial = [0.0f64; MAX_CHUNKS];
    let partial = &mut partial[..count];
    let of = |i: usize| part(i * chunk..((i + 1) * chunk).min(len));
    if len.saturating_mul(cost) < SERIAL || count < 2 {
        for (i, p) in partial.iter_mut().enumerate() {
            *p = of(i);
        }
    } else {
        partial.par_iter_mut().enumerate().for_each(|(i, p)| *p = of(i));
    }
    partial.iter().sum()
}

/// Calls `fill(first, chunk)` for chunks of `out`, `first` being the index of the chunk's first item.
pub fn fill<T: Send>(
    out: &mut [T],
    least: usize,
    cost: usize,
    fill: impl Fn(usize, &mut [T]) + Sync,
) {
    let chunk = chunk_len(out.len(), least);
    if out.len().saturating_mul(cost) < SERIAL {
        fill(0, out);
    } else {
        out.par_chunks_mut(chunk).enumerate().for_each(|(i, part)| fill(i * chunk, part));
    }
}

/// [`fill`] that never cuts a pixel of `channels` values; `first` counts pixels.
pub fn fill_pixels<T: Send>(
    out: &mut [T],
    channels: usize,
    least: usize,
    fill: impl Fn(usize, &mut [T]) + Sync,
) {
    if out.is_empty() {
        return;
    }
    let chunk = chunk_len(out.len() / channels.max(1), least);
    if out.len() < SERIAL {
        fill(0, out);
    } else {
        let parts = out.par_chunks_mut(chunk * channels);
        parts.enumerate().for_each(|(i, part)| fill(i * chunk, part));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_do_not_depend_on_the_number_of_threads() {
        let values: Vec<f64> = (0..100_003).map(|i| 1.0 / (i as f64 + 0.3)).collect();
        let total = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("pool");
            pool.install(|| sum(values.len(), 1024, 1, |r| values[r].iter().sum()))
        };
        let one = total(1);
        assert_eq!(one, total(2));
        assert_eq!(one, total(3));
        assert!((one - values.iter().sum::<f64>()).abs() < 1e-9);
    }

    #[test]
    fn nothing_sums_to_zero() {
        assert_eq!(sum(0, 16, 1, |_| 1.0), 0.0);
    }
}
