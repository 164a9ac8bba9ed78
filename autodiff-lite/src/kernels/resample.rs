//! Bilinear reading of features-last images: on a grid, and at any points.

use crate::Real;
use crate::kernels::blocks::{SERIAL_ELEMENTS, for_each_part};

/// Points of one task.
const CHUNK: usize = 512;

/// What lies outside an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Padding {
    /// Zeros: beyond the outermost pixel centres values fade to zero within one pixel.
    Zeros,
    /// The nearest pixel; no gradient to a coordinate outside.
    Border,
}

/// Two pixels and their weights along one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blend<F> {
    /// The first and the second pixel.
    pub at: [usize; 2],
    /// The weight of the second; that of the first is 1 less it.
    pub weight: F,
}

/// The blends that resize an axis of `from` pixels to `to`.
///
/// With `align_corners` the outermost pixel centres stay where they are, else the outermost
/// edges: `source = (i + 1/2) from / to - 1/2`, clamped to the image, as in PyTorch.
pub fn resize_blends<F: Real>(from: usize, to: usize, align_corners: bool) -> Vec<Blend<F>> {
    let last = from.saturating_sub(1);
    (0..to)
        .map(|i| {
            let source = if align_corners {
                if to > 1 { i as f64 * last as f64 / (to - 1) as f64 } else { 0.0 }
            } else {
                (i as f64 + 0.5) * from as f64 / to as f64 - 0.5
            };
            let source = source.clamp(0.0, last as f64);
            let first = (source.floor() as usize).min(last);
            let weight = F::from_f64(source - first as f64);
            Blend { at: [first, (first + 1).min(last)], weight }
        })
        .collect()
}

/// `x [N, H, W, C]` to `y [N, rows, columns, C]`.
///
/// # Panics
/// If a length does not fit.
pub fn resize<F: Real>(
    [n, h, w, c]: [usize; 4],
    rows: &[Blend<F>],
    columns: &[Blend<F>],
    x: &[F],
    y: &mut [F],
) {
    assert_eq!(x.len(), n * h * w * c);
    assert_eq!(y.len(), n * rows.len() * columns.len() * c);
    let parallel = y.len() >= SERIAL_ELEMENTS;
    for_each_part(y, columns.len() * c, parallel, |row, y| {
        let (image, blend) = (row / rows.len(), rows[row % rows.len()]);
        let line = |at: usize| &x[(image * h + at) * w * c..][..w * c];
        let [top, bottom] = blend.at.map(line);
        for (y, across) in y.chunks_exact_mut(c).zip(columns) {
            let [left, right] = across.at.map(|at| at * c);
            for i in 0..c {
                let upper = top[left + i] + (top[right + i] - top[left + i]) * across.weight;
                let lower =
                    bottom[left + i] + (bottom[right + i] - bottom[left + i]) * across.weight;
                y[i] = upper + (lower - upper) * blend.weight;
            }
        }
    });
}

/// Adds the gradient of [`resize`]'s input.
///
/// # Panics
/// If a length does not fit.
pub fn resize_grad<F: Real>(
    [n, h, w, c]: [usize; 4],
    rows: &[Blend<F>],
    columns: &[Blend<F>],
    g: &[F],
    gx: &mut [F],
) {
    assert_eq!(gx.len(), n * h * w * c);
    let output = rows.len() * columns.len() * c;
    assert_eq!(g.len(), n * output);
    for_each_part(gx, h * w * c, g.len() >= SERIAL_ELEMENTS, |image, gx| {
        let g = &g[image * output..(image + 1) * output];
        for (g, blend) in g.chunks_exact(columns.len() * c).zip(rows) {
            for (g, across) in g.chunks_exact(c).zip(columns) {
                let one = F::one();
                for (row, down) in blend.at.into_iter().zip([one - blend.weight, blend.weight]) {
                    for (column, over) in
                        across.at.into_iter().zip([one - across.weight, across.weight])
                    {
                        let to = &mut gx[(row * w + column) * c..][..c];
                        for (gx, &g) in to.iter_mut().zip(g) {
                            *gx += g * down * over;
                        }
                    }
                }
            }
        }
    });
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
    slope: [F; 2],
}

