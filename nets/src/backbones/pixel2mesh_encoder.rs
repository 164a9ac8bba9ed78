//! The image encoder of Pixel2Mesh.

use autodiff_lite::{Activation, ConvGeometry, Module, Real, Var, Visitor, VisitorMut, join_path};

use crate::{Conv2d, GroupNorm, Init};

/// Convolutions of each stage, and the side of the first one's kernel; all others are 3.
const STAGES: [(usize, usize); 6] = [(2, 3), (3, 3), (3, 3), (3, 3), (3, 5), (4, 5)];
/// Channels of a group that is normalised together; all of a layer that has fewer.
const GROUP: usize = 8;

/// Strided convolutions like VGG16's, whose last four stages give maps to pool from.
///
/// ```text
/// stage   0: 16 16      1: 32 32 32      2: 64 64 64      3: 128 128 128      4: 256 256 256      5: 512 512 512 512
/// side    1             1/2              1/4  -> map      1/8  -> map         1/16  -> map        1/32  -> map
/// ```
///
/// 3x3 kernels, but 5x5 where stages 4 and 5 halve; a ReLU after each. Four maps of together
/// 960 channels. Convolutions are called `conv<stage>_<number>`, from 1 on.
///
/// [`residual`](Self::residual) makes of the 18 plain layers ones that are easier to train.
///
/// ```
/// use autodiff_lite::Tape;
/// use nets::{EncoderInit, Init, Pixel2MeshEncoder};
///
/// let encoder = Pixel2MeshEncoder::<f32>::new(&Init::new(0), [4, 4, 8, 8, 16, 16], EncoderInit::He);
/// let tape = Tape::eval();
/// let maps = encoder.forward(tape.constant(ndarray::Array4::zeros((1, 64, 64, 3))));
/// assert_eq!(maps.map(|map| map.shape()), [[1, 16, 16, 8], [1, 8, 8, 8], [1, 4, 4, 16], [1, 2, 2, 16]]);
/// ```
///
/// # References
/// Wang et al. 2018, *Pixel2Mesh*, section 3.2; the sizes are those of its PyTorch versions.
#[derive(Clone, Debug)]
pub struct Pixel2MeshEncoder<F: Real = f32> {
    /// The convolutions, stage by stage.
    pub stages: Vec<Vec<Conv2d<F>>>,
    /// The norm behind each convolution, stage by stage; nothing in the published form.
    pub norms: Vec<Vec<GroupNorm<F>>>,
}

/// How the encoder's weights begin; biases are 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "kebab-case")
)]
#[non_exhaustive]
pub enum EncoderInit {
    /// Deviation `√(2 / inputs)`, inputs of the kernel: as large behind a layer as before it.
    #[default]
    He,
    /// Deviation 0.02 whatever the layer, as published. Each of the 18 layers divides what passes by `√(9 C / 2) 0.02`
    /// for `C` channels, a factor of 6 for 16 of them: with the published widths the coarsest map begins at about
    /// 1e-7 of the image, with narrower ones at nothing that a float can say.
    Published,
}

impl<F: Real> Module<F> for Pixel2MeshEncoder<F> {
    fn visit(&self, path: &str, visitor: &mut dyn Visitor<F>) {
        for (s, stage) in self.stages.iter().enumerate() {
            for (i, conv) in stage.iter().enumerate() {
                conv.visit(&join_path(path, &name("conv", s, i)), visitor);
            }
        }
        for (s, stage) in self.norms.iter().enumerate() {
            for (i, norm) in stage.iter().enumerate() {
                norm.visit(&join_path(path, &name("norm", s, i)), visitor);
            }
        }
    }

    fn visit_mut(&mut self, path: &str, visitor: &mut dyn VisitorMut<F>) {
        for (s, stage) in self.stages.iter_mut().enumerate() {
            for (i, conv) in stage.iter_mut().enumerate() {
                conv.visit_mut(&join_path(path, &name("conv", s, i)), visitor);
            }
        }
        for (s, stage) in self.norms.iter_mut().enumerate() {
            for (i, norm) in stage.iter_mut().enumerate() {
                norm.visit_mut(&join_path(path, &name("norm", s, i)), visitor);
            }
        }
    }
}

pub(crate) fn name(layer: &str, stage: usize, index: usize) -> String {
    format!("{layer}{stage}_{}", index + 1)
}

/// Into how many groups channels fall: such that each has as many, and [`GROUP`] at least.
fn groups(channels: usize) -> usize {
    (1..=channels / GROUP).rev().find(|&groups| channels.is_multiple_of(groups)).unwrap_or(1)
}

impl<F: Real> Pixel2MeshEncoder<F> {
    /// Channels of the stages as published: 960 in the four maps.
    pub const PUBLISHED: [usize; 6] = [16, 32, 64, 128, 256, 512];

