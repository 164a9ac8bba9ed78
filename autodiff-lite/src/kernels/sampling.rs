//! Bilinear reading of features-last images at any points.

use crate::Real;
use crate::kernels::blocks::{SERIAL_ELEMENTS, for_each_part};
use crate::kernels::extent::elements;
use crate::kernels::simd::clones;

/// Points of one task.
const CHUNK: usize = 512;
/// Partial sums of a dot product side by side, so that they vectorise.
const LANES: usize = 16;

/// What lies outside an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Padding {
    /// Zeros: beyond the outermost pixel centres values fade to zero within one pixel.
    Zeros,
    /// The nearest pixel; no gradient to a coordinate outside.
    Border,
}

/// How points are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sampling {
    /// N, H, W, C.
    pub image: [usize; 4],
    /// Points for each image.
    pub points: usize,
    /// What lies outside.
    pub padding: Padding,
    /// Whether ±1 is the centre (else the outer edge) of the outermost pixels.
    pub align_corners: bool,
}

/// One point of an image: four pixels (rows, columns), those that do not exist left out.
struct Corners<F> {
    rows: [Option<usize>; 2],
    columns: [Option<usize>; 2],
    down: F,
    over: F,
    /// d pixel / d coordinate, zero where the border holds it.
    derivative: [F; 2],
}

impl Sampling {
    /// The pixel coordinate of one in [-1, 1], its derivative, and the two pixels around it.
    #[inline(always)]
    fn axis<F: Real>(&self, coordinate: F, size: usize) -> (F, F, [Option<usize>; 2]) {
        let (half, n) = (F::from_f64(0.5), F::from_f64(size as f64));
        let one = F::one();
        let (mut at, mut derivative) = if self.align_corners {
            ((coordinate + one) * half * (n - one), half * (n - one))
        } else {
            (((coordinate + one) * n - one) * half, half * n)
        };
        if self.padding == Padding::Border {
            let (low, high) = (F::zero(), n - one);
            // At the bounds themselves the value still moves inwards; the derivative there is a
            // choice, and it is PyTorch's: none.
            if at <= low || at >= high {
                derivative = F::zero();
            }
            at = if at > low { at.min(high) } else { low };
        }
        // Far outside, or not a number: no pixel.
        if !(at > -one && at < n) {
            return (F::zero(), F::zero(), [None; 2]);
        }
        let first = at.floor();
        let index = Real::to_f64(first) as isize;
        let exists = |i: isize| (i >= 0 && i < size as isize).then_some(i as usize);
        (at - first, derivative, [exists(index), exists(index + 1)])
    }

    #[inline(always)]
    fn corners<F: Real>(&self, point: &[F]) -> Corners<F> {
        let [_, h, w, _] = self.image;
        let (over, derivative_x, columns) = self.axis(point[0], w);
        let (down, derivative_y, rows) = self.axis(point[1], h);
        Corners { rows, columns, down, over, derivative: [derivative_x, derivative_y] }
    }

    fn check<F>(&self, x: &[F], points: &[F], y: &[F]) {
        let [n, h, w, c] = self.image;
        assert_eq!(x.len(), elements(&[n, h, w, c]));
        assert_eq!(points.len(), elements(&[n, self.points, 2]));
        assert_eq!(y.len(), elements(&[n, self.points, c]));
    }
}

/// A pixel of an image with its weight, and the derivatives of that over each coordinate.
#[derive(Clone, Copy)]
struct Corner<F> {
    pixel: usize,
    weight: F,
    d_over: F,
    d_down: F,
}

impl<F: Real> Corners<F> {
    /// The pixels that exist, and how many they are.
    #[inline(always)]
    fn existing(&self, w: usize) -> ([Corner<F>; 4], usize) {
        let (zero, one) = (F::zero(), F::one());
        let none = Corner { pixel: 0, weight: zero, d_over: zero, d_down: zero };
        let (mut found, mut count) = ([none; 4], 0);
        let vertical = [(one - self.down, -one), (self.down, one)];
        let across = [(one - self.over, -one), (self.over, one)];
        for (row, (down, d_down)) in self.rows.into_iter().zip(vertical) {
            for (column, (over, d_over)) in self.columns.into_iter().zip(across) {
                if let (Some(row), Some(column)) = (row, column) {
                    let (pixel, weight) = (row * w + column, down * over);
                    let corner =
                        Corner { pixel, weight, d_over: down * d_over, d_down: over * d_down };
                    found[count] = corner;
                    count += 1;
                }
            }
        }
        (found, count)
    }
}

/// `y[n][p] = ` the image at `points[n][p] = (x, y)`, bilinear: (-1, -1) is the top left.
///
/// # Panics
/// If a length does not fit.
pub fn sample<F: Real>(s: &Sampling, x: &[F], points: &[F], y: &mut [F]) {
    sampled(s, x, points, y, false);
}

/// [`sample`], added to `y`.
///
/// # Panics
/// As [`sample`].
pub fn sample_add<F: Real>(s: &Sampling, x: &[F], points: &[F], y: &mut [F]) {
    sampled(s, x, points, y, true);
}

fn sampled<F: Real>(s: &Sampling, x: &[F], points: &[F], y: &mut [F], adds: bool) {
    s.check(x, points, y);
    let c = s.image[3];
    let parallel = y.len() >= SERIAL_ELEMENTS / 2;
    for_each_part(y, CHUNK * c, parallel, |chunk, y| {
        sample_chunk(s, x, points, chunk * CHUNK, y, adds);
    });
}

