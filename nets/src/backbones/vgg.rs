//! VGG16.

use autodiff_lite::{Activation, ConvGeometry, PoolGeometry, Real, Var, impl_module};

use crate::{Conv2d, Dropout, Indexed, Init, Linear};

/// Channels of the convolutions in front of each pool.
pub(crate) const BLOCKS: [&[usize]; 5] =
    [&[64, 64], &[128, 128], &[256, 256, 256], &[512, 512, 512], &[512, 512, 512]];
/// Rows and columns that the classifier sees.
pub(crate) const GRID: usize = 7;
const HIDDEN: usize = 4096;

/// VGG16 without batch norm, or its first part; names as in torchvision's `vgg16`.
///
/// ```text
/// features     64 64 M 128 128 M 256 256 256 M 512 512 512 M 512 512 512 M     3x3, ReLU, M = max pool 2
/// classifier   means of a 7 x 7 grid, 25088 -> 4096 -> 4096 -> classes         ReLU, dropout 0.5
/// ```
///
/// Images are `[N, H, W, 3]`. torchvision's weights expect them as
/// [`imagenet_normalized`](crate::imagenet_normalized) makes them, which is the caller's affair.
///
/// ```
/// use autodiff_lite::Tape;
/// use nets::{Init, Vgg16};
///
/// let vgg = Vgg16::<f32>::features_until_pool(&Init::new(0), 3);
/// let tape = Tape::eval();
/// let images = tape.constant(ndarray::Array4::zeros((1, 32, 24, 3)));
/// assert_eq!(vgg.forward_features(images).shape(), [1, 4, 3, 256]);
/// ```
///
/// # References
/// Simonyan and Zisserman 2015, *Very deep convolutional networks for large-scale image
/// recognition*, table 1, column D.
#[derive(Clone, Debug)]
pub struct Vgg16<F: Real = f32> {
    /// The convolutions: `features.0`, `2`, `5`, .. `28`.
    pub features: Indexed<Conv2d<F>>,
    /// The linear layers that are kept of `classifier.0`, `3`, `6`.
    pub classifier: Indexed<Linear<F>>,
    /// Between the linear layers, while training; 0.5 in torchvision.
    pub dropout: Dropout,
}
impl_module!(Vgg16 { features, classifier } fixed { dropout });

impl<F: Real> Vgg16<F> {
    /// The whole network: 138 million parameters for 1000 classes.
    pub fn new(init: &Init, classes: usize) -> Self {
        Self::with_classifier(init, 5, &[HIDDEN, HIDDEN, classes])
    }

    /// The convolutions up to and with the `pools`th max pool (1 to 5), no classifier. torchvision's
    /// files load with [`LoadWeights::partial`](crate::LoadWeights::partial).
    ///
    /// # Panics
    /// If `pools` is 0 or above 5.
    #[track_caller]
    pub fn features_until_pool(init: &Init, pools: usize) -> Self {
        Self::with_classifier(init, pools, &[])
    }

    /// All convolutions and the first `layers` (1 or 2) linear layers, each with its ReLU: 4096
    /// features.
    ///
    /// # Panics
    /// If `layers` is neither 1 nor 2.
    #[track_caller]
    pub fn cut(init: &Init, layers: usize) -> Self {
        assert!((1..=2).contains(&layers), "a cut classifier keeps 1 or 2 layers, not {layers}");
        Self::with_classifier(init, 5, &[HIDDEN, HIDDEN][..layers])
    }

    #[track_caller]
    fn with_classifier(init: &Init, pools: usize, widths: &[usize]) -> Self {
        assert!((1..=5).contains(&pools), "VGG16 has pools 1 to 5, not {pools}");
        let mut inputs = GRID * GRID * 512;
        let mut linear = |(i, &outputs): (usize, &usize)| {
            let at = init.at("classifier").index(3 * i);
            (3 * i, Linear::normal(&at, std::mem::replace(&mut inputs, outputs), outputs, 0.01))
        };
        Self {
            classifier: Indexed(widths.iter().enumerate().map(&mut linear).collect()),
            features: convolutions(&init.at("features"), pools),
            dropout: Dropout::new(0.5),
        }
    }

