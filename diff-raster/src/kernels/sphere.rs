//! Bilinear lookup in a texture that is wrapped around a sphere, and the gradient of that.
//!
//! A direction `d` falls on longitude `φ = atan2(x, z)` and on the angle `θ` from +y. Texel (row `r` from
//! the top, column `c`) has its centre at `φ = 2π ((c + 1/2) / W - 1/2)`, `θ = π r / (H - 1)`: the first and
//! the last row are the poles, columns go on beyond the last with the first. Seen from outside, the image
//! is upright and not mirrored.

use autodiff_lite::Real;
use autodiff_lite::kernels::parallel::{InParts, Parts};

use super::texture::Texture;

/// Where a direction falls: four texels, the weights of the second column and row.
#[derive(Clone, Copy)]
struct Place<F> {
    columns: [usize; 2],
    rows: [usize; 2],
    across: F,
    down: F,
}

/// Column and row, in texels, of a direction; none for that of length zero.
#[inline(always)]
fn coordinates<F: Real>(d: [F; 3], height: usize, width: usize) -> Option<[F; 2]> {
    let radius = |d: [F; 3]| (d[0] * d[0] + d[2] * d[2]).sqrt();
    let largest = d[0].abs().max(d[1].abs()).max(d[2].abs());
    let (mut d, mut around) = (d, radius(d));
    // Squares beyond what numbers hold, above or below.
    if !around.is_normal() && largest.is_finite() && largest > F::zero() {
        d = d.map(|x| x / largest);
        around = radius(d);
    }
    let length = around + d[1].abs();
    // Also of what is not a number.
    if length.is_nan() || length <= F::zero() {
        return None;
    }
    let turn = F::from_f64(std::f64::consts::TAU);
    let half = F::from_f64(0.5);
    let column = (d[0].atan2(d[2]) / turn + half) * F::from_f64(width as f64) - half;
    let row = around.atan2(d[1]) * F::from_f64((height - 1) as f64 / std::f64::consts::PI);
    Some([column, row])
}

#[inline(always)]
fn place<F: Real>(d: [F; 3], height: usize, width: usize) -> Option<Place<F>> {
    let [column, row] = coordinates(d, height, width)?;
    let first = column.floor();
    // From -1 (half a texel before the first) to the last.
    let left = (Real::to_f64(first) as i64).rem_euclid(width as i64) as usize;
    let top = (Real::to_f64(row) as usize).min(height - 1);
    Some(Place {
        columns: [left, (left + 1) % width],
        rows: [top, (top + 1).min(height - 1)],
        across: column - first,
        down: row - F::from_f64(top as f64),
    })
}

impl<F: Real> Place<F> {
    /// The four texels' first channels, row by row.
    #[inline(always)]
    fn texels(&self, width: usize, channels: usize) -> [[usize; 2]; 2] {
        self.rows.map(|row| self.columns.map(|column| (row * width + column) * channels))
    }
}

fn is_empty<F>(texture: &Texture<'_, F>) -> bool {
    texture.height < 2 || texture.width * texture.channels == 0
}

/// Looks up directions `[P, 3]`, of any length, in the texture of one image: `out` is `[P, C]`, all of it
/// written, zero where the direction is.
pub fn sphere_texture<F: Real>(texture: Texture<'_, F>, directions: &[F], out: &mut [F]) {
    let Texture { data, height, width, channels } = texture;
    if is_empty(&texture) {
        out.fill(F::zero());
        return;
    }
    let directions = directions.as_chunks::<3>().0;
    for (out, &d) in out.chunks_exact_mut(channels).zip(directions) {
        let Some(at) = place(d, height, width) else {
            out.fill(F::zero());
            continue;
        };
        let [[a, b], [c, d]] = at.texels(width, channels);
        for (k, out) in out.iter_mut().enumerate() {
            let above = data[a + k] + at.across * (data[b + k] - data[a + k]);
            let below = data[c + k] + at.across * (data[d + k] - data[c + k]);
            *out = above + at.down * (below - above);
        }
    }
}

/// The gradient of [`sphere_texture`] to the texels of one image, added to `of_texels [H, W, C]`.
pub fn sphere_texture_grad_texels<F: Real>(
    texture: Texture<'_, F>,
    directions: &[F],
    grad: &[F],
    of_texels: &mut [F],
) {
    let Texture { height, width, channels, .. } = texture;
    if is_empty(&texture) {
        return;
    }
    let pixels = directions.as_chunks::<3>().0.iter().zip(grad.chunks_exact(channels));
    for (&d, grad) in pixels {
        let Some(at) = place(d, height, width) else { continue };
        let shares = [F::one() - at.down, at.down];
        let weights = [F::one() - at.across, at.across];
        for (row, share) in at.texels(width, channels).into_iter().zip(shares) {
            for (texel, weight) in row.into_iter().zip(weights) {
                let out = &mut of_texels[texel..texel + channels];
                out.iter_mut().zip(grad).for_each(|(out, &g)| *out += share * weight * g);
            }
        }
    }
}

/// The gradient of [`sphere_texture`] to the directions, added to `of_directions [P, 3]`. A pole has none.
pub fn sphere_texture_grad_directions<F: Real>(
    texture: Texture<'_, F>,
    directions: &[F],
    grad: &[F],
    of_directions: &mut [F],
) {
    let Texture { data, height, width, channels } = texture;
    if is_empty(&texture) {
        return;
    }
    let per_column = F::from_f64(width as f64 / std::f64::consts::TAU);
    let per_row = F::from_f64((height - 1) as f64 / std::f64::consts::PI);
    let pixels = of_directions
        .par_chunks_exact_mut(3)
        .zip(directions.par_chunks_exact(3))
        .zip(grad.par_chunks_exact(channels))
        .with_min_len(2048);
    pixels.for_each(|((out, d), grad)| {
        let [x, y, z] = [d[0], d[1], d[2]];
        let (square, all) = (x * x + z * z, x * x + y * y + z * z);
        let Some(at) = place([x, y, z], height, width) else { return };
        if square.is_nan() || square <= F::zero() {
            return;
        }
        let [[a, b], [c, d]] = at.texels(width, channels);
        let (mut across, mut down) = (F::zero(), F::zero());
        for (k, &g) in grad.iter().enumerate() {
            let (above, below) = (data[b + k] - data[a + k], data[d + k] - data[c + k]);
            across += g * (above + at.down * (below - above));
            let (above, below) = (data[a + k] + at.across * above, data[c + k] + at.across * below);
            down += g * (below - above);
        }
        let (across, down) = (across * per_column / square, down * per_row / all);
        let around = square.sqrt();
        out[0] += across * z + down * y * x / around;
        out[1] -= down * around;
        out[2] += down * y * z / around - across * x;
    });
}