    /// With so many channels in the stages.
    pub fn new(init: &Init, channels: [usize; 6], first: EncoderInit) -> Self {
        let mut inputs = 3;
        let mut stage = |s: usize, (count, kernel): (usize, usize)| {
            let conv = |i: usize| {
                let at = init.at(&name("conv", s, i));
                let halves = s > 0 && i == 0;
                let side = if i == 0 { kernel } else { 3 };
                let geometry = ConvGeometry::new().padding(side / 2);
                let geometry = if halves { geometry.stride(2) } else { geometry };
                let deviation = match first {
                    EncoderInit::He => (2.0 / (inputs * side * side) as f64).sqrt(),
                    EncoderInit::Published => 0.02,
                };
                let conv = Conv2d::normal(&at, inputs, channels[s], side, deviation, geometry);
                inputs = channels[s];
                conv
            };
            (0..count).map(conv).collect()
        };
        let stages = STAGES.iter().enumerate().map(|(s, &of)| stage(s, of)).collect();
        Self { stages, norms: Vec::new() }
    }

    /// The same with a group norm behind each convolution, groups of eight channels, and around those that do not halve
    /// a skip: `x <- relu(x + norm(conv(x)))`. Beyond the papers: what the first layers learn no longer has to pass through
    /// all others, and no layer's size depends on those before it.
    ///
    /// # References
    /// He et al. 2016, *Deep residual learning for image recognition*; Wu and He 2018, *Group normalization*.
    #[must_use]
    pub fn residual(mut self, init: &Init) -> Self {
        let norm = |s: usize, i: usize, conv: &Conv2d<F>| {
            let channels = conv.weight.shape()[0];
            GroupNorm::new(&init.at(&name("norm", s, i)), groups(channels), channels)
        };
        let stage = |(s, stage): (usize, &Vec<Conv2d<F>>)| {
            stage.iter().enumerate().map(|(i, conv)| norm(s, i, conv)).collect()
        };
        self.norms = self.stages.iter().enumerate().map(stage).collect();
        self
    }

    /// One convolution, and what is around it.
    fn layer<'t>(&self, x: Var<'t, F>, stage: usize, index: usize) -> Var<'t, F> {
        let conv = &self.stages[stage][index];
        let Some(norm) = self.norms.get(stage).and_then(|norms| norms.get(index)) else {
            return conv.forward_then(x, Activation::Relu);
        };
        let y = conv.forward(x);
        if index == 0 {
            return norm.forward_then(y, Activation::Relu);
        }
        (x + norm.forward(y)).relu()
    }

    /// Channels of the four maps together.
    pub fn width(&self) -> usize {
        let last = |stage: &Vec<Conv2d<F>>| stage.last().map_or(0, |conv| conv.weight.shape()[0]);
        self.stages.iter().skip(2).map(last).sum()
    }

    /// The maps of four depths, finest first.
    ///
    /// # Shapes
    /// `images [N, H, W, 3]` → `[N, H / 4, W / 4, C2]`, then half the side each to `[N, H / 32, W / 32, C5]`, halves
    /// rounded up.
    #[track_caller]
    pub fn forward<'t>(&self, images: Var<'t, F>) -> [Var<'t, F>; 4] {
        let mut x = images;
        let mut maps = [images; 4];
        for (s, stage) in self.stages.iter().enumerate() {
            x = (0..stage.len()).fold(x, |x, i| self.layer(x, s, i));
            if let Some(map) = s.checked_sub(2).and_then(|k| maps.get_mut(k)) {
                *map = x;
            }
        }
        maps
    }
}

#[cfg(test)]
mod tests {
    use autodiff_lite::Tape;
    use ndarray::Array4;

    use super::*;

    #[test]
    fn the_published_sizes_and_names() {
        let channels = Pixel2MeshEncoder::<f32>::PUBLISHED;
        let encoder =
            Pixel2MeshEncoder::<f32>::new(&Init::new(0), channels, EncoderInit::Published);
        assert_eq!(encoder.width(), 960);
        let mut paths = Vec::new();
        encoder.visit("encoder", &mut |path: &str, _: &_| paths.push(path.to_owned()));
        assert_eq!((paths.len(), &*paths[0]), (36, "encoder.conv0_1.weight"));
        assert_eq!(paths.last().map(String::as_str), Some("encoder.conv5_4.bias"));
        // Weights and biases, stage by stage.
        let conv = |k: usize, i: usize, o: usize| k * k * i * o + o;
        let expected = conv(3, 3, 16)
            + conv(3, 16, 16)
            + conv(3, 16, 32)
            + 2 * conv(3, 32, 32)
            + conv(3, 32, 64)
            + 2 * conv(3, 64, 64)
            + conv(3, 64, 128)
            + 2 * conv(3, 128, 128)
            + conv(5, 128, 256)
            + 2 * conv(3, 256, 256)
            + conv(5, 256, 512)
            + 3 * conv(3, 512, 512);
        assert_eq!(encoder.parameter_count(), expected);
    }

