//! What depth estimators expect of an image, and what becomes of their answer.

use mesh_core::{ByteImage, DisparityMap};

/// How the size of an image is brought near the one that an estimator was trained at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SizeFit {
    /// The longer side becomes `side`; the shape is kept.
    Within,
    /// The shorter side becomes `side`; the shape is kept.
    Covering,
    /// The side that has to change less becomes `side`; the shape is kept.
    Nearest,
    /// Both sides become `side`, whatever the shape.
    Square,
}

/// The published pre- and post-processing of a monocular depth estimator.
///
/// ```
/// use datasets::DepthInput;
/// // An image of 640 x 480: MiDaS small sees it at 256 x 192, Depth Anything at 686 x 518.
/// assert_eq!(DepthInput::midas_small().size(480, 640), [192, 256]);
/// assert_eq!(DepthInput::depth_anything().size(480, 640), [518, 686]);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthInput {
    /// The side in pixels that the estimator was trained at.
    pub side: usize,
    /// Both sides become multiples of this.
    pub multiple: usize,
    /// Which of the sides becomes `side`.
    pub fit: SizeFit,
    /// What is taken from red, green and blue in `[0, 1]`.
    pub mean: [f32; 3],
    /// What they are divided by then.
    pub deviation: [f32; 3],
    /// How the answer is brought back to the size of the image: bilinear between the centres of the corner
    /// pixels (Depth Anything) or else bicubic (MiDaS).
    pub aligned_corners: bool,
}

/// The statistics of ImageNet.
const IMAGENET: ([f32; 3], [f32; 3]) = ([0.485, 0.456, 0.406], [0.229, 0.224, 0.225]);

impl DepthInput {
    /// MiDaS 2.1 small (`midas_v21_small_256`): 256 pixels.
    pub fn midas_small() -> Self {
        Self { side: 256, ..Self::midas() }
    }

    /// MiDaS 2.1 (`midas_v21_384`): 384 pixels, multiples of 32.
    pub fn midas() -> Self {
        let (mean, deviation) = IMAGENET;
        let fit = SizeFit::Within;
        Self { side: 384, multiple: 32, fit, mean, deviation, aligned_corners: false }
    }

    /// MiDaS 3, the dense prediction transformers (`dpt_large_384`, `dpt_hybrid_384`): values in [-1, 1].
    pub fn midas_dpt() -> Self {
        let half = [0.5; 3];
        Self { fit: SizeFit::Nearest, mean: half, deviation: half, ..Self::midas() }
    }

    /// Depth Anything, versions 1 and 2: 518 pixels, multiples of 14.
    pub fn depth_anything() -> Self {
        let fit = SizeFit::Covering;
        Self { side: 518, multiple: 14, fit, aligned_corners: true, ..Self::midas() }
    }

    /// Rows and columns that an image of this size is given to the estimator in.
    ///
    /// The nearest multiples, but none beyond `side` where the image must fit within it, and none below
    /// where it must cover it.
    ///
    /// # Panics
    /// If the image has no pixels.
    pub fn size(&self, height: usize, width: usize) -> [usize; 2] {
        assert!(height * width > 0, "DepthInput: an image of {height} x {width} pixels");
        let side = self.side as f64;
        let scales = [side / height as f64, side / width as f64];
        let [low, high] = [scales[0].min(scales[1]), scales[0].max(scales[1])];
        let one = match self.fit {
            SizeFit::Within => low,
            SizeFit::Covering => high,
            SizeFit::Nearest if (1.0 - scales[1]).abs() < (1.0 - scales[0]).abs() => scales[1],
            SizeFit::Nearest => scales[0],
            SizeFit::Square => return [self.rounded(side), self.rounded(side)],
        };
        [height, width].map(|n| self.rounded(one * n as f64))
    }

    /// A multiple near a length.
    fn rounded(&self, length: f64) -> usize {
        let (multiple, side) = (self.multiple as f64, self.side as f64);
        let mut rounded = (length / multiple).round_ties_even() * multiple;
        if self.fit == SizeFit::Within && rounded > side {
            rounded = (length / multiple).floor() * multiple;
        }
        if self.fit == SizeFit::Covering && rounded < side {
            rounded = (length / multiple).ceil() * multiple;
        }
        (rounded as usize).max(self.multiple)
    }

