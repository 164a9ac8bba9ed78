//! The convolutional encoder of the img2mesh paper.

use autodiff_lite::{Activation, ConvGeometry, PoolGeometry, Real, Var, impl_module};

use crate::backbones::vgg;
use crate::{Conv2d, Indexed, Init};

/// The first three blocks of VGG16 and four more convolutions that narrow its 256 channels to
/// one: the encoder of the *CNN* model of img2mesh.
///
/// ```text
/// features   64 64 M 128 128 M 256 256 256 M          [N, H, W, 3] -> [N, H / 8, W / 8, 256]
/// narrow     3x3: 256 -> 64 -> 16 -> 4 -> 1, leaky ReLU of slope 0.01, flattened   -> [N, H W / 64]
/// ```
///
/// As published images of 1024 pixels are first resized to 256, bilinearly, which gives 1024
/// features. All of it is trained; `features` may start from torchvision's VGG16
/// ([`LoadWeights::partial`](crate::LoadWeights::partial)).
///
/// ```
/// use autodiff_lite::Tape;
/// use nets::{ConvFrontEnd, Init};
///
/// let encoder = ConvFrontEnd::<f32>::new(&Init::new(0).at("encoder"));
/// let tape = Tape::eval();
/// let images = tape.constant(ndarray::Array4::zeros((2, 32, 32, 3)));
/// assert_eq!(encoder.forward(images).shape(), [2, ConvFrontEnd::<f32>::width(32, 32)]);
/// ```
#[derive(Clone, Debug)]
pub struct ConvFrontEnd<F: Real = f32> {
    /// The convolutions of VGG16 before its third pool: `features.0` to `features.14`.
    pub features: Indexed<Conv2d<F>>,
    /// The narrowing convolutions.
    pub narrow: Vec<Conv2d<F>>,
    /// What images are divided by in size before anything else; 4 as published, 1 for none.
    pub downscale: usize,
}
impl_module!(ConvFrontEnd { features, narrow } fixed { downscale });

const CHANNELS: [usize; 5] = [256, 64, 16, 4, 1];
pub(crate) const BLOCKS: [usize; 3] = [2, 2, 3];
pub(crate) const LEAK: Activation = Activation::LeakyRelu(0.01);

impl<F: Real> ConvFrontEnd<F> {
    /// Without resizing; torchvision's initial values for `features`, PyTorch's for the rest.
    pub fn new(init: &Init) -> Self {
        let (same, at) = (ConvGeometry::new().padding(1), init.at("narrow"));
        let conv = |i: usize| Conv2d::new(&at.index(i), CHANNELS[i], CHANNELS[i + 1], 3, same);
        Self {
            features: vgg::convolutions(&init.at("features"), BLOCKS.len()),
            narrow: (0..CHANNELS.len() - 1).map(conv).collect(),
            downscale: 1,
        }
    }

    /// The number of features of an image of this size, as it is after resizing.
    pub fn width(height: usize, width: usize) -> usize {
        (height / 8) * (width / 8)
    }

    /// Features of images.
    ///
    /// # Shapes
    /// `x [N, H, W, 3]` → `[N, D]`, `D` being [`width`](Self::width) of the sides that the image has after
    /// [`downscale`](Self::downscale).
    #[track_caller]
    pub fn forward<'t>(&self, x: Var<'t, F>) -> Var<'t, F> {
        let [n, h, w, _] = x.dims();
        let (h, w) = (h / self.downscale.max(1), w / self.downscale.max(1));
        let mut x = if self.downscale > 1 { x.resize_bilinear(h, w, false) } else { x };
        let mut layers = self.features.iter();
        for block in BLOCKS {
            for conv in layers.by_ref().take(block) {
                x = conv.forward_then(x, Activation::Relu);
            }
            x = x.max_pool2d(PoolGeometry::square(2));
        }
        let x = self.narrow.iter().fold(x, |x, conv| conv.forward_then(x, LEAK));
        x.reshape(&[n, Self::width(h, w)])
    }
}

#[cfg(test)]
mod tests {
    use autodiff_lite::{Module, Tape};
    use ndarray::Array4;

    use super::*;

    #[test]
    fn the_published_sizes() {
        let mut encoder = ConvFrontEnd::<f32>::new(&Init::new(0));
        assert_eq!(ConvFrontEnd::<f32>::width(256, 256), 1024);
        // VGG16 up to its third pool has 1,735,488; the narrowing ones 147,520 + 9,232 + 580 + 37.
        assert_eq!(encoder.parameter_count(), 1_735_488 + 157_369);
        encoder.downscale = 4;
        let tape = Tape::eval();
        let y = encoder.forward(tape.constant(Array4::zeros((1, 96, 64, 3))));
        assert_eq!(y.shape(), [1, 3 * 2]);
    }
}