    #[test]
    fn every_stage_halves_and_learns() {
        let encoder = Pixel2MeshEncoder::<f32>::new(&Init::new(1), [4; 6], EncoderInit::He);
        let tape = Tape::train(0);
        let images = Array4::from_shape_fn((2, 40, 56, 3), |(n, i, j, c)| {
            ((7 * n + 3 * i + 5 * j + c) % 11) as f32 / 11.0
        });
        let maps = encoder.forward(tape.constant(images));
        let shapes = [[2, 10, 14, 4], [2, 5, 7, 4], [2, 3, 4, 4], [2, 2, 2, 4]];
        assert_eq!(maps.map(|map| map.dims::<4>()), shapes);
        let loss = maps.map(|map| map.square().sum()).into_iter().reduce(|a, b| a + b);
        let gradients = loss.expect("four maps").backward();
        encoder.visit("", &mut |path: &str, param: &autodiff_lite::Param| {
            assert!(gradients.of(param).is_some(), "{path}");
        });
    }

    /// Names, numbers, and what a block is: with the branch switched off what came before passes through.
    #[test]
    fn residual_layers_add_to_what_passes() {
        let at = Init::new(2);
        let plain = Pixel2MeshEncoder::<f64>::new(&at, [4, 8, 12, 16, 24, 24], EncoderInit::He);
        let mut encoder = plain.clone().residual(&at);
        let found: Vec<_> = encoder.norms.iter().map(|stage| stage[0].groups).collect();
        assert_eq!(found, [1, 1, 1, 2, 3, 3]);
        let channels: usize = [4 * 2, 8 * 3, 12 * 3, 16 * 3, 24 * 3, 24 * 4].iter().sum();
        assert_eq!(encoder.parameter_count(), plain.parameter_count() + 2 * channels);
        for stage in &mut encoder.norms {
            for norm in &mut stage[1..] {
                norm.weight.as_slice_mut().fill(0.0);
            }
        }
        let tape = Tape::eval();
        let images =
            Array4::from_shape_fn((1, 8, 8, 3), |(_, i, j, c)| ((3 * i + 5 * j + c) % 7) as f64);
        let maps = encoder.forward(tape.constant(images.clone()));
        let first = |x, s: usize| {
            let (conv, norm) = (&encoder.stages[s][0], &encoder.norms[s][0]);
            norm.forward_then(conv.forward(x), Activation::Relu)
        };
        let expected = (0..3).fold(tape.constant(images), first);
        assert_eq!(maps[0].value(), expected.value());
        let mut paths = Vec::new();
        encoder.visit("", &mut |path: &str, _: &_| paths.push(path.to_owned()));
        assert_eq!(paths.last().map(String::as_str), Some("norm5_4.bias"));
    }

    #[test]
    fn every_residual_layer_learns() {
        let at = Init::new(1);
        let encoder = Pixel2MeshEncoder::<f32>::new(&at, [4; 6], EncoderInit::He).residual(&at);
        let tape = Tape::train(0);
        let images = Array4::from_shape_fn((2, 64, 64, 3), |(n, i, j, c)| {
            ((7 * n + 3 * i + 5 * j + c) % 11) as f32 / 11.0
        });
        let maps = encoder.forward(tape.constant(images));
        let loss = maps.map(|map| map.square().sum()).into_iter().reduce(|a, b| a + b);
        let gradients = loss.expect("four maps").backward();
        encoder.visit("", &mut |path: &str, param: &autodiff_lite::Param| {
            assert!(gradients.of(param).is_some(), "{path}");
        });
    }

    /// What the two first deviations leave of an image in the coarsest map. He's is not 1: of a map of 2 x 2 pixels most
    /// of a kernel sees the zeros around it.
    #[test]
    fn the_published_deviation_fades() {
        let root = |first: EncoderInit| {
            let encoder = Pixel2MeshEncoder::<f32>::new(&Init::new(1), [16; 6], first);
            let tape = Tape::eval();
            let images = Array4::from_shape_fn((1, 64, 64, 3), |(_, i, j, c)| {
                ((3 * i + 5 * j + c) % 11) as f32 / 11.0
            });
            let map = encoder.forward(tape.constant(images))[3].value();
            (map.iter().map(|x| x * x).sum::<f32>() / map.len() as f32).sqrt()
        };
        let [he, published] = [EncoderInit::He, EncoderInit::Published].map(root);
        assert!((1e-3..5.0).contains(&he) && published < 1e-9, "{he} {published}");
    }
}
