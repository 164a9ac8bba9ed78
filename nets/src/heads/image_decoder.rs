//! From a small map to an image, by residual blocks and up-sampling.

use autodiff_lite::{Activation, ConvGeometry, Real, Var, impl_module};

use crate::{Conv2d, Init};

/// The slope of negative numbers.
pub(crate) const SLOPE: f64 = 0.2;

/// A residual block that activates before it convolves:
///
/// ```text
/// y = s(x) + conv_1(a(conv_0(a(x))))        a a leaky ReLU of slope 0.2, s a 1x1 convolution or nothing
/// ```
///
/// # References
/// He et al. 2016, *Identity mappings in deep residual networks*; the block of Park et al. 2019,
/// *Semantic image synthesis with spatially-adaptive normalization*, without its norm, and its names.
#[derive(Clone, Debug)]
pub struct PreactivatedBlock<F: Real = f32> {
    /// 3x3, to the smaller of both numbers of channels.
    pub conv_0: Conv2d<F>,
    /// 3x3.
    pub conv_1: Conv2d<F>,
    /// 1x1 without bias, where the number of channels changes.
    pub conv_s: Option<Conv2d<F>>,
}
impl_module!(PreactivatedBlock { conv_0, conv_1, conv_s });

impl<F: Real> PreactivatedBlock<F> {
    /// Weights begin with deviation 0.02, biases at 0, as in the published decoder.
    pub fn new(init: &Init, inputs: usize, outputs: usize) -> Self {
        let middle = inputs.min(outputs);
        let shortcut = || convolution(&init.at("conv_s"), inputs, outputs, 1).without_bias();
        Self {
            conv_0: convolution(&init.at("conv_0"), inputs, middle, 3),
            conv_1: convolution(&init.at("conv_1"), middle, outputs, 3),
            conv_s: (inputs != outputs).then(shortcut),
        }
    }

    /// Two convolutions, each behind a leaky ReLU, and a shortcut.
    ///
    /// # Shapes
    /// `x [N, H, W, inputs]` → `[N, H, W, outputs]`.
    #[track_caller]
    pub fn forward<'t>(&self, x: Var<'t, F>) -> Var<'t, F> {
        let active = x.leaky_relu(F::from_f64(SLOPE));
        let y = self.conv_0.forward_then(active, Activation::LeakyRelu(SLOPE));
        let shortcut = self.conv_s.as_ref().map_or(x, |conv| conv.forward(x));
        self.conv_1.forward(y).add(shortcut)
    }
}

/// A convolution that keeps the size, with the published decoder's initial values.
fn convolution<F: Real>(init: &Init, inputs: usize, outputs: usize, kernel: usize) -> Conv2d<F> {
    let geometry = ConvGeometry::new().padding(kernel / 2);
    Conv2d::normal(init, inputs, outputs, kernel, 0.02, geometry)
}

/// Blocks in order: name, inputs and outputs in units of the width, and whether the map is made twice
/// as large before (2: only where there are six such steps).
pub(crate) const BLOCKS: [(&str, usize, usize, u8); 7] = [
    ("head_0", 16, 16, 0),
    ("G_middle_0", 16, 16, 1),
    ("G_middle_1", 16, 16, 2),
    ("up_0", 16, 8, 1),
    ("up_1", 8, 4, 1),
    ("up_2", 4, 2, 1),
    ("up_3", 2, 1, 1),
];

/// A map to an image 64 times as large (or 32 times): the texture decoder of MCMR.
///
/// ```text
/// head_0 16-16, up, G_middle_0 16-16, up, G_middle_1 16-16, up, up_0 16-8, up, up_1 8-4, up, up_2 4-2, up, up_3 2-1
/// conv_img 3x3 to the outputs, sigmoid                 widths in units of `width`, up: bilinear, twice as large
/// ```
///
/// ```
/// use autodiff_lite::Tape;
/// use nets::{ImageDecoder, Init};
///
/// let decoder = ImageDecoder::<f32>::new(&Init::new(0), 1, 3);
/// let tape = Tape::eval();
/// let image = decoder.forward(tape.constant(ndarray::Array4::zeros((1, 1, 1, 16))));
/// assert_eq!(image.shape(), [1, 64, 64, 3]);
/// ```
///
/// # References
/// Park et al. 2019, *Semantic image synthesis with spatially-adaptive normalization*, the generator
/// without its norms, as in Simoni et al. 2021, *Multi-Category Mesh Reconstruction From Image
/// Collections*; names as there.
#[derive(Clone, Debug)]
pub struct ImageDecoder<F: Real = f32> {
    /// `head_0`, `G_middle_0`, `G_middle_1`, `up_0`, `up_1`, `up_2`, `up_3`.
    pub blocks: [PreactivatedBlock<F>; 7],
    /// 3x3, to the image.
    pub conv_img: Conv2d<F>,
    /// Six times twice as large, or five (then not before `G_middle_1`).
    pub six_steps: bool,
}

