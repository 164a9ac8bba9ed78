//! Gaussian blur.

use super::Image;

impl Image {
    /// Blurs in place by a Gaussian of `sigma` pixels, the border repeated beyond it; does nothing for `sigma <= 0`.
    ///
    /// # Cost
    /// `O(values * sigma)`: along rows, then along columns, to three `sigma` on each side.
    pub fn blur(&mut self, sigma: f32) {
        let [height, width, channels] = self.shape();
        if sigma <= 0.0 || self.data.is_empty() {
            return;
        }
        let radius = (3.0 * sigma).ceil() as usize;
        let taps = taps(sigma, radius);
        let (line, side) = (width * channels, radius * channels);
        let mut padded = vec![0.0; line + 2 * side];
        for row in self.data.chunks_exact_mut(line) {
            for k in 0..side {
                padded[k] = row[k % channels];
                padded[side + line + k] = row[line - channels + k % channels];
            }
            padded[side..side + line].copy_from_slice(row);
            row.fill(0.0);
            for (k, &tap) in taps.iter().enumerate() {
                for (o, &p) in row.iter_mut().zip(&padded[k * channels..]) {
                    *o += tap * p;
                }
            }
        }
        let source = self.data.clone();
        for (i, row) in self.data.chunks_exact_mut(line).enumerate() {
            row.fill(0.0);
            for (k, &tap) in taps.iter().enumerate() {
                let from = (i + k).saturating_sub(radius).min(height - 1) * line;
                for (o, &p) in row.iter_mut().zip(&source[from..from + line]) {
                    *o += tap * p;
                }
            }
        }
    }
}

/// The Gaussian at whole pixels up to a radius on each side; they sum to 1.
fn taps(sigma: f32, radius: usize) -> Vec<f32> {
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
    taps
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_are_blurred_apart_and_each_keeps_its_sum() {
        let point = |i: usize, j: usize| f32::from(u8::from(i == 6 && j == 5));
        let mut both = Image::new(13, 11, 2);
        for k in 0..13 * 11 {
            both.data[2 * k] = point(k / 11, k % 11);
            both.data[2 * k + 1] = 0.5;
        }
        let data = (0..13 * 11).map(|k| point(k / 11, k % 11)).collect();
        let mut one = Image { height: 13, width: 11, channels: 1, data };
        both.blur(1.0);
        one.blur(1.0);
        for (pair, &one) in both.data.as_chunks::<2>().0.iter().zip(&one.data) {
            assert_eq!(pair[0], one);
            assert!((pair[1] - 0.5).abs() < 1e-6);
        }
        assert!((one.data.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        // The ratio of neighbours of a Gaussian of deviation 1.
        let ratio = one.data[6 * 11 + 6] / one.data[6 * 11 + 5];
        assert!((ratio - (-0.5_f32).exp()).abs() < 1e-6);
    }
}
