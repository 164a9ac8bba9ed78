//! Loops over slices: serial below [`PARALLEL_FROM`] elements, over fixed chunks above.

use rayon::prelude::*;

use crate::Real;
use crate::kernels::simd::clones;

/// Slices shorter than this are not worth a second thread: at 16 K elements two threads made an
/// addition four times slower, at 256 K nearly twice as fast.
pub const PARALLEL_FROM: usize = 128 * 1024;

/// Elements per task. Fixed, so that nothing depends on the number of threads.
pub const CHUNK: usize = 32 * 1024;

#[inline(always)]
fn map_body<F: Real, C: Fn(F) -> F>(x: &[F], y: &mut [F], f: &C) {
    for (y, &x) in y.iter_mut().zip(x) {
        *y = f(x);
    }
}

#[inline(always)]
fn zip_body<F: Real, C: Fn(F, F) -> F>(a: &[F], b: &[F], y: &mut [F], f: &C) {
    for ((y, &a), &b) in y.iter_mut().zip(a).zip(b) {
        *y = f(a, b);
    }
}

#[inline(always)]
fn update_body<F: Real, C: Fn(F, F, F) -> F>(g: &mut [F], x: &[F], y: &[F], f: &C) {
    for ((g, &x), &y) in g.iter_mut().zip(x).zip(y) {
        *g = f(*g, x, y);
    }
}

clones!(fn map_chunk[F: Real, C: Fn(F) -> F](x: &[F], y: &mut [F], f: &C) = map_body);
clones!(fn zip_chunk[F: Real, C: Fn(F, F) -> F](a: &[F], b: &[F], y: &mut [F], f: &C) = zip_body);
clones!(fn update_chunk[F: Real, C: Fn(F, F, F) -> F](g: &mut [F], x: &[F], y: &[F], f: &C) = update_body);

/// `y[i] = f(x[i])`.
///
/// # Panics
/// If the lengths differ.
pub fn map<F: Real>(x: &[F], y: &mut [F], f: impl Fn(F) -> F + Sync) {
    assert_eq!(x.len(), y.len());
    if y.len() < PARALLEL_FROM {
        map_chunk(x, y, &f);
    } else {
        let chunks = y.par_chunks_mut(CHUNK).zip(x.par_chunks(CHUNK));
        chunks.for_each(|(y, x)| map_chunk(x, y, &f));
    }
}

/// `y[i] = f(a[i], b[i])`.
///
/// # Panics
/// If the lengths differ.
pub fn zip<F: Real>(a: &[F], b: &[F], y: &mut [F], f: impl Fn(F, F) -> F + Sync) {
    assert_eq!(a.len(), y.len());
    assert_eq!(b.len(), y.len());
    if y.len() < PARALLEL_FROM {
        zip_chunk(a, b, y, &f);
    } else {
        let chunks = y.par_chunks_mut(CHUNK).zip(a.par_chunks(CHUNK)).zip(b.par_chunks(CHUNK));
        chunks.for_each(|((y, a), b)| zip_chunk(a, b, y, &f));
    }
}

/// `g[i] = f(g[i], x[i], y[i])`, in place.
///
/// # Panics
/// If the lengths differ.
pub fn update<F: Real>(g: &mut [F], x: &[F], y: &[F], f: impl Fn(F, F, F) -> F + Sync) {
    assert_eq!(x.len(), g.len());
    assert_eq!(y.len(), g.len());
    if g.len() < PARALLEL_FROM {
        update_chunk(g, x, y, &f);
    } else {
        let chunks = g.par_chunks_mut(CHUNK).zip(x.par_chunks(CHUNK)).zip(y.par_chunks(CHUNK));
        chunks.for_each(|((g, x), y)| update_chunk(g, x, y, &f));
    }
}

/// `target[i] += source[i]`.
///
/// # Panics
/// If the lengths differ.
pub fn add_to<F: Real>(source: &[F], target: &mut [F]) {
    update(target, source, source, |t, s, _| t + s);
}
