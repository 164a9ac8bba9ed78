//! Structural similarity and the derivatives of it, row by row.
//!
//! With `G` the Gaussian window (zero padding), `m = G x`, `n = G y`, `p = G x²`, `r = G y²`, `q = G xy`:
//!
//! ```text
//! S = (2 m n + C1) (2 (q - m n) + C2) / ((m² + n² + C1) (p - m² + r - n² + C2)) = A1 A2 / (B1 B2)
//! ```
//!
//! The gradient of `Σ S` with respect to `x` is `G ∂S/∂m + 2 x G ∂S/∂p + y G ∂S/∂q`, and `G` is its own
//! transpose. A row of window sums is made by eleven weighted rows and one horizontal pass, so no
//! image-sized buffer is needed but the derivatives themselves.

use std::ops::Range;

use autodiff_lite::Real;
use autodiff_lite::kernels::parallel::{InParts, Parts};

use super::chunks;

/// Half the width of the window.
pub const RADIUS: usize = 5;
/// The stabilising constants for values in `[0, 1]`: `(0.01)²` and `(0.03)²`.
const C1: f64 = 1e-4;
const C2: f64 = 9e-4;
/// The fewest rows that one task works on.
const BAND: usize = 8;
/// Window sums per row: m, n, p, r, q.
const SUMS: usize = 5;

/// The dimensions of a batch of images, `[N, H, W, C]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plane {
    /// N.
    pub images: usize,
    /// H.
    pub height: usize,
    /// W.
    pub width: usize,
    /// C.
    pub channels: usize,
    /// How many rows and columns at each border do not count: none, or [`RADIUS`] where only windows count that lie
    /// within the image.
    pub margin: usize,
}

impl Plane {
    fn row(&self) -> usize {
        self.width * self.channels
    }

    fn rows(&self) -> usize {
        self.images * self.height
    }

    fn bands(&self) -> usize {
        self.rows().div_ceil(chunks::chunk_len(self.rows(), BAND))
    }

    /// The number of values.
    pub fn len(&self) -> usize {
        self.rows() * self.row()
    }

    /// Whether there are no values.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The number of values that the mean is over.
    pub fn counted(&self) -> usize {
        let within = |size: usize| size.saturating_sub(2 * self.margin);
        self.images * within(self.height) * within(self.width) * self.channels
    }

    /// The values of a row of the batch that count.
    fn counted_of_row(&self, r: usize) -> Range<usize> {
        let i = r % self.height;
        if i < self.margin || i + self.margin >= self.height || self.width <= 2 * self.margin {
            return 0..0;
        }
        self.margin * self.channels..(self.width - self.margin) * self.channels
    }

    /// How many values of scratch [`ssim`] and [`ssim_grad`] need.
    pub fn scratch_len(&self) -> usize {
        self.bands() * 2 * SUMS * self.row()
    }
}

/// `∂S/∂m, ∂S/∂n, ∂S/∂p (= ∂S/∂r), ∂S/∂q` per value: four maps of [`Plane::len`] values one after another.
pub const DERIVATIVES: usize = 4;