    /// How many max pools it has.
    pub fn pools(&self) -> usize {
        let mut left = self.features.len();
        BLOCKS
            .iter()
            .take_while(|block| {
                let more = left > 0;
                left -= block.len().min(left);
                more
            })
            .count()
    }

    /// The map after the last pool.
    ///
    /// # Shapes
    /// `x [N, H, W, 3]` → `[N, H / 2ᵏ, W / 2ᵏ, C]` after `k` pools, rounded down.
    #[track_caller]
    pub fn forward_features<'t>(&self, x: Var<'t, F>) -> Var<'t, F> {
        let last = |maps: &mut Vec<Var<'t, F>>| maps.pop();
        last(&mut self.forward_maps(x)).unwrap_or(x)
    }

    /// The maps after each pool, largest first.
    ///
    /// # Shapes
    /// `x [N, H, W, 3]` → `[N, H / 2, W / 2, 64]`, then half the side each, rounded down.
    #[track_caller]
    pub fn forward_maps<'t>(&self, x: Var<'t, F>) -> Vec<Var<'t, F>> {
        let (mut x, mut maps, mut layers) = (x, Vec::new(), self.features.iter());
        for block in &BLOCKS[..self.pools()] {
            x = run(&mut layers, block.len(), x).max_pool2d(PoolGeometry::square(2));
            maps.push(x);
        }
        maps
    }

    /// The maps before each pool, largest first: `relu1_2`, `relu2_2`, `relu3_3`, `relu4_3`,
    /// `relu5_3`, which perceptual distances compare. The last pool is not computed.
    ///
    /// # Shapes
    /// `x [N, H, W, 3]` → `[N, H, W, 64]`, then half the side each, rounded down.
    #[track_caller]
    pub fn forward_before_pools<'t>(&self, x: Var<'t, F>) -> Vec<Var<'t, F>> {
        let (mut maps, mut layers): (Vec<Var<'t, F>>, _) = (Vec::new(), self.features.iter());
        for block in &BLOCKS[..self.pools()] {
            let x = maps.last().map_or(x, |map| map.max_pool2d(PoolGeometry::square(2)));
            maps.push(run(&mut layers, block.len(), x));
        }
        maps
    }

    /// Features and classifier: logits, or 4096 features after a ReLU if the classifier is cut. Without a classifier, the
    /// flattened maps in the order of PyTorch (channels first).
    ///
    /// # Shapes
    /// `x [N, H, W, 3]` → `[N, classes]`, `[N, 4096]`, or `[N, C H' W']`.
    #[track_caller]
    pub fn forward<'t>(&self, x: Var<'t, F>) -> Var<'t, F> {
        let mut maps = self.forward_features(x);
        if !self.classifier.is_empty() {
            maps = maps.adaptive_avg_pool2d(GRID, GRID);
        }
        let [n, h, w, c] = maps.dims();
        // PyTorch flattens channels first, and its weights are in that order.
        let mut x = maps.permute(&[0, 3, 1, 2]).reshape(&[n, c * h * w]);
        for (index, layer) in &self.classifier.0 {
            if *index > 0 {
                x = self.dropout.forward(x);
            }
            let activation = if *index < 6 { Activation::Relu } else { Activation::None };
            x = layer.forward_then(x, activation);
        }
        x
    }
}

/// The next `count` convolutions, each with its ReLU.
#[track_caller]
fn run<'t, 'a, F: Real>(
    layers: &mut impl Iterator<Item = &'a Conv2d<F>>,
    count: usize,
    x: Var<'t, F>,
) -> Var<'t, F> {
    layers.take(count).fold(x, |x, conv| conv.forward_then(x, Activation::Relu))
}

