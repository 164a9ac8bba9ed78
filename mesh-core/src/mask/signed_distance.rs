//! Signed distance to the edge of a mask, between its pixels.

use super::Mask;
use crate::Image;

impl Mask {
    /// Signed distance of every pixel centre to the mask's edge, in pixels, `[H, W, 1]`: negative inside.
    ///
    /// The distance is the exact Euclidean one to the nearest pixel of the other kind, less the half
    /// pixel to that pixel's border. A straight edge sampled at pixel centres leaves a staircase whose
    /// mean is the edge itself, so a [blur](Image::blur) of `sigma` pixels turns this into an unbiased estimate of
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
    /// If `data` is not `height * width` long.
    pub fn signed_distance(&self, sigma: f32) -> Image {
        let (height, width) = (self.height, self.width);
        assert_eq!(
            self.data.len(),
            height * width,
            "mask [{}] for {height} x {width}",
            self.data.len()
        );
        let far = (height + width) as f32;
        let mut data = self.squared_distance(true);
        let inside = self.squared_distance(false);
        for (signed, inside) in data.iter_mut().zip(inside) {
            *signed = if *signed > 0.0 {
                (signed.sqrt() - 0.5).min(far)
            } else {
                (0.5 - inside.sqrt()).max(-far)
            };
        }
        let mut distance = Image { height, width, channels: 1, data };
        distance.blur(sigma);
        distance
    }

    /// Squared distance to the nearest pixel that equals `kind`, 0 there; huge where there is none.
    fn squared_distance(&self, kind: bool) -> Vec<f32> {
        const NONE: f32 = 1e12;
        let (height, width) = (self.height, self.width);
        let mut grid: Vec<f32> =
            self.data.iter().map(|&m| if m == kind { 0.0 } else { NONE }).collect();
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
}

/// The lower envelope of the parabolas `(x - q)^2 + f(q)`.
struct Envelope {
    apex: Vec<usize>,
    /// In doubles: squares of columns beyond 4096 are no floats.
    start: Vec<f64>,
}

impl Envelope {
    fn new(longest: usize) -> Self {
        Self { apex: vec![0; longest.max(1)], start: vec![0.0; longest + 1] }
    }

    fn transform(&mut self, f: &[f32], out: &mut [f32]) {
        if f.is_empty() {
            return;
        }
        let square = |q: usize| (q * q) as f64;
        let mut last = 0;
        self.apex[0] = 0;
        self.start[0] = f64::NEG_INFINITY;
        for q in 1..f.len() {
            loop {
                let p = self.apex[last];
                let raised = |q: usize| f64::from(f[q]) + square(q);
                let meet = (raised(q) - raised(p)) / (2.0 * (q - p) as f64);
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
            while k < last && self.start[k + 1] < x as f64 {
                k += 1;
            }
            let d = x as f32 - self.apex[k] as f32;
            *o = d * d + f[self.apex[k]];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equals_the_definition() {
        let (h, w) = (13, 17);
        let data: Vec<bool> = (0..h * w).map(|k| (k * 7919 + k * k * 31) % 11 < 4).collect();
        let mask = Mask { height: h, width: w, data };
        for (k, &d) in mask.signed_distance(0.0).data.iter().enumerate() {
            let nearest = (0..h * w)
                .filter(|&j| mask.data[j] != mask.data[k])
                .map(|j| {
                    let (dy, dx) = ((j / w).abs_diff(k / w), (j % w).abs_diff(k % w));
                    ((dy * dy + dx * dx) as f32).sqrt()
                })
                .fold(f32::INFINITY, f32::min);
            let expected = if mask.data[k] { 0.5 - nearest } else { nearest - 0.5 };
            assert!((d - expected).abs() < 1e-4, "pixel {k}: {d} for {expected}");
        }
    }

    #[test]
    fn a_disc_is_found_between_the_pixels() {
        // The zero level along the row through the centre, against the true radius.
        let (n, radius) = (64_usize, 20.3_f32);
        let away = |i: usize, j: usize| (j as f32 - 31.5).hypot(i as f32 - 31.5);
        let disc = Mask::from_fn(n, n, |i, j| away(i, j) < radius);
        let d = disc.signed_distance(1.0).data;
        let mean = (0..n * n)
            .filter(|&k| d[k].abs() < 2.0)
            .map(|k| away(k / n, k % n) - radius - d[k])
            .fold((0.0, 0), |(s, c), e| (s + e, c + 1));
        assert!((mean.0 / mean.1 as f32).abs() < 0.1, "bias {}", mean.0 / mean.1 as f32);
    }

    /// Squares of columns beyond 4096 are no floats.
    #[test]
    fn long_rows_are_exact() {
        let row = Mask::from_fn(1, 9000, |_, j| j % 4 == 3);
        let expected = |j: usize| [0.5, 1.5, 0.5, -0.5][j % 4];
        let distance = row.signed_distance(0.0).data;
        assert!((0..8999).all(|j| j < 3 || distance[j] == expected(j)));
        let f: Vec<f32> = (0..9000).map(|q| ((q * 7919) % 40) as f32).collect();
        let mut out = vec![0.0; f.len()];
        Envelope::new(f.len()).transform(&f, &mut out);
        for (x, found) in out.iter().enumerate() {
            let near = x.saturating_sub(7)..(x + 8).min(f.len());
            let least = near.map(|q| x.abs_diff(q).pow(2) as f32 + f[q]).fold(f32::MAX, f32::min);
            assert_eq!(*found, least, "{x}");
        }
    }

    #[test]
    fn one_kind_alone_stays_finite() {
        for kind in [true, false] {
            let d = Mask::from_fn(3, 4, |_, _| kind).signed_distance(1.0);
            assert!(d.data.iter().all(|v| v.is_finite() && (*v < 0.0) == kind));
        }
    }
}
