//! Signed distance to the edge of a mask whose parts may be thin.

use mesh_core::{Image, Mask};

/// How often what the blur took of thin parts is given back.
const ROUNDS: usize = 2;
/// Thin is what is nowhere deeper than the first, in pixels; not thin what is as deep as the second.
const THIN: [f32; 2] = [2.4, 3.2];
/// How far around a pixel the depth is looked for.
const AROUND: usize = 3;

/// How the edge of a mask is found between its pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Blur {
    /// Pixels by which distances are blurred.
    pub(super) sigma: f32,
    /// Whether what it takes of thin parts and gaps is given back.
    pub(super) keeps_thin: bool,
}

impl Blur {
    #[cfg(test)]
    pub(super) fn plain(sigma: f32) -> Self {
        Self { sigma, keeps_thin: false }
    }

    /// Signed distances as those of [`Mask::signed_distance`].
    pub(super) fn distance(self, mask: &Mask) -> Image {
        if self.keeps_thin {
            unbiased_distance(mask, self.sigma)
        } else {
            mask.signed_distance(self.sigma)
        }
    }
}

/// [`Mask::signed_distance`] without its bias where parts or gaps are thin: what the blur took there is blurred and given back, twice.
///
/// Of a strip two pixels wide a blur of one pixel leaves 1.3, of a slit likewise: thin wings erode, gaps close. What is lost after
/// `n` rounds is `(1 - G)^(n + 1)` of the distance, `G` being the blur (twicing, Tukey 1977; the iteration of van Cittert 1931). Elsewhere the bias
/// is small, and not worth the noise of the staircase, some of which comes back with it.
fn unbiased_distance(mask: &Mask, sigma: f32) -> Image {
    let exact = mask.signed_distance(0.0);
    let thin = thinness(&exact);
    let mut found = exact.clone();
    found.blur(sigma);
    if sigma <= 0.0 || thin.iter().all(|&thin| thin == 0.0) {
        return found;
    }
    let blurred = found.clone();
    for _ in 0..ROUNDS {
        let mut lost = found.clone();
        for (lost, exact) in lost.data.iter_mut().zip(&exact.data) {
            *lost = exact - *lost;
        }
        lost.blur(sigma);
        for (found, lost) in found.data.iter_mut().zip(lost.data) {
            *found += lost;
        }
    }
    for ((found, blurred), thin) in found.data.iter_mut().zip(blurred.data).zip(thin) {
        *found = blurred + thin * (*found - blurred);
    }
    found
}

/// How thin mask or background is around each pixel, 0 to 1.
fn thinness(exact: &Image) -> Vec<f32> {
    let (height, width) = (exact.height, exact.width);
    let deepest = |sign: f32| {
        let mut depth: Vec<f32> = exact.data.iter().map(|d| sign * d).collect();
        let mut row = vec![0.0; width];
        for line in depth.chunks_exact_mut(width.max(1)) {
            for (x, out) in row.iter_mut().enumerate() {
                let around = x.saturating_sub(AROUND)..(x + AROUND + 1).min(width);
                *out = line[around].iter().copied().fold(f32::MIN, f32::max);
            }
            line.copy_from_slice(&row);
        }
        let mut most = vec![f32::MIN; depth.len()];
        for (y, out) in most.chunks_exact_mut(width.max(1)).enumerate() {
            for near in y.saturating_sub(AROUND)..(y + AROUND + 1).min(height) {
                for (out, depth) in out.iter_mut().zip(&depth[near * width..]) {
                    *out = out.max(*depth);
                }
            }
        }
        most
    };
    let [least, most] = THIN;
    let of = |(inside, outside): (f32, f32)| {
        // Where one kind alone is near there is no edge.
        let depth = inside.min(outside);
        if depth < 0.0 { 0.0 } else { ((most - depth) / (most - least)).clamp(0.0, 1.0) }
    };
    deepest(-1.0).into_iter().zip(deepest(1.0)).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where strips end that are this many pixels wide, from their middle.
    fn half_width(strip: usize, distance: impl Fn(&Mask) -> Image) -> f32 {
        let (height, width) = (8, 32);
        let mask = Mask::from_fn(height, width, |_, j| (12..12 + strip).contains(&j));
        let d = distance(&mask).data;
        let row = &d[4 * width..5 * width];
        let out = (12..width).find(|&c| row[c] > 0.0 && c >= 12 + strip / 2).unwrap_or(width);
        let (before, after) = (row[out - 1], row[out]);
        out as f32 - 1.0 + before / (before - after) + 0.5 - (12.0 + 0.5 * strip as f32)
    }

    #[test]
    fn a_thin_strip_keeps_its_width() {
        for strip in [2, 3, 4, 6] {
            let exact = 0.5 * strip as f32;
            let found = half_width(strip, |mask| unbiased_distance(mask, 1.0));
            assert!((found - exact).abs() < 0.12, "{found} for {exact}");
        }
        // The blur alone takes a third of it.
        assert!(half_width(2, |mask| mask.signed_distance(1.0)) < 0.7);
    }
}
