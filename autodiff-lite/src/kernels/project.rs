//! Points through camera matrices.

use crate::Real;
use crate::kernels::blocks::{SERIAL_ELEMENTS, for_each_part};
use crate::kernels::columns::fold_rows;
use crate::kernels::extent::elements;

/// Whether a projection divides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Projection {
    /// `(X/W, Y/W, W)`.
    Perspective,
    /// `(X, Y, W)`.
    Affine,
}

/// Below this |W| a point has no place in the image: it is put at 0, and no gradient flows.
pub const NEAREST: f64 = 1e-8;

/// Points of one task. Fixed, so that sums do not depend on the threads.
const CHUNK: usize = 4096;

#[inline(always)]
fn row<F: Real>(m: &[F], r: usize, p: [F; 3]) -> F {
    m[r * 4] * p[0] + m[r * 4 + 1] * p[1] + m[r * 4 + 2] * p[2] + m[r * 4 + 3]
}

/// `1 / W`, or none where the point has no place in the image.
#[inline(always)]
fn inverse<F: Real>(w: F) -> Option<F> {
    (w.is_finite() && w.abs() >= F::from_f64(NEAREST)).then(|| F::one() / w)
}

/// `y[n][v] = (X/W, Y/W, W)` or `(X, Y, W)` where `(X, Y, W) = matrices[n] (p[n][v], 1)`.
///
/// `points` is `[n][v][3]` or, shared by all matrices, `[v][3]`; `matrices` is `[n][3][4]`. A
/// point whose W is nearly 0 or not finite is put at `(0, 0, W)`.
///
/// # Panics
/// If a length does not fit.
pub fn project<F: Real>(
    projection: Projection,
    [n, v]: [usize; 2],
    points: &[F],
    matrices: &[F],
    y: &mut [F],
) {
    assert!(points.len() == elements(&[v, 3]) || points.len() == elements(&[n, v, 3]));
    assert_eq!(matrices.len(), elements(&[n, 12]));
    assert_eq!(y.len(), elements(&[n, v, 3]));
    if v == 0 {
        return;
    }
    let (shared, parallel) = (points.len() != n * v * 3, y.len() >= SERIAL_ELEMENTS / 2);
    for_each_part(y, v * 3, parallel, |i, y| {
        let points = if shared { points } else { &points[i * v * 3..(i + 1) * v * 3] };
        let m = &matrices[i * 12..(i + 1) * 12];
        for (p, y) in points.chunks_exact(3).zip(y.chunks_exact_mut(3)) {
            let p = [p[0], p[1], p[2]];
            let out = [row(m, 0, p), row(m, 1, p), row(m, 2, p)];
            let scale = match projection {
                Projection::Affine => F::one(),
                Projection::Perspective => inverse(out[2]).unwrap_or_default(),
            };
            let place = |x: F| if scale == F::zero() { F::zero() } else { x * scale };
            (y[0], y[1], y[2]) = (place(out[0]), place(out[1]), out[2]);
        }
    });
}

/// The gradient of `(X, Y, W)`, from that of the output.
#[inline(always)]
fn before_division<F: Real>(projection: Projection, m: &[F], p: [F; 3], g: &[F]) -> [F; 3] {
    match projection {
        Projection::Affine => [g[0], g[1], g[2]],
        Projection::Perspective => {
            let Some(scale) = inverse(row(m, 2, p)) else { return [F::zero(); 3] };
            let (x, y) = (row(m, 0, p) * scale, row(m, 1, p) * scale);
            [g[0] * scale, g[1] * scale, g[2] - (g[0] * x + g[1] * y) * scale]
        }
    }
}

/// Adds the gradient of the points: `gp` is as long as `points`. Where they are shared, each
/// point sums over the matrices in order.
///
/// # Panics
/// If a length does not fit.
pub fn grad_points<F: Real>(
    projection: Projection,
    [n, v]: [usize; 2],
    points: &[F],
    matrices: &[F],
    g: &[F],
    gp: &mut [F],
) {
    assert_eq!(gp.len(), points.len());
    assert_eq!(g.len(), elements(&[n, v, 3]));
    let shared = points.len() != n * v * 3;
    let total = points.len() / 3;
    let parallel = n * v * 3 >= SERIAL_ELEMENTS / 2;
    for_each_part(gp, CHUNK * 3, parallel, |chunk, gp| {
        for (k, gp) in gp.chunks_exact_mut(3).enumerate() {
            let at = chunk * CHUNK + k;
            debug_assert!(at < total);
            let p = [points[at * 3], points[at * 3 + 1], points[at * 3 + 2]];
            let cameras = if shared { 0..n } else { at / v..at / v + 1 };
            for i in cameras {
                let vertex = if shared { at } else { at % v };
                let m = &matrices[i * 12..(i + 1) * 12];
                let g = &g[(i * v + vertex) * 3..][..3];
                let d = before_division(projection, m, p, g);
                for axis in 0..3 {
                    gp[axis] += m[axis] * d[0] + m[4 + axis] * d[1] + m[8 + axis] * d[2];
                }
            }
        }
    });
}

/// Adds the gradient of the matrices.
///
/// # Panics
/// If a length does not fit.
pub fn grad_matrices<F: Real>(
    projection: Projection,
    [n, v]: [usize; 2],
    points: &[F],
    matrices: &[F],
    g: &[F],
    gm: &mut [F],
) {
    assert_eq!(gm.len(), elements(&[n, 12]));
    let shared = points.len() != n * v * 3;
    for i in 0..n {
        let points = if shared { points } else { &points[i * v * 3..(i + 1) * v * 3] };
        let (m, g) = (&matrices[i * 12..(i + 1) * 12], &g[i * v * 3..(i + 1) * v * 3]);
        let mut sums = [F::zero(); 12];
        fold_rows(v, 3, 4, &mut sums, |range, sums| {
            for at in range {
                let p = [points[at * 3], points[at * 3 + 1], points[at * 3 + 2]];
                let d = before_division(projection, m, p, &g[at * 3..at * 3 + 3]);
                if d == [F::zero(); 3] {
                    // The point may be infinite.
                    continue;
                }
                for r in 0..3 {
                    for (sum, x) in
                        sums[r * 4..r * 4 + 4].iter_mut().zip([p[0], p[1], p[2], F::one()])
                    {
                        *sum += d[r] * x;
                    }
                }
            }
        });
        for (gm, sum) in gm[i * 12..(i + 1) * 12].iter_mut().zip(sums) {
            *gm += sum;
        }
    }
}
