//! Resampling: area average where an axis shrinks, bilinear where it grows.

use super::{ByteImage, Image, Pixels};

impl<T> Pixels<T> {
    /// Height and width of the image made small: its longer side has at most `longest` pixels, the other what its shape asks for,
    /// rounded and at least one. A size within that stays what it is.
    ///
    /// ```
    /// use mesh_core::ByteImage;
    /// let image = ByteImage::new(30, 40, 3);
    /// let [height, width] = image.size_within(20);
    /// assert_eq!([height, width], [15, 20]);
    /// assert_eq!(image.resized(height, width).size_within(20), [15, 20]);
    /// ```
    pub fn size_within(&self, longest: usize) -> [usize; 2] {
        let (size, side) = ([self.height, self.width], self.height.max(self.width));
        if side <= longest {
            return size;
        }
        size.map(|n| ((n * longest + side / 2) / side).max(1))
    }
}

impl Image {
    /// The image at another size: area average where an axis shrinks, bilinear where it grows.
    ///
    /// Values are averaged as they stand, sRGB included, which is what image libraries do.
    ///
    /// # Panics
    /// If either image is empty.
    #[must_use]
    pub fn resized(&self, height: usize, width: usize) -> Self {
        let data = resize(&self.data, [self.height, self.width, self.channels], height, width);
        Self { height, width, channels: self.channels, data }
    }
}

impl ByteImage {
    /// The image at another size, as [`Image::resized`], each value rounded to the nearest byte.
    ///
    /// # Panics
    /// If either image is empty.
    #[must_use]
    pub fn resized(&self, height: usize, width: usize) -> Self {
        let floats: Vec<f32> = self.data.iter().map(|&b| f32::from(b)).collect();
        let data = resize(&floats, [self.height, self.width, self.channels], height, width);
        let data = data.into_iter().map(|v| (v + 0.5) as u8).collect();
        Self { height, width, channels: self.channels, data }
    }
}

/// What one output sample is made of: input samples `first..first + weights.len()`.
struct Taps {
    first: usize,
    weights: Vec<f32>,
}

fn taps(from: usize, to: usize) -> Vec<Taps> {
    let scale = from as f64 / to as f64;
    let tap = |k: usize| {
        if to < from {
            let (start, end) = (k as f64 * scale, ((k + 1) as f64 * scale).min(from as f64));
            let first = start as usize;
            let last = (end.ceil() as usize).clamp(first + 1, from);
            let weights = (first..last)
                .map(|i| (((i + 1) as f64).min(end) - (i as f64).max(start)).max(0.0) / scale)
                .map(|w| w as f32)
                .collect();
            Taps { first, weights }
        } else {
            let x = ((k as f64 + 0.5) * scale - 0.5).clamp(0.0, (from - 1) as f64);
            let first = (x as usize).min(from.saturating_sub(2));
            let t = (x - first as f64) as f32;
            let weights = if from == 1 { vec![1.0] } else { vec![1.0 - t, t] };
            Taps { first, weights }
        }
    };
    (0..to).map(tap).collect()
}

fn resize(data: &[f32], shape: [usize; 3], height: usize, width: usize) -> Vec<f32> {
    let [rows, columns, channels] = shape;
    assert!(
        rows * columns > 0 && height * width > 0,
        "resized: from {columns} x {rows} to {width} x {height}, expected at least one pixel"
    );
    // Rows first: the first pass then runs along whole rows, and shrinks what the second reads.
    let line = columns * channels;
    let mut tall = vec![0.0; height * line];
    for (tap, out) in taps(rows, height).iter().zip(tall.chunks_exact_mut(line.max(1))) {
        for (w, row) in tap.weights.iter().zip(data[tap.first * line..].chunks_exact(line.max(1))) {
            for (o, v) in out.iter_mut().zip(row) {
                *o += w * v;
            }
        }
    }
    let across = taps(columns, width);
    let mut result = Vec::with_capacity(height * width * channels);
    for row in tall.chunks_exact(line.max(1)) {
        for tap in &across {
            for c in 0..channels {
                let sample = |(k, w): (usize, &f32)| w * row[(tap.first + k) * channels + c];
                result.push(tap.weights.iter().enumerate().map(sample).sum());
            }
        }
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn halving_is_the_mean_of_four() {
        let image =
            ByteImage { height: 2, width: 4, channels: 1, data: vec![0, 4, 8, 8, 4, 8, 0, 0] };
        assert_eq!(image.resized(1, 2).data, [4, 4]);
    }

    #[test]
    fn doubling_is_bilinear_about_pixel_centers() {
        let image = Image { height: 1, width: 2, channels: 1, data: vec![0.0, 1.0] };
        assert_eq!(image.resized(1, 4).data, [0.0, 0.25, 0.75, 1.0]);
    }

    #[test]
    fn a_size_within_a_side_keeps_its_shape_and_has_a_pixel_each_way() {
        let within = |height: usize, width: usize| ByteImage::new(height, width, 1).size_within(10);
        assert_eq!([within(10, 4), within(3, 9)], [[10, 4], [3, 9]]);
        // To the nearest: 3.5 of the one, 3.33 of the other.
        assert_eq!([within(20, 7), within(10, 30)], [[10, 4], [3, 10]]);
        assert_eq!(within(1, 300), [1, 10]);
        assert_eq!(ByteImage::default().size_within(0), [0, 0]);
    }

    proptest! {
        #[test]
        fn a_constant_stays_constant_and_a_mean_is_kept(
            h in 1..9_usize, w in 1..9_usize, to_h in 1..9_usize, to_w in 1..9_usize, v in 0.0..1.0_f32,
            seed in any::<u32>(),
        ) {
            let flat = Image { height: h, width: w, channels: 2, data: vec![v; h * w * 2] };
            for x in flat.resized(to_h, to_w).data {
                prop_assert!((x - v).abs() < 1e-6);
            }
            // Area averages over both axes keep the mean.
            let (sh, sw) = (to_h.min(h), to_w.min(w));
            let data: Vec<f32> =
                (0..h * w).map(|i| ((i as u32).wrapping_mul(seed) % 97) as f32 / 97.0).collect();
            let image = Image { height: h, width: w, channels: 1, data };
            let mean = |i: &Image| i.data.iter().sum::<f32>() / i.data.len() as f32;
            prop_assert!((mean(&image) - mean(&image.resized(sh, sw))).abs() < 1e-5);
            prop_assert_eq!(image.resized(h, w), image);
        }
    }
}