impl Sampling {
    /// The pixel coordinate of one in [-1, 1], its slope, and the two pixels around it.
    fn axis<F: Real>(&self, coordinate: F, size: usize) -> (F, F, [Option<usize>; 2]) {
        let (half, n) = (F::from_f64(0.5), F::from_f64(size as f64));
        let one = F::one();
        let (mut at, mut slope) = if self.align_corners {
            ((coordinate + one) * half * (n - one), half * (n - one))
        } else {
            (((coordinate + one) * n - one) * half, half * n)
        };
        if self.padding == Padding::Border {
            let (low, high) = (F::zero(), n - one);
            // At the bounds themselves the value still moves inwards; the slope there is a
            // choice, and it is PyTorch's: none.
            if at <= low || at >= high {
                slope = F::zero();
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
        (at - first, slope, [exists(index), exists(index + 1)])
    }

    fn corners<F: Real>(&self, point: &[F]) -> Corners<F> {
        let [_, h, w, _] = self.image;
        let (over, slope_x, columns) = self.axis(point[0], w);
        let (down, slope_y, rows) = self.axis(point[1], h);
        Corners { rows, columns, down, over, slope: [slope_x, slope_y] }
    }

    fn check<F>(&self, x: &[F], points: &[F], y: &[F]) {
        let [n, h, w, c] = self.image;
        assert_eq!(x.len(), n * h * w * c);
        assert_eq!(points.len(), n * self.points * 2);
        assert_eq!(y.len(), n * self.points * c);
    }
}

impl<F: Real> Corners<F> {
    /// Calls `f(pixel, weight, d weight / d over, d weight / d down)` for the pixels that exist.
    fn each(&self, w: usize, mut f: impl FnMut(usize, F, F, F)) {
        let one = F::one();
        let vertical = [(one - self.down, -one), (self.down, one)];
        let across = [(one - self.over, -one), (self.over, one)];
        for (row, (down, d_down)) in self.rows.into_iter().zip(vertical) {
            for (column, (over, d_over)) in self.columns.into_iter().zip(across) {
                if let (Some(row), Some(column)) = (row, column) {
                    f(row * w + column, down * over, down * d_over, over * d_down);
                }
            }
        }
    }
}

/// `y[n][p] = ` the image at `points[n][p] = (x, y)`, bilinear: (-1, -1) is the top left.
///
/// # Panics
/// If a length does not fit.
pub fn sample<F: Real>(s: &Sampling, x: &[F], points: &[F], y: &mut [F]) {
    s.check(x, points, y);
    let [_, h, w, c] = s.image;
    let (per_image, total) = (s.points, points.len() / 2);
    for_each_part(y, CHUNK * c, total * c >= SERIAL_ELEMENTS / 2, |chunk, y| {
        for (k, y) in y.chunks_exact_mut(c).enumerate() {
            let at = chunk * CHUNK + k;
            let image = &x[at / per_image * h * w * c..][..h * w * c];
            y.fill(F::zero());
            s.corners(&points[at * 2..at * 2 + 2]).each(w, |pixel, weight, _, _| {
                for (y, &x) in y.iter_mut().zip(&image[pixel * c..][..c]) {
                    *y += x * weight;
                }
            });
        }
    });
}

/// Adds the gradient of the image to `gx`: one task for each image, in the order of its points.
///
/// # Panics
/// If a length does not fit.
pub fn sample_grad_image<F: Real>(s: &Sampling, points: &[F], g: &[F], gx: &mut [F]) {
    s.check(gx, points, g);
    let [_, h, w, c] = s.image;
    for_each_part(gx, h * w * c, g.len() >= SERIAL_ELEMENTS / 2, |image, gx| {
        for at in image * s.points..(image + 1) * s.points {
            let g = &g[at * c..(at + 1) * c];
            s.corners(&points[at * 2..at * 2 + 2]).each(w, |pixel, weight, _, _| {
                for (gx, &g) in gx[pixel * c..][..c].iter_mut().zip(g) {
                    *gx += g * weight;
                }
            });
        }
    });
}

/// Adds the gradient of the points to `gp`.
///
/// # Panics
/// If a length does not fit.
pub fn sample_grad_points<F: Real>(s: &Sampling, x: &[F], points: &[F], g: &[F], gp: &mut [F]) {
    s.check(x, points, g);
    assert_eq!(gp.len(), points.len());
    let [_, h, w, c] = s.image;
    for_each_part(gp, CHUNK * 2, g.len() >= SERIAL_ELEMENTS / 2, |chunk, gp| {
        for (k, gp) in gp.chunks_exact_mut(2).enumerate() {
            let at = chunk * CHUNK + k;
            let image = &x[at / s.points * h * w * c..][..h * w * c];
            let g = &g[at * c..(at + 1) * c];
            let corners = s.corners(&points[at * 2..at * 2 + 2]);
            let (mut over, mut down) = (F::zero(), F::zero());
            corners.each(w, |pixel, _, d_over, d_down| {
                let mut dot = F::zero();
                for (&g, &x) in g.iter().zip(&image[pixel * c..][..c]) {
                    dot += g * x;
                }
                over += dot * d_over;
                down += dot * d_down;
            });
            gp[0] += over * corners.slope[0];
            gp[1] += down * corners.slope[1];
        }
    });
}