/// The mean of S over all values that count of two batches of images; writes the derivatives of S when asked.
///
/// `scratch` has [`Plane::scratch_len`] values, `derivatives` has [`DERIVATIVES`] maps.
pub fn ssim<F: Real>(
    x: &[F],
    y: &[F],
    plane: Plane,
    scratch: &mut [F],
    derivatives: Option<&mut [F]>,
) -> f64 {
    let row = plane.row();
    let band_rows = chunks::chunk_len(plane.rows(), BAND);
    let taps = taps::<F>();
    let work = |band: usize, scratch: &mut [F], mut maps: [&mut [F]; DERIVATIVES]| -> f64 {
        let (sums, column) = scratch.split_at_mut(SUMS * row);
        let mut total = 0.0;
        let rows = band * band_rows..((band + 1) * band_rows).min(plane.rows());
        for (local, r) in rows.enumerate() {
            let counted = plane.counted_of_row(r);
            let out = local * row..(local + 1) * row;
            if plane.margin > 0 && !maps[0].is_empty() {
                for map in &mut maps {
                    map[out.clone()].fill(F::zero());
                }
            }
            if counted.is_empty() {
                continue;
            }
            window_sums(x, y, plane, r, &taps, sums, column);
            total += if maps[0].is_empty() {
                similarity(sums, row, counted, &mut [&mut [], &mut [], &mut [], &mut []])
            } else {
                similarity(sums, row, counted, &mut maps.each_mut().map(|m| &mut m[out.clone()]))
            };
        }
        total
    };
    let count = plane.bands();
    let mut partial = [0.0f64; 256];
    let scratch = scratch[..plane.scratch_len()].par_chunks_mut(2 * SUMS * row);
    let partial = &mut partial[..count];
    match derivatives {
        None => {
            partial.par_iter_mut().zip(scratch).enumerate().for_each(|(band, (total, scratch))| {
                *total = work(band, scratch, [&mut [], &mut [], &mut [], &mut []]);
            });
        }
        Some(derivatives) => {
            let (a, rest) = derivatives.split_at_mut(plane.len());
            let (b, rest) = rest.split_at_mut(plane.len());
            let (c, d) = rest.split_at_mut(plane.len());
            let size = band_rows * row;
            partial
                .par_iter_mut()
                .zip(scratch)
                .zip(a.par_chunks_mut(size).zip(b.par_chunks_mut(size)))
                .zip(c.par_chunks_mut(size).zip(d[..plane.len()].par_chunks_mut(size)))
                .enumerate()
                .for_each(|(band, (((total, scratch), (a, b)), (c, d)))| {
                    *total = work(band, scratch, [a, b, c, d]);
                });
        }
    }
    partial.iter().sum::<f64>() / plane.counted() as f64
}

/// Writes `scale * ∂(Σ S)/∂x` into `out`, from the derivatives that [`ssim`] wrote.
///
/// `mean` is the map of the derivative by the mean of `x` (0 when `x` was the first image, 1 when the second);
/// `x` is the image that the gradient is for, `y` the other.
pub fn ssim_grad<F: Real>(
    x: &[F],
    y: &[F],
    plane: Plane,
    derivatives: &[F],
    mean: usize,
    scale: F,
    scratch: &mut [F],
    out: &mut [F],
) {
    let row = plane.row();
    let band_rows = chunks::chunk_len(plane.rows(), BAND);
    let taps = taps::<F>();
    let map = |k: usize| &derivatives[k * plane.len()..(k + 1) * plane.len()];
    let maps = [map(mean), map(2), map(3)];
    let two = F::one() + F::one();
    out.par_chunks_mut(band_rows * row)
        .zip(scratch[..plane.scratch_len()].par_chunks_mut(2 * SUMS * row))
        .enumerate()
        .for_each(|(band, (out, scratch))| {
            let (blurred, column) = scratch.split_at_mut(SUMS * row);
            for (local, out) in out.chunks_mut(row).enumerate() {
                let r = band * band_rows + local;
                for (k, map) in maps.iter().enumerate() {
                    let column = &mut column[..row];
                    column.fill(F::zero());
                    for (s, g) in window_rows(plane, r, &taps) {
                        axpy(column, g, &map[s]);
                    }
                    horizontal(column, &mut blurred[k * row..(k + 1) * row], plane.channels, &taps);
                }
                let (dm, rest) = blurred.split_at(row);
                let (dp, rest) = rest.split_at(row);
                let dq = &rest[..row];
                let (x, y) = (&x[r * row..(r + 1) * row], &y[r * row..(r + 1) * row]);
                for j in 0..row {
                    out[j] = scale * (dm[j] + two * x[j] * dp[j] + y[j] * dq[j]);
                }
            }
        });
}

/// The Gaussian window of standard deviation 1.5, normalised to one.
fn taps<F: Real>() -> [F; 2 * RADIUS + 1] {
    let g: [f64; 2 * RADIUS + 1] = std::array::from_fn(|k| {
        let d = k as f64 - RADIUS as f64;
        (-d * d / (2.0 * 1.5 * 1.5)).exp()
    });
    let total: f64 = g.iter().sum();
    g.map(|v| F::from_f64(v / total))
}