/// The convolutions of the first `pools` blocks, under their indices in a `Sequential` in which
/// each is followed by a ReLU, and each block by a pool. Initial values are torchvision's.
pub(crate) fn convolutions<F: Real>(init: &Init, pools: usize) -> Indexed<Conv2d<F>> {
    let same = ConvGeometry::new().padding(1);
    let (mut layers, mut inputs, mut index) = (Vec::new(), 3, 0);
    for block in &BLOCKS[..pools] {
        for &outputs in *block {
            layers.push((index, Conv2d::kaiming(&init.index(index), inputs, outputs, 3, same)));
            (inputs, index) = (outputs, index + 2);
        }
        index += 1;
    }
    Indexed(layers)
}

#[cfg(test)]
mod tests {
    use autodiff_lite::{Module, Param, Tape};
    use ndarray::Array4;

    use super::*;

    fn paths(module: &impl Module<f32>) -> Vec<String> {
        let mut paths = Vec::new();
        module.visit("", &mut |path: &str, _: &Param<f32>| paths.push(path.to_owned()));
        paths
    }

    #[test]
    fn names_and_counts_are_those_of_torchvision() {
        let vgg = Vgg16::<f32>::features_until_pool(&Init::new(0), 5);
        let indices = [0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28];
        let expected: Vec<_> = indices
            .iter()
            .flat_map(|i| ["weight", "bias"].map(|name| format!("features.{i}.{name}")))
            .collect();
        assert_eq!(paths(&vgg), expected);
        // The number that torchvision's model has.
        assert_eq!(vgg.parameter_count(), 14_714_688);
        for pools in 1..=5 {
            assert_eq!(Vgg16::<f32>::features_until_pool(&Init::new(0), pools).pools(), pools);
        }
    }

    #[test]
    fn maps_before_and_after_pools_belong_together() {
        let vgg = Vgg16::<f32>::features_until_pool(&Init::new(2), 3);
        let tape = Tape::eval();
        let image =
            Array4::from_shape_fn((1, 16, 9, 3), |(_, i, j, c)| ((i + 2 * j) % (c + 2)) as f32);
        let x = tape.constant(image);
        let (before, after) = (vgg.forward_before_pools(x), vgg.forward_maps(x));
        assert_eq!((before.len(), before[0].shape()), (3, vec![1, 16, 9, 64]));
        for (before, after) in before.iter().zip(after) {
            assert_eq!(before.max_pool2d(PoolGeometry::square(2)).value(), after.value());
        }
    }

    #[test]
    fn a_cut_keeps_the_order_of_pytorch() {
        // A tiny stand-in for the classifier: its weights would take 400 MB.
        let mut vgg = Vgg16::<f32>::features_until_pool(&Init::new(0), 1);
        let at = Init::new(0).at("classifier.0");
        let inputs = 64 * GRID * GRID;
        vgg.classifier = Indexed(vec![(0, Linear::new(&at, inputs, 5))]);
        assert_eq!(paths(&vgg)[4..], ["classifier.0.weight", "classifier.0.bias"]);
        let tape = Tape::eval();
        let image = Array4::from_shape_fn((1, 14, 14, 3), |(_, i, j, c)| {
            ((i * 14 + j) * 3 + c) as f32 / 600.0
        });
        let x = tape.constant(image);
        let maps = vgg.forward_features(x).value();
        let linear = &vgg.classifier.0[0].1;
        for (o, &y) in vgg.forward(x).value().iter().enumerate() {
            let mut sum = linear.bias.as_ref().map_or(0.0, |b| b.value[o]);
            for (k, w) in linear.weight.as_slice()[o * inputs..][..inputs].iter().enumerate() {
                let (c, i, j) = (k / 49, k % 49 / 7, k % 7);
                sum += w * maps[[0, i, j, c]];
            }
            assert!((y - sum.max(0.0)).abs() < 1e-4, "{y} and {sum}");
        }
    }
}