    /// The image as the estimator sees it, `[3, height, width]`: bicubic to that size, less the mean, over
    /// the deviation. Grey is repeated; where there is alpha, give [`ByteImage::over`] a background first.
    ///
    /// # Panics
    /// If either has no pixels.
    pub fn prepare(&self, image: &ByteImage, [height, width]: [usize; 2]) -> Vec<f32> {
        let rgb = image.to_rgb();
        let values: Vec<f32> = rgb.data.iter().map(|&b| f32::from(b) / 255.0).collect();
        let sized = resample(&values, [rgb.height, rgb.width, 3], [height, width], cubic);
        let channel = |c: usize| {
            let (mean, deviation) = (self.mean[c], self.deviation[c]);
            sized.iter().skip(c).step_by(3).map(move |v| (v - mean) / deviation)
        };
        (0..3).flat_map(channel).collect()
    }

    /// The answer of the estimator, `[rows, columns]`, at the size of the image.
    ///
    /// # Panics
    /// If either has no pixels, or the values are not as many as rows times columns.
    pub fn restore(
        &self,
        values: &[f32],
        [rows, columns]: [usize; 2],
        [height, width]: [usize; 2],
    ) -> DisparityMap {
        let taps = if self.aligned_corners { between_corners } else { cubic };
        let data = resample(values, [rows, columns, 1], [height, width], taps);
        DisparityMap { height, width, data }
    }
}

/// The samples that an output is made of, with their weights; beyond the ends the last one is repeated.
type Taps = [(usize, f32); 4];

/// Bicubic with `a = -3/4`, pixel centres at half integers, without antialiasing: `INTER_CUBIC` of OpenCV and
/// `bicubic` of PyTorch.
fn cubic(k: usize, from: usize, to: usize) -> Taps {
    const A: f64 = -0.75;
    let source = (k as f64 + 0.5) * from as f64 / to as f64 - 0.5;
    let first = source.floor();
    let weight = |x: f64| {
        let x = x.abs();
        if x <= 1.0 {
            ((A + 2.0) * x - (A + 3.0)) * x * x + 1.0
        } else {
            ((A * x - 5.0 * A) * x + 8.0 * A) * x - 4.0 * A
        }
    };
    std::array::from_fn(|i| {
        let at = first + i as f64 - 1.0;
        (at.clamp(0.0, (from - 1) as f64) as usize, weight(source - at) as f32)
    })
}

/// Bilinear, the centres of the first and last pixel on those of the other.
fn between_corners(k: usize, from: usize, to: usize) -> Taps {
    let source = if to > 1 { k as f64 * (from - 1) as f64 / (to - 1) as f64 } else { 0.0 };
    let first = (source as usize).min(from - 1);
    let weight = (source - first as f64) as f32;
    [(first, 1.0 - weight), ((first + 1).min(from - 1), weight), (0, 0.0), (0, 0.0)]
}