/// The rows under the window of row `r` (counted over the whole batch), as ranges, with their weights.
fn window_rows<F: Real>(
    plane: Plane,
    r: usize,
    taps: &[F],
) -> impl Iterator<Item = (Range<usize>, F)> {
    let (image, i) = (r / plane.height, r % plane.height);
    let (first, last) = (i.saturating_sub(RADIUS), (i + RADIUS).min(plane.height - 1));
    let row = plane.row();
    (first..=last).map(move |s| {
        let at = image * plane.height + s;
        (at * row..(at + 1) * row, taps[s + RADIUS - i])
    })
}

/// The five window sums of row `r` into `sums`; `column` is scratch of the same size.
fn window_sums<F: Real>(
    x: &[F],
    y: &[F],
    plane: Plane,
    r: usize,
    taps: &[F],
    sums: &mut [F],
    column: &mut [F],
) {
    let row = plane.row();
    let column = &mut column[..SUMS * row];
    column.fill(F::zero());
    let (m, rest) = column.split_at_mut(row);
    let (n, rest) = rest.split_at_mut(row);
    let (p, rest) = rest.split_at_mut(row);
    let (rr, q) = rest.split_at_mut(row);
    for (s, g) in window_rows(plane, r, taps) {
        let (x, y) = (&x[s.clone()], &y[s]);
        for j in 0..row {
            let (gx, gy) = (g * x[j], g * y[j]);
            m[j] += gx;
            n[j] += gy;
            p[j] += gx * x[j];
            rr[j] += gy * y[j];
            q[j] += gx * y[j];
        }
    }
    for k in 0..SUMS {
        let part = k * row..(k + 1) * row;
        horizontal(&column[part.clone()], &mut sums[part], plane.channels, taps);
    }
}

/// One row under the window in the horizontal direction.
fn horizontal<F: Real>(src: &[F], dst: &mut [F], channels: usize, taps: &[F]) {
    dst.fill(F::zero());
    let len = src.len();
    for (k, &g) in taps.iter().enumerate() {
        // dst[j] += g * src[j + shift], where that exists
        if k >= RADIUS {
            let shift = ((k - RADIUS) * channels).min(len);
            axpy(&mut dst[..len - shift], g, &src[shift..]);
        } else {
            let shift = ((RADIUS - k) * channels).min(len);
            axpy(&mut dst[shift..], g, &src[..len - shift]);
        }
    }
}

fn axpy<F: Real>(out: &mut [F], g: F, src: &[F]) {
    for (o, &s) in out.iter_mut().zip(src) {
        *o += g * s;
    }
}

/// The sum of S along what counts of one row; fills the derivatives there when the maps are not empty.
fn similarity<F: Real>(
    sums: &[F],
    row: usize,
    counted: Range<usize>,
    maps: &mut [&mut [F]; DERIVATIVES],
) -> f64 {
    let (c1, c2, two) = (F::from_f64(C1), F::from_f64(C2), F::one() + F::one());
    let mut total = 0.0;
    let derivatives = !maps[0].is_empty();
    for j in counted {
        let [m, n, p, r, q] = std::array::from_fn(|k| sums[k * row + j]);
        let (a1, a2) = (two * m * n + c1, two * (q - m * n) + c2);
        let (b1, b2) = (m * m + n * n + c1, p - m * m + r - n * n + c2);
        let s = a1 * a2 / (b1 * b2);
        total += s.to_f64();
        if derivatives {
            let inverse = F::one() / (b1 * b2);
            let cross = two * (a2 - a1) * inverse;
            let own = two * s * (b2 - b1) * inverse; // 2 S (1/B1 - 1/B2)
            maps[0][j] = n * cross - m * own;
            maps[1][j] = m * cross - n * own;
            maps[2][j] = -s / b2;
            maps[3][j] = two * a1 * inverse;
        }
    }
    total
}
