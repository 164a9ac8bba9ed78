//! Signed distance to the edge of a binary mask, at sub-pixel level.

/// How often what the blur took of thin parts is given back.
const ROUNDS: usize = 2;
/// Thin is what is nowhere deeper than the first, in pixels; not thin what is as deep as the second.
const THIN: [f32; 2] = [2.4, 3.2];
/// How far around a pixel the depth is looked for.
const AROUND: usize = 3;

/// Signed distance of every pixel centre to the mask's edge, in pixels: negative inside.
///
/// The distance is the exact Euclidean one to the nearest pixel of the other kind, less the half
/// pixel to that pixel's border. A straight edge sampled at pixel centres leaves a staircase whose
/// mean is the edge itself, so a blur of `sigma` pixels turns this into an unbiased estimate of
/// the edge between the pixels; a curved edge of radius `r` pixels shrinks by `sigma^2 / 2r`, and what is no wider than some
/// `sigma` by much more.
///
/// Where the mask is all of one kind every distance is `±(height + width)`.
///
/// # Cost
/// `O(pixels)`: the lower envelope of parabolas, line by line (Felzenszwalb and Huttenlocher,
/// *Distance Transforms of Sampled Functions*, 2012), then two short convolutions.
///
/// # Panics
/// If `mask` is not `height * width` long.
pub fn signed_distance(mask: &[bool], height: usize, width: usize, sigma: f32) -> Vec<f32> {
    let mut signed = between_pixels(mask, height, width);
    blur(&mut signed, height, width, sigma);
    signed
}

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

    /// Signed distances as those of [`signed_distance`].
    pub(super) fn distance(self, mask: &[bool], height: usize, width: usize) -> Vec<f32> {
        let distance = if self.keeps_thin { unbiased_distance } else { signed_distance };
        distance(mask, height, width, self.sigma)
    }
}

/// [`signed_distance`] without its bias where parts or gaps are thin: what the blur took there is blurred and given back, twice.
///
/// Of a strip two pixels wide a blur of one pixel leaves 1.3, of a slit likewise: thin wings erode, gaps close. What is lost after
/// `n` rounds is `(1 - G)^(n + 1)` of the distance, `G` being the blur (twicing, Tukey 1977; the iteration of van Cittert 1931). Elsewhere the bias
/// is small, and not worth the noise of the staircase, some of which comes back with it.
fn unbiased_distance(mask: &[bool], height: usize, width: usize, sigma: f32) -> Vec<f32> {
    let exact = between_pixels(mask, height, width);
    let thin = thinness(&exact, height, width);
    let mut found = exact.clone();
    blur(&mut found, height, width, sigma);
    if sigma <= 0.0 || thin.iter().all(|&thin| thin == 0.0) {
        return found;
    }
    let blurred = found.clone();
    for _ in 0..ROUNDS {
        let mut lost: Vec<f32> = exact.iter().zip(&found).map(|(e, f)| e - f).collect();
        blur(&mut lost, height, width, sigma);
        for (found, lost) in found.iter_mut().zip(lost) {
            *found += lost;
        }
    }
    for ((found, blurred), thin) in found.iter_mut().zip(blurred).zip(thin) {
        *found = blurred + thin * (*found - blurred);
    }
    found
}