impl_module!(ImageDecoder lists { blocks: |i: usize| BLOCKS[i].0 } { conv_img } fixed { six_steps });

impl<F: Real> ImageDecoder<F> {
    /// From maps of `16 width` channels to images of `outputs`, 64 times as large; the published width is 16.
    pub fn new(init: &Init, width: usize, outputs: usize) -> Self {
        let block = |(name, i, o, _): (&str, usize, usize, u8)| {
            PreactivatedBlock::new(&init.at(name), i * width, o * width)
        };
        Self {
            blocks: BLOCKS.map(block),
            conv_img: convolution(&init.at("conv_img"), width, outputs, 3),
            six_steps: true,
        }
    }

    /// The image.
    ///
    /// # Shapes
    /// `x [N, H, W, 16 width]` → `[N, 64 H, 64 W, outputs]` in (0, 1); 32 times as large where there are five steps.
    #[track_caller]
    pub fn forward<'t>(&self, x: Var<'t, F>) -> Var<'t, F> {
        let mut x = x;
        for ((.., step), block) in BLOCKS.iter().zip(&self.blocks) {
            if *step == 1 || (*step == 2 && self.six_steps) {
                let [_, h, w, _] = x.dims();
                x = x.resize_bilinear(2 * h, 2 * w, false);
            }
            x = block.forward(x);
        }
        let active = x.leaky_relu(F::from_f64(SLOPE));
        self.conv_img.forward_then(active, Activation::Sigmoid)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use autodiff_lite::testkit::{Options, check, function};
    use autodiff_lite::{Module, Tape};
    use ndarray::Array4;

    use super::*;

    #[test]
    fn gradients_pass_both_ways_around_a_block() {
        for (inputs, outputs) in [(3, 2), (2, 2), (1, 3)] {
            let block = PreactivatedBlock::<f64>::new(&Init::new(1), inputs, outputs);
            let f = function(|v| block.forward(v[0]));
            let options = Options::default().pieces();
            check(&f, &options.draw(&[vec![1, 3, 4, inputs]]), &options).unwrap();
            assert_eq!(block.conv_s.is_some(), inputs != outputs);
        }
    }

    #[test]
    fn five_steps_or_six() {
        let mut decoder = ImageDecoder::<f32>::new(&Init::new(0), 1, 2);
        let tape = Tape::train(0);
        let x = tape.leaf(Array4::from_elem((2, 1, 2, 16), 0.5));
        let image = decoder.forward(x);
        assert_eq!(image.shape(), [2, 64, 128, 2]);
        assert!(image.value().iter().all(|&v| v > 0.0 && v < 1.0));
        let gradients = image.sum().backward();
        decoder.visit("", &mut |path: &str, param: &autodiff_lite::Param| {
            assert!(gradients.of(param).is_some(), "{path}");
        });
        decoder.six_steps = false;
        assert_eq!(decoder.forward(x).shape(), [2, 32, 64, 2]);
    }

    #[test]
    fn names_and_count_are_the_published_ones() {
        let decoder = ImageDecoder::<f32>::new(&Init::new(0), 16, 3);
        let mut paths = Vec::new();
        decoder.visit("", &mut |path: &str, _: &_| paths.push(path.to_owned()));
        assert_eq!(paths.len(), 7 * 4 + 4 + 2);
        assert!(paths.contains(&"G_middle_1.conv_0.bias".to_owned()));
        assert!(paths.contains(&"up_3.conv_s.weight".to_owned()));
        let same = |c: usize| 2 * (9 * c * c + c);
        let change = |i: usize, o: usize| 9 * i * o + o + 9 * o * o + o + i * o;
        let steps = change(256, 128) + change(128, 64) + change(64, 32) + change(32, 16);
        assert_eq!(decoder.parameter_count(), 3 * same(256) + steps + 9 * 16 * 3 + 3);
    }
}
