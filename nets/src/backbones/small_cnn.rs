//! A small image encoder that learns from scratch in minutes.

use autodiff_lite::{Activation, ConvGeometry, Real, Var, impl_module};

use crate::{Conv2d, GroupNorm, Init, LayerNorm, Linear};

/// A small encoder of images, for training without pretrained weights on a CPU.
///
/// ```text
/// conv 3x3 stride 2, group norm, ReLU     3 -> 32 -> 64 -> 128 -> 256 channels
/// means of a 4 x 4 grid, flattened        4096 (where something is matters: no global mean)
/// linear, layer norm                      D
/// ```
///
/// The last norm keeps the first steps of Adam, which move all 4096 weights of a feature at once,
/// from throwing features far out: with a ReLU there instead, they died. Group norm has no batch
/// statistics: a batch of one trains, and shards of a batch on parallel tapes give the same
/// gradients; but it makes the encoder blind to the brightness of an image as a whole. With `D`
/// 256 it has 1.4 million parameters and does 0.26 Gflop forward for a 128 x 128 image.
///
/// ```
/// use autodiff_lite::Tape;
/// use nets::{Init, SmallCnn};
///
/// let encoder = SmallCnn::<f32>::new(&Init::new(0).at("encoder"), 3, 256);
/// let tape = Tape::eval();
/// let images = tape.constant(ndarray::Array4::zeros((2, 64, 64, 3)));
/// assert_eq!(encoder.forward(images).shape(), [2, 256]);
/// ```
#[derive(Clone, Debug)]
pub struct SmallCnn<F: Real = f32> {
    /// Each halves the image.
    pub convs: Vec<Conv2d<F>>,
    /// One after each convolution.
    pub norms: Vec<GroupNorm<F>>,
    /// From the grid of means to the features.
    pub fc: Linear<F>,
    /// Of the features.
    pub norm: LayerNorm<F>,
}
impl_module!(SmallCnn { convs, norms, fc, norm });

pub(crate) const GRID: usize = 4;
/// Channels of a group.
const GROUP: usize = 8;

impl<F: Real> SmallCnn<F> {
    /// Channels of the maps, each of which has half the side of the one before.
    pub const CHANNELS: [usize; 4] = [32, 64, 128, 256];

    /// Of images with `channels` channels, to `width` features.
    pub fn new(init: &Init, channels: usize, width: usize) -> Self {
        let halves = ConvGeometry::new().stride(2).padding(1);
        let mut inputs = channels;
        let (mut convs, mut norms) = (Vec::new(), Vec::new());
        for (i, &outputs) in Self::CHANNELS.iter().enumerate() {
            let at = init.at("convs").index(i);
            convs.push(Conv2d::kaiming(&at, inputs, outputs, 3, halves).without_bias());
            norms.push(GroupNorm::new(&init.at("norms").index(i), outputs / GROUP, outputs));
            inputs = outputs;
        }
        Self {
            convs,
            norms,
            fc: Linear::new(&init.at("fc"), inputs * GRID * GRID, width),
            norm: LayerNorm::new(&init.at("norm"), width),
        }
    }

    /// The number of features.
    pub fn width(&self) -> usize {
        self.fc.weight.shape()[0]
    }

    /// Features of images; 64 to 256 pixels a side make sense.
    ///
    /// # Shapes
    /// `x [N, H, W, C]`, at least one pixel → `[N, D]`, `D` being [`width`](Self::width).
    #[track_caller]
    pub fn forward<'t>(&self, x: Var<'t, F>) -> Var<'t, F> {
        let maps = self.maps(x);
        self.features(&maps)
    }

    /// The maps behind each convolution, finest first.
    ///
    /// # Shapes
    /// `x [N, H, W, C]` → `[N, H / 2, W / 2, 32]`, then half the side each, halves rounded up; channels are
    /// [`CHANNELS`](Self::CHANNELS).
    #[track_caller]
    pub fn maps<'t>(&self, x: Var<'t, F>) -> Vec<Var<'t, F>> {
        let layers = self.convs.iter().zip(&self.norms);
        let next = |x: &mut Var<'t, F>, (conv, norm): (&Conv2d<F>, &GroupNorm<F>)| {
            *x = norm.forward_then(conv.forward(*x), Activation::Relu);
            Some(*x)
        };
        layers.scan(x, next).collect()
    }

    /// The features that follow from the [maps](Self::maps).
    ///
    /// # Shapes
    /// `maps`: what [`maps`](Self::maps) gave, of which the last is used → `[N, D]`.
    ///
    /// # Panics
    /// If there is no map.
    #[track_caller]
    pub fn features<'t>(&self, maps: &[Var<'t, F>]) -> Var<'t, F> {
        let map = maps.last().expect("a map for each convolution");
        let [n, _, _, c] = map.dims();
        let grid = map.adaptive_avg_pool2d(GRID, GRID).reshape(&[n, GRID * GRID * c]);
        self.norm.forward(self.fc.forward(grid))
    }
}

#[cfg(test)]
mod tests {
    use autodiff_lite::optim::Adam;
    use autodiff_lite::{Module, Tape};
    use ndarray::{Array2, Array4};

    use super::*;

    /// It can tell left from right: a bright column is found in a few steps.
    #[test]
    fn it_learns_where_something_is() {
        let init = Init::new(0);
        let encoder = SmallCnn::<f32>::new(&init.at("encoder"), 1, 16);
        assert_eq!(encoder.width(), 16);
        assert!(encoder.parameter_count() > 450_000);
        let mut model = (encoder, Linear::new(&init.at("head"), 16, 2));
        let lit = |(n, _, j, _): (usize, usize, usize, usize)| f32::from(j / 4 == n % 8);
        let images = Array4::from_shape_fn((8, 32, 32, 1), lit).into_shared();
        let truth =
            Array2::from_shape_fn((8, 2), |(n, k)| if k == 0 { n as f32 / 8.0 } else { 0.5 });
        let truth = truth.into_shared();
        let (mut tape, mut adam) = (Tape::train(0), Adam::new(3e-3));
        let mut losses = Vec::new();
        for _ in 0..40 {
            let error = model.1.forward(model.0.forward(tape.constant(images.clone())))
                - tape.constant(truth.clone());
            let loss = error.square().mean();
            losses.push(loss.item());
            let gradients = loss.backward();
            tape.reset();
            adam.step(&mut model, &gradients);
        }
        assert!(losses[39] < 0.05 * losses[0], "{losses:?}");
    }
}
