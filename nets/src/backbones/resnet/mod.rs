//! Residual networks.

mod block;
mod config;

use autodiff_lite::{Activation, PoolGeometry, Real, Var, impl_module};

pub use block::{BlockKind, ResidualBlock};
pub use config::ResNetConfig;

use crate::{Conv2d, Init, Linear, Norm};

/// A residual network; names as in torchvision's `resnet18`, `resnet34` and `resnet50`.
///
/// ```text
/// stem     7x7 stride 2, norm, ReLU, max pool 3x3 stride 2     1/4
/// stage 1  blocks of the width                                 1/4
/// stage 2  twice as wide, the first block strides               1/8
/// stage 3, 4                                                    1/16, 1/32
/// fc       means of the last maps, linear
/// ```
///
/// Sizes are halved with halves rounded up: 137 pixels give maps of 35, 18, 9 and 5. Images are
/// `[N, H, W, C]`. torchvision's weights expect them as
/// [`imagenet_normalized`](crate::imagenet_normalized) makes them, which is the caller's affair, and load
/// with [`LoadWeights::partial`](crate::LoadWeights::partial) (its files have a classifier, and
/// count batches); for a stem of four channels
/// [`LoadWeights::widen`](crate::LoadWeights::widen) copies the three that are there.
///
/// ```
/// use autodiff_lite::Tape;
/// use nets::{Init, ResNet, ResNetConfig};
///
/// let config = ResNetConfig { width: 8, ..ResNetConfig::resnet18() };
/// let net = ResNet::<f32>::new(&Init::new(0), &config);
/// let tape = Tape::eval();
/// let images = tape.constant(ndarray::Array4::zeros((1, 64, 48, 3)));
/// let maps = net.forward_maps(images);
/// assert_eq!(maps.map(|m| m.dims()), [[1, 16, 12, 8], [1, 8, 6, 16], [1, 4, 3, 32], [1, 2, 2, 64]]);
/// assert_eq!(net.forward(images).shape(), [1, 64]); // no classifier: the means
/// ```
///
/// # References
/// He et al. 2016, *Deep residual learning for image recognition*, table 1.
#[derive(Clone, Debug)]
pub struct ResNet<F: Real = f32> {
    /// 7x7, stride 2.
    pub conv1: Conv2d<F>,
    /// Behind it.
    pub bn1: Norm<F>,
    /// Stage 1.
    pub layer1: Vec<ResidualBlock<F>>,
    /// Stage 2.
    pub layer2: Vec<ResidualBlock<F>>,
    /// Stage 3.
    pub layer3: Vec<ResidualBlock<F>>,
    /// Stage 4.
    pub layer4: Vec<ResidualBlock<F>>,
    /// The classifier, if any.
    pub fc: Option<Linear<F>>,
}
impl_module!(ResNet { conv1, bn1, layer1, layer2, layer3, layer4, fc });

impl<F: Real> ResNet<F> {
    /// With torchvision's initial values.
    pub fn new(init: &Init, config: &ResNetConfig) -> Self {
        let mut inputs = config.width;
        let mut stage = |k: usize| -> Vec<ResidualBlock<F>> {
            let init = init.at(&format!("layer{}", k + 1));
            let width = config.width << k;
            let block = |i: usize| {
                let stride = if k > 0 && i == 0 { 2 } else { 1 };
                let (init, kind) = (init.index(i), config.block);
                let block = ResidualBlock::new(&init, kind, inputs, width, stride, config.norm);
                inputs = width * kind.expansion();
                block
            };
            (0..config.blocks[k]).map(block).collect()
        };
        let [layer1, layer2, layer3, layer4] = [stage(0), stage(1), stage(2), stage(3)];
        let last = config.channels()[3];
        Self {
            conv1: block::convolution(init, "conv1", config.inputs, config.width, 7, 2),
            bn1: Norm::new(&init.at("bn1"), config.width, config.norm),
            layer1,
            layer2,
            layer3,
            layer4,
            fc: config.classes.map(|classes| Linear::new(&init.at("fc"), last, classes)),
        }
    }

    fn stages(&self) -> [&[ResidualBlock<F>]; 4] {
        [&self.layer1, &self.layer2, &self.layer3, &self.layer4]
    }

    /// Channels of the maps of the four stages.
    pub fn channels(&self) -> [usize; 4] {
        let last = |stage: &[ResidualBlock<F>]| stage.last().map_or(0, ResidualBlock::outputs);
        self.stages().map(last)
    }

