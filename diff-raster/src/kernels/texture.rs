//! Bilinear lookup in a texture, and the gradient of that.
//!
//! Texel (row `r` from the top, column `c`) has its centre at `u = (c + 1/2) / W`,
//! `v = 1 - (r + 1/2) / H`: `v` is up, and corners are not aligned. Coordinates outside of
//! `[0, 1]` take the border. No mip levels: a texture much finer than the image aliases.

use autodiff_lite::Real;
use autodiff_lite::kernels::parallel::{InParts, Parts};

use crate::faces::NONE;

/// Pixels per parallel task.
const CHUNK: usize = 2048;

/// A texture `[H, W, C]`.
#[derive(Clone, Copy, Debug)]
pub struct Texture<'a, F> {
    /// The texels.
    pub data: &'a [F],
    /// `H`
    pub height: usize,
    /// `W`
    pub width: usize,
    /// `C`
    pub channels: usize,
}

/// Where a lookup falls along one axis: two texels, the weight of the second, and how fast that
/// grows with the coordinate.
#[derive(Clone, Copy)]
struct Tap<F> {
    texels: [usize; 2],
    weight: F,
    derivative: F,
}

/// `x` from 0 to 1 in the direction of the texels.
#[inline(always)]
fn tap<F: Real>(x: F, size: usize) -> Tap<F> {
    let last = size - 1;
    let scale = F::from_f64(size as f64);
    let at = x * scale - F::from_f64(0.5);
    let limit = F::from_f64(last as f64);
    // Not a number falls on texel 0.
    if at.is_nan() || at <= F::zero() {
        return Tap { texels: [0, 0], weight: F::zero(), derivative: F::zero() };
    }
    if at >= limit {
        return Tap { texels: [last, last], weight: F::zero(), derivative: F::zero() };
    }
    let first = Real::to_f64(at) as usize;
    let weight = at - F::from_f64(first as f64);
    Tap { texels: [first, (first + 1).min(last)], weight, derivative: scale }
}

impl<'a, F: Real> Texture<'a, F> {
    #[inline(always)]
    fn taps(&self, uv: [F; 2]) -> [Tap<F>; 2] {
        [tap(F::one() - uv[1], self.height), tap(uv[0], self.width)]
    }

    #[inline(always)]
    fn texel(&self, row: usize, column: usize) -> &'a [F] {
        &self.data[(row * self.width + column) * self.channels..][..self.channels]
    }

    fn is_empty(&self) -> bool {
        self.height * self.width * self.channels == 0
    }
}

/// Looks up `uv [P, 2]` in a texture: `out` is `[P, C]`, all of it written, zero where `face [P]`
/// is [`NONE`].
pub fn texture<F: Real>(texture: Texture<'_, F>, uv: &[F], face: &[u32], out: &mut [F]) {
    let channels = texture.channels;
    if texture.is_empty() {
        out.fill(F::zero());
        return;
    }
    let uv = uv.as_chunks::<2>().0;
    out.par_chunks_mut(CHUNK * channels)
        .zip(uv.par_chunks(CHUNK))
        .zip(face.par_chunks(CHUNK))
        .for_each(|((out, uv), face)| {
            for ((out, &uv), &face) in out.chunks_exact_mut(channels).zip(uv).zip(face) {
                if face == NONE {
                    out.fill(F::zero());
                    continue;
                }
                let [r, c] = texture.taps(uv);
                let rows = r.texels.map(|row| c.texels.map(|column| texture.texel(row, column)));
                for (k, out) in out.iter_mut().enumerate() {
                    let [above, below] = rows.map(|[a, b]| a[k] + c.weight * (b[k] - a[k]));
                    *out = above + r.weight * (below - above);
                }
            }
        });
}

/// The gradient of [`texture`] to `uv [P, 2]`, added to `of_uv`.
pub fn texture_grad_uv<F: Real>(
    texture: Texture<'_, F>,
    uv: &[F],
    face: &[u32],
    grad: &[F],
    of_uv: &mut [F],
) {
    if texture.is_empty() {
        return;
    }
    let pixels = of_uv
        .par_chunks_exact_mut(2)
        .zip(uv.par_chunks_exact(2))
        .zip(grad.par_chunks_exact(texture.channels))
        .zip(face.par_iter())
        .with_min_len(CHUNK);
    pixels.for_each(|(((out, uv), grad), &face)| {
        if face == NONE {
            return;
        }
        let [r, c] = texture.taps([uv[0], uv[1]]);
        let rows = r.texels.map(|row| c.texels.map(|column| texture.texel(row, column)));
        let (mut du, mut dv) = (F::zero(), F::zero());
        for (k, &g) in grad.iter().enumerate() {
            let [[a, b], [d, e]] = rows.map(|row| row.map(|texel| texel[k]));
            let (above, below) = (a + c.weight * (b - a), d + c.weight * (e - d));
            du += g * ((b - a) + r.weight * ((e - d) - (b - a)));
            dv -= g * (below - above);
        }
        out[0] += du * c.derivative;
        out[1] += dv * r.derivative;
    });
}

/// Scratch of [`texture_grad_texels`].
#[derive(Debug, Default)]
pub struct Sorted {
    offsets: Vec<u32>,
    pixels: Vec<u32>,
}

/// The gradient of [`texture`] to the texels, added to `of_texels [H, W, C]`.
///
/// Pixels are sorted by the row of texels they fall on, then each row sums its own pixels in their
/// order: no atomics, and the same bits for any number of threads.
pub fn texture_grad_texels<F: Real>(
    texture: Texture<'_, F>,
    uv: &[F],
    face: &[u32],
    grad: &[F],
    sorted: &mut Sorted,
    of_texels: &mut [F],
) {
    if texture.is_empty() {
        return;
    }
    let Texture { height, width, channels, .. } = texture;
    let uv = uv.as_chunks::<2>().0;
    let row_of = |pixel: usize| texture.taps(uv[pixel])[0].texels[0];
    let seen = || (0..face.len()).filter(|&pixel| face[pixel] != NONE);
    // Two places on, so that filling moves each start to where it belongs.
    sorted.offsets.clear();
    sorted.offsets.resize(height + 2, 0);
    for pixel in seen() {
        sorted.offsets[row_of(pixel) + 2] += 1;
    }
    for row in 2..height + 2 {
        sorted.offsets[row] += sorted.offsets[row - 1];
    }
    sorted.pixels.resize(face.len(), 0);
    for pixel in seen() {
        let next = &mut sorted.offsets[row_of(pixel) + 1];
        sorted.pixels[*next as usize] = pixel as u32;
        *next += 1;
    }
    let (offsets, pixels) = (&sorted.offsets, &sorted.pixels);
    of_texels.par_chunks_exact_mut(width * channels).enumerate().for_each(|(row, out)| {
        // A pixel touches its row and the next.
        for from in row.saturating_sub(1)..=row {
            for &pixel in &pixels[offsets[from] as usize..offsets[from + 1] as usize] {
                let [r, c] = texture.taps(uv[pixel as usize]);
                let mut share = F::zero();
                if r.texels[0] == row {
                    share += F::one() - r.weight;
                }
                if r.texels[1] == row && r.weight > F::zero() {
                    share += r.weight;
                }
                let g = &grad[pixel as usize * channels..][..channels];
                for (column, weight) in c.texels.into_iter().zip([F::one() - c.weight, c.weight]) {
                    let out = &mut out[column * channels..][..channels];
                    out.iter_mut().zip(g).for_each(|(out, &g)| *out += share * weight * g);
                }
            }
        }
    });
}