/// The points from `first` on, as many as `y` has rows.
#[inline(always)]
fn sample_body<F: Real>(
    s: &Sampling,
    x: &[F],
    points: &[F],
    first: usize,
    y: &mut [F],
    adds: bool,
) {
    let [_, h, w, c] = s.image;
    for (at, y) in (first..).zip(y.chunks_exact_mut(c)) {
        let image = &x[at / s.points * h * w * c..][..h * w * c];
        let (corners, count) = s.corners(&points[at * 2..at * 2 + 2]).existing(w);
        let row = |k: usize| &image[corners[k].pixel * c..][..c];
        if !adds {
            y.fill(F::zero());
        }
        if count == 4 {
            // The usual case, in one pass.
            let [a, b, d, e] = [row(0), row(1), row(2), row(3)];
            let [wa, wb, wd, we] = corners.map(|corner| corner.weight);
            for i in 0..c {
                y[i] += (a[i] * wa + b[i] * wb) + (d[i] * wd + e[i] * we);
            }
        } else {
            for (k, corner) in corners.iter().enumerate().take(count) {
                for (y, &x) in y.iter_mut().zip(row(k)) {
                    *y += x * corner.weight;
                }
            }
        }
    }
}

clones!(fn sample_chunk[F: Real](s: &Sampling, x: &[F], points: &[F], first: usize, y: &mut [F], adds: bool) = sample_body);

/// Adds the gradient of the image to `gx`: one task for each image, in the order of its points.
///
/// # Panics
/// If a length does not fit.
pub fn sample_grad_image<F: Real>(s: &Sampling, points: &[F], g: &[F], gx: &mut [F]) {
    s.check(gx, points, g);
    let [_, h, w, c] = s.image;
    for_each_part(gx, h * w * c, g.len() >= SERIAL_ELEMENTS / 2, |image, gx| {
        grad_image(s, points, g, image, gx);
    });
}

#[inline(always)]
fn grad_image_body<F: Real>(s: &Sampling, points: &[F], g: &[F], image: usize, gx: &mut [F]) {
    let [_, _, w, c] = s.image;
    for at in image * s.points..(image + 1) * s.points {
        let g = &g[at * c..(at + 1) * c];
        let (corners, count) = s.corners(&points[at * 2..at * 2 + 2]).existing(w);
        for corner in &corners[..count] {
            for (gx, &g) in gx[corner.pixel * c..][..c].iter_mut().zip(g) {
                *gx += g * corner.weight;
            }
        }
    }
}

clones!(fn grad_image[F: Real](s: &Sampling, points: &[F], g: &[F], image: usize, gx: &mut [F]) = grad_image_body);

/// Adds the gradient of the points to `gp`.
///
/// # Panics
/// If a length does not fit.
pub fn sample_grad_points<F: Real>(s: &Sampling, x: &[F], points: &[F], g: &[F], gp: &mut [F]) {
    s.check(x, points, g);
    assert_eq!(gp.len(), points.len());
    for_each_part(gp, CHUNK * 2, g.len() >= SERIAL_ELEMENTS / 2, |chunk, gp| {
        grad_points(s, x, points, g, chunk * CHUNK, gp);
    });
}

#[inline(always)]
fn grad_points_body<F: Real>(
    s: &Sampling,
    x: &[F],
    points: &[F],
    g: &[F],
    first: usize,
    gp: &mut [F],
) {
    let [_, h, w, c] = s.image;
    for (at, gp) in (first..).zip(gp.chunks_exact_mut(2)) {
        let image = &x[at / s.points * h * w * c..][..h * w * c];
        let g = &g[at * c..(at + 1) * c];
        let around = s.corners(&points[at * 2..at * 2 + 2]);
        let (corners, count) = around.existing(w);
        let row = |k: usize| &image[corners[k].pixel * c..][..c];
        let dots = if count == 4 {
            // The usual case: the gradient is read once.
            dots(g, [row(0), row(1), row(2), row(3)])
        } else {
            let dot = |k: usize| if k < count { dots(g, [row(k)])[0] } else { F::zero() };
            [dot(0), dot(1), dot(2), dot(3)]
        };
        let (mut over, mut down) = (F::zero(), F::zero());
        for (corner, dot) in corners.iter().zip(dots) {
            over += dot * corner.d_over;
            down += dot * corner.d_down;
        }
        gp[0] += over * around.derivative[0];
        gp[1] += down * around.derivative[1];
    }
}

clones!(fn grad_points[F: Real](s: &Sampling, x: &[F], points: &[F], g: &[F], first: usize, gp: &mut [F]) = grad_points_body);

/// The dot products of `a` with each of several rows.
#[inline(always)]
fn dots<F: Real, const N: usize>(a: &[F], rows: [&[F]; N]) -> [F; N] {
    let (blocks, rest) = a.as_chunks::<LANES>();
    let mut sums = [[F::zero(); LANES]; N];
    for (i, a) in blocks.iter().enumerate() {
        for (sums, row) in sums.iter_mut().zip(&rows) {
            let b = &row[i * LANES..][..LANES];
            for k in 0..LANES {
                sums[k] += a[k] * b[k];
            }
        }
    }
    let at = blocks.len() * LANES;
    std::array::from_fn(|n| {
        let mut sums = sums[n];
        let mut width = LANES / 2;
        while width > 0 {
            for k in 0..width {
                let other = sums[k + width];
                sums[k] += other;
            }
            width /= 2;
        }
        rest.iter().zip(&rows[n][at..]).fold(sums[0], |sum, (&a, &b)| sum + a * b)
    })
}
