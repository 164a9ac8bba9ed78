//! What networks that find objects expect of an image, and what becomes of their answer.

use mesh_core::{ByteImage, Image};

/// How red, green and blue are brought to about `[0, 1]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PixelScale {
    /// 255 becomes 1.
    Full,
    /// The brightest value of the image becomes 1.
    Brightest,
}

/// How what a network says of a pixel becomes a share of the object, 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MaskScale {
    /// The least becomes 0 and the greatest 1.
    MinMax,
    /// The logistic function: the network gives logits.
    Sigmoid,
}

/// The published pre- and post-processing of a network that parts an object from its background.
///
/// | | size | pixels | answer |
/// |---|---|---|---|
/// | [`u2net`](Self::u2net) | 320 | over the brightest, ImageNet's statistics | first output, least to greatest |
/// | [`isnet`](Self::isnet) | 1024 | over 255, less 0.5 | first output, least to greatest |
/// | [`birefnet`](Self::birefnet) | 1024 | over 255, ImageNet's statistics | last output, logistic function |
///
/// ```
/// use datasets::MaskInput;
/// assert_eq!(MaskInput::u2net().side, 320);
/// assert_eq!(MaskInput::isnet().mean, [0.5; 3]);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MaskInput {
    /// Rows and columns in pixels, whatever the shape of the image.
    pub side: usize,
    /// What is 1 before mean and deviation.
    pub scale: PixelScale,
    /// What is taken from red, green and blue.
    pub mean: [f32; 3],
    /// What they are divided by then.
    pub deviation: [f32; 3],
    /// Whether the last of several outputs is the answer instead of the first.
    pub last_output: bool,
    /// What the answer means.
    pub answer: MaskScale,
}

impl MaskInput {
    /// U²-Net and its small form (Qin et al., "U²-Net: Going deeper with nested U-structure for salient object detection",
    /// Pattern Recognition 106, 2020), as `u2net_test.py` and `data_loader.py` of <https://github.com/xuebinqin/U-2-Net> have
    /// it: `RescaleT(320)`, `ToTensorLab(flag=0)`, then `normPRED` of the first of seven outputs.
    pub fn u2net() -> Self {
        Self {
            side: 320,
            scale: PixelScale::Brightest,
            mean: [0.485, 0.456, 0.406],
            deviation: [0.229, 0.224, 0.225],
            last_output: false,
            answer: MaskScale::MinMax,
        }
    }

    /// IS-Net (Qin et al., "Highly accurate dichotomous image segmentation", ECCV 2022), as `Inference.py` of
    /// <https://github.com/xuebinqin/DIS> has it: 1024 x 1024, `normalize(image / 255, [0.5] * 3, [1.0] * 3)`, least to
    /// greatest of the first output.
    pub fn isnet() -> Self {
        let (mean, deviation) = ([0.5; 3], [1.0; 3]);
        Self { side: 1024, scale: PixelScale::Full, mean, deviation, ..Self::u2net() }
    }

    /// BiRefNet (Zheng et al., "Bilateral reference for high-resolution dichotomous image segmentation", CAAI AIR 3, 2024), as
    /// the README of <https://github.com/ZhengPeng7/BiRefNet> has it: 1024 x 1024, ImageNet's statistics, `sigmoid` of the last
    /// output.
    pub fn birefnet() -> Self {
        let (last_output, answer) = (true, MaskScale::Sigmoid);
        Self { side: 1024, scale: PixelScale::Full, last_output, answer, ..Self::u2net() }
    }