/// How thin mask or background is around each pixel, 0 to 1.
fn thinness(exact: &[f32], height: usize, width: usize) -> Vec<f32> {
    let deepest = |sign: f32| {
        let mut depth: Vec<f32> = exact.iter().map(|d| sign * d).collect();
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

/// The exact distance to the nearest pixel of the other kind, less half a pixel.
fn between_pixels(mask: &[bool], height: usize, width: usize) -> Vec<f32> {
    assert_eq!(mask.len(), height * width, "mask [{}] for {height} x {width}", mask.len());
    let far = (height + width) as f32;
    let mut signed = squared_distance(mask, true, height, width);
    let inside = squared_distance(mask, false, height, width);
    for (signed, inside) in signed.iter_mut().zip(inside) {
        *signed = if *signed > 0.0 {
            (signed.sqrt() - 0.5).min(far)
        } else {
            (0.5 - inside.sqrt()).max(-far)
        };
    }
    signed
}

/// Squared distance to the nearest pixel that equals `kind`, 0 there; huge where there is none.
fn squared_distance(mask: &[bool], kind: bool, height: usize, width: usize) -> Vec<f32> {
    const NONE: f32 = 1e12;
    let mut grid: Vec<f32> = mask.iter().map(|&m| if m == kind { 0.0 } else { NONE }).collect();
    let longest = height.max(width);
    let mut envelope = Envelope::new(longest);
    let (mut line, mut out) = (vec![0.0; longest], vec![0.0; longest]);
    for column in 0..width {
        for row in 0..height {
            line[row] = grid[row * width + column];
        }
        envelope.transform(&line[..height], &mut out[..height]);
        for row in 0..height {
            grid[row * width + column] = out[row];
        }
    }
    for row in grid.chunks_exact_mut(width.max(1)) {
        line[..width].copy_from_slice(row);
        envelope.transform(&line[..width], row);
    }
    grid
}

/// The lower envelope of the parabolas `(x - q)^2 + f(q)`.
struct Envelope {
    apex: Vec<usize>,
    start: Vec<f32>,
}

impl Envelope {
    fn new(longest: usize) -> Self {
        Self { apex: vec![0; longest.max(1)], start: vec![0.0; longest + 1] }
    }

    fn transform(&mut self, f: &[f32], out: &mut [f32]) {
        if f.is_empty() {
            return;
        }
        let square = |q: usize| (q * q) as f32;
        let mut last = 0;
        self.apex[0] = 0;
        self.start[0] = f32::NEG_INFINITY;
        for q in 1..f.len() {
            loop {
                let p = self.apex[last];
                let meet = ((f[q] + square(q)) - (f[p] + square(p))) / (2.0 * (q - p) as f32);
                if meet > self.start[last] {
                    last += 1;
                    self.apex[last] = q;
                    self.start[last] = meet;
                    break;
                }
                if last == 0 {
                    self.apex[0] = q;
                    break;
                }
                last -= 1;
            }
        }
        let mut k = 0;
        for (x, o) in out.iter_mut().enumerate() {
            while k < last && self.start[k + 1] < x as f32 {
                k += 1;
            }
            let d = x as f32 - self.apex[k] as f32;
            *o = d * d + f[self.apex[k]];
        }
    }
}

/// Gaussian blur of `[height, width]` in place, edges repeated; nothing for `sigma <= 0`.
fn blur(image: &mut [f32], height: usize, width: usize, sigma: f32) {
    if sigma <= 0.0 || image.is_empty() {
        return;
    }
    let radius = (3.0 * sigma).ceil() as usize;
    let mut taps: Vec<f32> = (0..=2 * radius)
        .map(|k| {
            let d = k as f32 - radius as f32;
            (-d * d / (2.0 * sigma * sigma)).exp()
        })
        .collect();
    let total: f32 = taps.iter().sum();
    for tap in &mut taps {
        *tap /= total;
    }
    let mut padded = vec![0.0; width + 2 * radius];
    for row in image.chunks_exact_mut(width) {
        padded[..radius].fill(row[0]);
        padded[radius..radius + width].copy_from_slice(row);
        padded[radius + width..].fill(row[width - 1]);
        row.fill(0.0);
        for (k, &tap) in taps.iter().enumerate() {
            for (o, &p) in row.iter_mut().zip(&padded[k..]) {
                *o += tap * p;
            }
        }
    }
    let source = image.to_vec();
    for (i, row) in image.chunks_exact_mut(width).enumerate() {
        row.fill(0.0);
        for (k, &tap) in taps.iter().enumerate() {
            let from = (i + k).saturating_sub(radius).min(height - 1) * width;
            for (o, &p) in row.iter_mut().zip(&source[from..from + width]) {
                *o += tap * p;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equals_the_definition() {
        let (h, w) = (13, 17);
        let mask: Vec<bool> = (0..h * w).map(|k| (k * 7919 + k * k * 31) % 11 < 4).collect();
        let fast = signed_distance(&mask, h, w, 0.0);
        for (k, &d) in fast.iter().enumerate() {
            let nearest = (0..h * w)
                .filter(|&j| mask[j] != mask[k])
                .map(|j| {
                    let (dy, dx) = ((j / w).abs_diff(k / w), (j % w).abs_diff(k % w));
                    ((dy * dy + dx * dx) as f32).sqrt()
                })
                .fold(f32::INFINITY, f32::min);
            let expected = if mask[k] { 0.5 - nearest } else { nearest - 0.5 };
            assert!((d - expected).abs() < 1e-4, "pixel {k}: {d} for {expected}");
        }
    }

    #[test]
    fn a_disc_is_found_between_the_pixels() {
        // The zero level along the row through the centre, against the true radius.
        let (n, radius) = (64usize, 20.3f32);
        let mask: Vec<bool> = (0..n * n)
            .map(|k| {
                let (y, x) = ((k / n) as f32 + 0.5 - 32.0, (k % n) as f32 + 0.5 - 32.0);
                x * x + y * y < radius * radius
            })
            .collect();
        let d = signed_distance(&mask, n, n, 1.0);
        let mean = (0..n * n)
            .filter(|&k| d[k].abs() < 2.0)
            .map(|k| {
                let (y, x) = ((k / n) as f32 + 0.5 - 32.0, (k % n) as f32 + 0.5 - 32.0);
                (x * x + y * y).sqrt() - radius - d[k]
            })
            .fold((0.0, 0), |(s, c), e| (s + e, c + 1));
        assert!((mean.0 / mean.1 as f32).abs() < 0.1, "bias {}", mean.0 / mean.1 as f32);
    }

    /// Where strips end that are this many pixels wide, from their middle.
    fn half_width(strip: usize, distance: impl Fn(&[bool], usize, usize) -> Vec<f32>) -> f32 {
        let (height, width) = (8, 32);
        let mask: Vec<bool> =
            (0..height * width).map(|k| (12..12 + strip).contains(&(k % width))).collect();
        let d = distance(&mask, height, width);
        let row = &d[4 * width..5 * width];
        let out = (12..width).find(|&c| row[c] > 0.0 && c >= 12 + strip / 2).unwrap_or(width);
        let (before, after) = (row[out - 1], row[out]);
        out as f32 - 1.0 + before / (before - after) + 0.5 - (12.0 + 0.5 * strip as f32)
    }

    #[test]
    fn a_thin_strip_keeps_its_width() {
        for strip in [2, 3, 4, 6] {
            let exact = 0.5 * strip as f32;
            let found = half_width(strip, |m, h, w| unbiased_distance(m, h, w, 1.0));
            assert!((found - exact).abs() < 0.12, "{found} for {exact}");
        }
        // The blur alone takes a third of it.
        assert!(half_width(2, |m, h, w| signed_distance(m, h, w, 1.0)) < 0.7);
    }

    #[test]
    fn one_kind_alone_stays_finite() {
        for kind in [true, false] {
            let d = signed_distance(&[kind; 12], 3, 4, 1.0);
            assert!(d.iter().all(|v| v.is_finite() && (*v < 0.0) == kind));
        }
    }
}