/// `[rows, columns, channels]` to `[height, width, channels]`.
fn resample(
    values: &[f32],
    [rows, columns, channels]: [usize; 3],
    [height, width]: [usize; 2],
    taps: fn(usize, usize, usize) -> Taps,
) -> Vec<f32> {
    assert!(
        values.len() == rows * columns * channels && !values.is_empty() && height * width > 0,
        "resample: {} values of {rows} x {columns} x {channels} to {height} x {width}",
        values.len()
    );
    let stride = width * channels;
    let mut wide = vec![0.0; rows * stride];
    for j in 0..width {
        for (at, weight) in taps(j, columns, width) {
            for i in 0..rows {
                let from = &values[(i * columns + at) * channels..][..channels];
                let to = &mut wide[i * stride + j * channels..][..channels];
                to.iter_mut().zip(from).for_each(|(to, from)| *to += weight * from);
            }
        }
    }
    let mut out = vec![0.0; height * stride];
    for (i, row) in out.chunks_exact_mut(stride).enumerate() {
        for (at, weight) in taps(i, rows, height) {
            let from = &wide[at * stride..][..stride];
            row.iter_mut().zip(from).for_each(|(to, from)| *to += weight * from);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// What the published code gives, worked out by hand from its rules.
    #[test]
    fn sizes_as_published() {
        let (small, large) = (DepthInput::midas_small(), DepthInput::midas());
        let (dpt, anything) = (DepthInput::midas_dpt(), DepthInput::depth_anything());
        // 137 x 137, a rendering of 3D-R2N2.
        assert_eq!(small.size(137, 137), [256, 256]);
        assert_eq!(anything.size(137, 137), [518, 518]);
        // 1080 x 1920: 256 / 1920 makes 144 of 1080, 4.5 times 32, which goes to the even 4.
        assert_eq!(small.size(1080, 1920), [128, 256]);
        assert_eq!(large.size(1080, 1920), [224, 384]);
        // The height changes less, so it becomes 384; 682.7 goes to 672.
        assert_eq!(dpt.size(1080, 1920), [384, 672]);
        // 518 / 1080 makes 920.9 of 1920: 65.8 times 14.
        assert_eq!(anything.size(1080, 1920), [518, 924]);
        assert_eq!(DepthInput { fit: SizeFit::Square, ..large }.size(100, 3), [384, 384]);
        // A sliver keeps at least one multiple.
        assert_eq!(small.size(4, 4000), [32, 256]);
    }

    #[test]
    fn values_are_normalized_channel_by_channel() {
        let data = [255, 0, 51].repeat(12);
        let picture = ByteImage { height: 3, width: 4, channels: 3, data };
        let input = DepthInput::midas();
        let found = input.prepare(&picture, [32, 64]);
        assert_eq!(found.len(), 3 * 32 * 64);
        for (c, value) in [1.0, 0.0, 0.2_f32].into_iter().enumerate() {
            let expected = (value - IMAGENET.0[c]) / IMAGENET.1[c];
            let channel = &found[c * 2048..(c + 1) * 2048];
            assert!(channel.iter().all(|v| (v - expected).abs() < 1e-5));
        }
    }

    /// Weights by hand: halfway between two samples, cubic is -3/32, 19/32, 19/32, -3/32.
    #[test]
    fn cubic_by_hand() {
        let found = resample(&[0.0, 0.0, 32.0, 0.0, 0.0, 0.0], [1, 6, 1], [1, 3], cubic);
        assert_eq!(found, [-3.0, 19.0, 0.0]);
        let same = resample(&[3.0, 1.0, 4.0, 1.0], [2, 2, 1], [2, 2], cubic);
        assert_eq!(same, [3.0, 1.0, 4.0, 1.0]);
    }

    #[test]
    fn corners_stay_where_they_are() {
        let found = resample(&[1.0, 2.0, 3.0, 5.0], [2, 2, 1], [3, 3], between_corners);
        assert_eq!(found, [1.0, 1.5, 2.0, 2.0, 2.75, 3.5, 3.0, 4.0, 5.0]);
        let one = resample(&[1.0, 2.0, 3.0, 5.0], [2, 2, 1], [1, 1], between_corners);
        assert_eq!(one, [1.0]);
    }

    proptest! {
        #[test]
        fn sizes_are_multiples_on_the_right_side(h in 1usize..3000, w in 1usize..3000) {
            for input in [DepthInput::midas_small(), DepthInput::midas(), DepthInput::midas_dpt(), DepthInput::depth_anything()] {
                let size = input.size(h, w);
                prop_assert!(size.iter().all(|n| n % input.multiple == 0 && *n > 0));
                match input.fit {
                    SizeFit::Within => prop_assert!(size.iter().all(|&n| n <= input.side)),
                    SizeFit::Covering => prop_assert!(size.iter().all(|&n| n >= input.side)),
                    _ => {}
                }
            }
        }

        /// Away from the border derivatives stay, but for the twentieth of a pixel's step by which this kernel bends them.
        #[test]
        fn derivatives_stay(from in 6usize..20, to in 6usize..40, a in -2.0f32..2.0, b in -2.0f32..2.0) {
            let line: Vec<f32> = (0..from).map(|i| a + b * (i as f32 + 0.5) / from as f32).collect();
            let found = resample(&line, [1, from, 1], [1, to], cubic);
            for (k, value) in found.iter().enumerate() {
                let at = (k as f32 + 0.5) / to as f32;
                if (2.0..from as f32 - 2.0).contains(&(at * from as f32)) {
                    let bend = 0.05 * b.abs() / from as f32;
                    prop_assert!((value - (a + b * at)).abs() < bend + 1e-4);
                }
            }
        }
    }
}