    /// The image as the network sees it, `[3, height, width]`, averaged down or interpolated between pixels. Grey is
    /// repeated; where there is alpha, give [`ByteImage::over`] a background first.
    ///
    /// # Panics
    /// If either has no pixels.
    pub fn prepare(&self, image: &ByteImage, [height, width]: [usize; 2]) -> Vec<f32> {
        let rgb = image.to_rgb().resized(height, width);
        let brightest = rgb.data.iter().copied().max().unwrap_or(0);
        let one = match self.scale {
            PixelScale::Full => 255.0,
            // A black image stays black.
            PixelScale::Brightest => f32::from(brightest.max(1)),
        };
        let channel = |c: usize| {
            let (mean, deviation) = (self.mean[c], self.deviation[c]);
            let values = rgb.data.iter().skip(c).step_by(3);
            values.map(move |&b| (f32::from(b) / one - mean) / deviation)
        };
        (0..3).flat_map(channel).collect()
    }

    /// The answer of the network, `[rows, columns]`, as the object's share of each pixel at the size of the image, `[H, W, 1]`.
    /// Numbers that are none count as background; where all are the same the object is nowhere.
    ///
    /// # Panics
    /// If either has no pixels, or the values are not as many as rows times columns.
    pub fn restore(
        &self,
        values: &[f32],
        [rows, columns]: [usize; 2],
        [height, width]: [usize; 2],
    ) -> Image {
        assert_eq!(values.len(), rows * columns, "MaskInput::restore: {rows} x {columns} values");
        let known = values.iter().copied().filter(|v| v.is_finite());
        let [low, high] =
            known.fold([f32::INFINITY, f32::NEG_INFINITY], |[a, b], v| [a.min(v), b.max(v)]);
        let share = |&v: &f32| match self.answer {
            _ if !v.is_finite() => 0.0,
            MaskScale::Sigmoid => 1.0 / (1.0 + (-v).exp()),
            MaskScale::MinMax if high > low => (v - low) / (high - low),
            MaskScale::MinMax => 0.0,
        };
        let data = values.iter().map(share).collect();
        Image { height: rows, width: columns, channels: 1, data }.resized(height, width)
    }
}

/// The mask that shares of the object give, 255 where at least half is.
pub fn mask_of_shares(shares: &Image) -> ByteImage {
    let data = shares.data.iter().map(|&v| if v >= 0.5 { 255 } else { 0 }).collect();
    ByteImage { height: shares.height, width: shares.width, channels: 1, data }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_are_normalized_as_published() {
        let data = [200, 100, 50].repeat(6);
        let picture = ByteImage { height: 2, width: 3, channels: 3, data };
        // By hand: 200 is the brightest, so red is 1 for U2-Net.
        for (input, wanted) in [
            (MaskInput::u2net(), [2.248_908, 0.196_429, -0.693_333]),
            (MaskInput::isnet(), [0.284_314, -0.107_843, -0.303_922]),
            (MaskInput::birefnet(), [1.307_047, -0.285_015, -0.932_985]),
        ] {
            let found = input.prepare(&picture, [4, 4]);
            assert_eq!(found.len(), 48);
            for (c, wanted) in wanted.into_iter().enumerate() {
                let channel = &found[16 * c..16 * (c + 1)];
                assert!(channel.iter().all(|v| (v - wanted).abs() < 1e-4), "{input:?} {found:?}");
            }
        }
        assert!(
            MaskInput::u2net()
                .prepare(&ByteImage::new(2, 2, 3), [2, 2])
                .iter()
                .all(|v| v.is_finite())
        );
    }

    #[test]
    fn answers_become_shares() {
        let values = [-2.0, 0.0, 2.0, f32::NAN];
        let found = MaskInput::isnet().restore(&values, [2, 2], [2, 2]);
        assert_eq!(found.data, [0.0, 0.5, 1.0, 0.0]);
        let found = MaskInput::birefnet().restore(&values, [2, 2], [2, 2]);
        assert!((found.data[0] - 0.119_203).abs() < 1e-5 && found.data[1] == 0.5);
        assert_eq!(mask_of_shares(&found).data, [0, 255, 255, 0]);
        assert_eq!(MaskInput::u2net().restore(&[7.0; 4], [2, 2], [3, 5]).data, [0.0; 15]);
    }
}