    /// The maps of the four stages, finest first.
    ///
    /// # Shapes
    /// `images [N, H, W, C]` → `[N, H / 4, W / 4, C1]`, then half the side each to `[N, H / 32, W / 32, C4]`, halves
    /// rounded up.
    #[track_caller]
    pub fn forward_maps<'t>(&self, images: Var<'t, F>) -> [Var<'t, F>; 4] {
        let x = self.bn1.after(&self.conv1, images, Activation::Relu);
        let mut x = x.max_pool2d(PoolGeometry::square(3).stride(2).padding(1));
        self.stages().map(|stage| {
            x = stage.iter().fold(x, |x, block| block.forward(x));
            x
        })
    }

    /// The means of the last maps.
    ///
    /// # Shapes
    /// `images [N, H, W, C]` → `[N, C4]`.
    #[track_caller]
    pub fn forward_features<'t>(&self, images: Var<'t, F>) -> Var<'t, F> {
        let [.., last] = self.forward_maps(images);
        let [n, _, _, c] = last.dims();
        last.adaptive_avg_pool2d(1, 1).reshape(&[n, c])
    }

    /// Logits; without a classifier the [features](Self::forward_features).
    ///
    /// # Shapes
    /// `images [N, H, W, C]` → `[N, classes]`, or `[N, C4]`.
    #[track_caller]
    pub fn forward<'t>(&self, images: Var<'t, F>) -> Var<'t, F> {
        let features = self.forward_features(images);
        self.fc.as_ref().map_or(features, |fc| fc.forward(features))
    }
}

#[cfg(test)]
mod tests {
    use autodiff_lite::{Module, Tape};
    use ndarray::Array4;
    use proptest::prelude::*;

    use super::*;

    /// The numbers of torchvision's models.
    #[test]
    fn counts_are_those_of_torchvision() {
        let whole = |config: ResNetConfig| ResNetConfig { classes: Some(1000), ..config };
        let count = |config: ResNetConfig| {
            ResNet::<f32>::new(&Init::new(0), &whole(config)).parameter_count()
        };
        assert_eq!(count(ResNetConfig::resnet18()), 11_689_512);
        assert_eq!(count(ResNetConfig::resnet50()), 25_557_032);
        let config = ResNetConfig::resnet50().frozen();
        let net = ResNet::<f32>::new(&Init::new(0), &config);
        // Without 53 norms of together 26,560 channels, and the classifier.
        assert_eq!(net.parameter_count(), 25_557_032 - 2 * 26_560 - 2_049_000);
        assert_eq!((net.channels(), config.channels()), ([256, 512, 1024, 2048], net.channels()));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(12))]
        #[test]
        fn halves_are_rounded_up(h in 1usize..80, w in 1usize..80, bottleneck: bool) {
            let base = if bottleneck { ResNetConfig::resnet50() } else { ResNetConfig::resnet18() };
            let config = ResNetConfig { width: 1, blocks: [1; 4], ..base };
            let net = ResNet::<f32>::new(&Init::new(1), &config);
            let tape = Tape::eval();
            let maps = net.forward_maps(tape.constant(Array4::zeros((1, h, w, 3))));
            for (k, map) in maps.iter().enumerate() {
                let size = |n: usize| n.div_ceil(4 << k);
                prop_assert_eq!(map.dims(), [1, size(h), size(w), config.channels()[k]]);
            }
        }
    }

    #[test]
    fn frozen_maps_do_not_depend_on_the_batch() {
        let config = ResNetConfig { width: 2, inputs: 4, ..ResNetConfig::resnet18() }.frozen();
        let net = ResNet::<f32>::new(&Init::new(4), &config);
        let image = |n: usize| {
            Array4::from_shape_fn((n, 40, 33, 4), |(n, i, j, c)| {
                ((31 * n + 7 * i + 3 * j + c) as f32 * 0.37).sin()
            })
        };
        let tape = Tape::train(0);
        let both = net.forward(tape.constant(image(2)));
        let one = net.forward(tape.constant(image(1)));
        assert_eq!(both.index_axis(0, 0).value(), one.index_axis(0, 0).value());
        assert!(tape.take_updates().is_empty());
        let gradients = one.sum().backward();
        net.visit("", &mut |path: &str, param: &autodiff_lite::Param| {
            assert_eq!(gradients.of(param).is_some(), param.trainable, "{path}");
        });
    }
}
