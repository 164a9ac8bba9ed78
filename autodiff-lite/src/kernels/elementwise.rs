//! Loops over slices: serial below [`PARALLEL_FROM`] elements, over fixed chunks above.

use crate::Real;
use crate::kernels::blocks::{beside, for_each_part};
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
        for_each_part(y, CHUNK, true, |k, y| map_chunk(beside(x, k, CHUNK, y), y, &f));
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
        for_each_part(y, CHUNK, true, |k, y| {
            zip_chunk(beside(a, k, CHUNK, y), beside(b, k, CHUNK, y), y, &f);
        });
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
        for_each_part(g, CHUNK, true, |k, g| {
            let (x, y) = (beside(x, k, CHUNK, g), beside(y, k, CHUNK, g));
            update_chunk(g, x, y, &f);
        });
    }
}

/// `target[i] += source[i]`.
///
/// # Panics
/// If the lengths differ.
pub fn add_to<F: Real>(source: &[F], target: &mut [F]) {
    update(target, source, source, |t, s, _| t + s);
}

#[inline(always)]
fn pull_body<F: Real, C: Fn(F, F, F, F) -> F>(operands: [&[F]; 4], out: &mut [F], f: &C) {
    let [g, a, b, y] = operands.map(|x| &x[..out.len()]);
    for (k, out) in out.iter_mut().enumerate() {
        *out = f(g[k], a[k], b[k], y[k]);
    }
}

clones!(fn pull_chunk[F: Real, C: Fn(F, F, F, F) -> F](operands: [&[F]; 4], out: &mut [F], f: &C) = pull_body);

/// `out[i] = f(g[i], a[i], b[i], y[i])`: the gradient of one operand of a pairwise operation.
///
/// # Panics
/// If the lengths differ.
pub fn pull<F: Real>(operands: [&[F]; 4], out: &mut [F], f: impl Fn(F, F, F, F) -> F + Sync) {
    assert!(operands.iter().all(|x| x.len() == out.len()));
    if out.len() < PARALLEL_FROM {
        pull_chunk(operands, out, &f);
    } else {
        for_each_part(out, CHUNK, true, |k, out| {
            pull_chunk(operands.map(|x| beside(x, k, CHUNK, out)), out, &f);
        });
    }
}

#[inline(always)]
fn lincomb_body<F: Real>(terms: &[(F, &[F])], start: usize, y: &mut [F]) {
    // Blocks that stay in L1 while all terms pass over them, three at once: each pass reads and writes the
    // block. The sum runs in the order of the terms whatever the groups.
    for (k, y) in y.chunks_mut(2048).enumerate() {
        let at = start + k * 2048;
        let n = y.len();
        let part = |i: usize| (terms[i].0, &terms[i].1[at..at + n]);
        let first = terms.len() % 3;
        let (c, x) = part(0);
        match first {
            1 => y.iter_mut().zip(x).for_each(|(y, &x)| *y = c * x),
            2 => {
                let (d, z) = part(1);
                y.iter_mut().zip(x).zip(z).for_each(|((y, &x), &z)| *y = c * x + d * z);
            }
            _ => {
                let ((d, z), (e, w)) = (part(1), part(2));
                let rows = y.iter_mut().zip(x).zip(z).zip(w);
                rows.for_each(|(((y, &x), &z), &w)| *y = c * x + d * z + e * w);
            }
        }
        for i in (if first == 0 { 3 } else { first }..terms.len()).step_by(3) {
            let ((c, x), (d, z), (e, w)) = (part(i), part(i + 1), part(i + 2));
            let rows = y.iter_mut().zip(x).zip(z).zip(w);
            rows.for_each(|(((y, &x), &z), &w)| *y = *y + c * x + d * z + e * w);
        }
    }
}

clones!(fn lincomb_chunk[F: Real](terms: &[(F, &[F])], start: usize, y: &mut [F]) = lincomb_body);

/// `y = Σ c x` over all terms, in one pass over the output.
///
/// # Panics
/// If there is no term, or the lengths differ.
pub fn lincomb<F: Real>(terms: &[(F, &[F])], y: &mut [F]) {
    assert!(!terms.is_empty(), "a linear combination of nothing");
    assert!(terms.iter().all(|(_, x)| x.len() == y.len()));
    if y.len() < PARALLEL_FROM {
        lincomb_chunk(terms, 0, y);
    } else {
        for_each_part(y, CHUNK, true, |k, y| lincomb_chunk(terms, k * CHUNK, y));
    }
}

#[inline(always)]
fn scale_body<F: Real>(x: &mut [F], c: F) {
    for x in x {
        *x *= c;
    }
}

clones!(fn scale_chunk[F: Real](x: &mut [F], c: F) = scale_body);

/// `x[i] *= c`.
pub fn scale_in_place<F: Real>(x: &mut [F], c: F) {
    if x.len() < PARALLEL_FROM {
        scale_chunk(x, c);
    } else {
        for_each_part(x, CHUNK, true, |_, x| scale_chunk(x, c));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_slices_give_the_same_as_short_ones() {
        let n = PARALLEL_FROM + 77;
        let x: Vec<f32> = (0..n).map(|k| (k as f32 * 0.37).sin()).collect();
        let b: Vec<f32> = (0..n).map(|k| (k as f32 * 0.11).cos()).collect();
        let (mut long, mut short) = (vec![0.0; n], vec![0.0; n]);
        map(&x, &mut long, |x| x.exp() + 1.0);
        for (x, y) in x.chunks(1000).zip(short.chunks_mut(1000)) {
            map(x, y, |x| x.exp() + 1.0);
        }
        assert_eq!(long, short);
        lincomb(&[(2.0, &x), (-0.5, &b), (0.25, &x)], &mut long);
        for k in 0..n {
            assert_eq!(long[k], 2.0 * x[k] + -0.5 * b[k] + 0.25 * x[k]);
        }
        pull([&x, &b, &b, &x], &mut long, |g, a, b, y| g + a * b - y);
        assert!(long.iter().zip(&b).all(|(y, b)| (y - b * b).abs() < 1e-6));
    }

    /// The clone of this machine against the plain body: without fused multiply-adds the bits are
    /// the same for every instruction set.
    #[test]
    fn instruction_sets_do_not_change_results() {
        use crate::kernels::transcendental::Transcendental;
        let x: Vec<f32> = (0..1003).map(|k| (k as f32 * 0.37).sin() * 9.0).collect();
        let (mut fast, mut plain) = (vec![0.0; x.len()], vec![0.0; x.len()]);
        for f in [f32::fast_exp, f32::fast_tanh, f32::fast_sigmoid] {
            map_chunk(&x, &mut fast, &f);
            map_body(&x, &mut plain, &f);
            assert_eq!(fast, plain);
        }
        let all = [0.3, -1.7, 0.9, 1.1, -0.2, 0.7, 0.05, -3.0].map(|c| (c, &x[..]));
        for count in 1..=all.len() {
            let terms = &all[..count];
            lincomb_chunk(terms, 0, &mut fast);
            lincomb_body(terms, 0, &mut plain);
            assert_eq!(fast, plain);
            for (y, &x) in plain.iter_mut().zip(&x) {
                *y -= terms[1..].iter().fold(terms[0].0 * x, |sum, &(c, _)| sum + c * x);
            }
            assert!(plain.iter().all(|&rest| rest == 0.0), "{count} terms in another order");
        }
    }
}
