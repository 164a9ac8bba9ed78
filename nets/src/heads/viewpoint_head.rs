//! Where the camera of an image stands, as several hypotheses.

use std::f64::consts::TAU;

use autodiff_lite::{Real, Var, impl_module};

use crate::{Init, Linear, SmallCnn};

/// Features of the encoder.
const FEATURES: usize = 128;
/// Images are halved until their longer side is below this: pose shows at 64 pixels.
pub(crate) const SIDE: usize = 128;
/// Deviation of the last layer's first weights: all hypotheses begin alike.
const DEVIATION: f64 = 0.01;

/// From which direction an object is seen, by an encoder of its own.
///
/// ```text
/// image [N, H, W, C], halved while its longer side is 128 or more
///   -> SmallCnn, ReLU           [N, 128]
///   -> linear                   K logits, K turns, an elevation, the logarithm of a distance
/// ```
///
/// The azimuth is one of `K` directions around the object, `2π k / K`, and a turn from it, at most as far as the next one:
/// an object that looks alike from two sides has two likely hypotheses, where a single regressed angle would lie between them.
///
/// ```
/// use autodiff_lite::Tape;
/// use nets::{Init, ViewpointHead};
///
/// let head = ViewpointHead::<f32>::new(&Init::new(0).at("viewpoint"), 3, 8);
/// let tape = Tape::eval();
/// let guess = head.forward(tape.constant(ndarray::Array4::zeros((2, 64, 64, 3))));
/// assert_eq!((guess.logits.shape(), guess.elevation.shape()), (vec![2, 8], vec![2]));
/// ```
///
/// # References
/// Mousavian et al. 2017, *3D bounding box estimation using deep learning and geometry* (MultiBin), for bins with residuals;
/// Goel et al. 2020, *Shape and viewpoint without keypoints* (U-CMR), for several cameras of which the outline chooses.
#[derive(Clone, Debug)]
pub struct ViewpointHead<F: Real = f32> {
    /// From the image to features.
    pub encoder: SmallCnn<F>,
    /// To all numbers of the guess, in the order of [`ViewpointGuess`].
    pub fc: Linear<F>,
}
impl_module!(ViewpointHead { encoder, fc });

/// What a [`ViewpointHead`] says of `N` images.
#[derive(Clone, Copy, Debug)]
pub struct ViewpointGuess<'t, F: Real = f32> {
    /// Of the directions, before softmax: `[N, K]`.
    pub logits: Var<'t, F>,
    /// From each direction to the azimuth, within `2π / K` on either side, radians: `[N, K]`.
    pub turns: Var<'t, F>,
    /// Radians above the horizon: `[N]`.
    pub elevation: Var<'t, F>,
    /// The logarithm of the distance over the focal length: `[N]`.
    pub log_distance: Var<'t, F>,
}

impl<F: Real> ViewpointHead<F> {
    /// For images with `channels` channels, with `hypotheses` directions.
    pub fn new(init: &Init, channels: usize, hypotheses: usize) -> Self {
        Self {
            encoder: SmallCnn::new(&init.at("encoder"), channels, FEATURES),
            fc: Linear::normal(&init.at("fc"), FEATURES, 2 * hypotheses + 2, DEVIATION),
        }
    }

    /// Trained numbers, without making them.
    pub fn parameters(channels: usize, hypotheses: usize) -> usize {
        let mut inputs = channels;
        let mut total = 0;
        for outputs in SmallCnn::<F>::CHANNELS {
            total += 9 * inputs * outputs + 2 * outputs;
            inputs = outputs;
        }
        let features = (16 * inputs + 1) * FEATURES + 2 * FEATURES;
        total + features + (FEATURES + 1) * (2 * hypotheses + 2)
    }

    /// Directions.
    pub fn hypotheses(&self) -> usize {
        (self.fc.weight.shape()[0] - 2) / 2
    }

    /// Lets guesses begin at this elevation and logarithm of the distance: those that the data has in the mean.
    pub fn begin_at(&mut self, elevation: f64, log_distance: f64) {
        let first = 2 * self.hypotheses();
        if let Some(bias) = &mut self.fc.bias {
            let bias = bias.as_slice_mut();
            (bias[first], bias[first + 1]) = (F::from_f64(elevation), F::from_f64(log_distance));
        }
    }

    /// What images show of their cameras.
    ///
    /// # Shapes
    /// `images [N, H, W, C]` → as [`ViewpointGuess`] says, `[N, K]` and `[N]`.
    #[track_caller]
    pub fn forward<'t>(&self, images: Var<'t, F>) -> ViewpointGuess<'t, F> {
        let mut x = images;
        loop {
            let [_, h, w, _] = x.dims();
            if h.max(w) < SIDE || h.min(w) < 2 {
                break;
            }
            x = x.adaptive_avg_pool2d(h / 2, w / 2);
        }
        let numbers = self.fc.forward(self.encoder.forward(x).relu());
        let k = self.hypotheses();
        let spacing = F::from_f64(TAU / k as f64);
        ViewpointGuess {
            logits: numbers.slice_axis(1, 0..k),
            turns: numbers.slice_axis(1, k..2 * k).tanh().scale(spacing),
            elevation: numbers.index_axis(1, 2 * k),
            log_distance: numbers.index_axis(1, 2 * k + 1),
        }
    }
}

#[cfg(test)]
mod tests {
    use autodiff_lite::{Module, Tape};
    use ndarray::Array4;

    use super::*;

    #[test]
    fn numbers_are_counted_and_begin_at_the_data() {
        let mut head = ViewpointHead::<f32>::new(&Init::new(0), 3, 8);
        assert_eq!(head.parameter_count(), ViewpointHead::<f32>::parameters(3, 8));
        head.begin_at(0.5, -0.4);
        let tape = Tape::train(0);
        let images = Array4::from_shape_fn((2, 130, 64, 3), |(n, i, j, c)| {
            ((7 * n + 3 * i + 5 * j + c) % 11) as f32 / 11.0
        });
        let guess = head.forward(tape.constant(images));
        assert_eq!((head.hypotheses(), guess.turns.shape()), (8, vec![2, 8]));
        let near = |x: Var<'_>, to: f32| x.value().iter().all(|x| (x - to).abs() < 0.3);
        assert!(near(guess.elevation, 0.5) && near(guess.log_distance, -0.4));
        assert!(near(guess.logits, 0.0) && near(guess.turns, 0.0));
        let sums = [guess.logits.square(), guess.turns.square()].map(|x| x.sum());
        let others = [guess.elevation, guess.log_distance].map(|x| x.square().sum());
        let gradients = (sums[0] + sums[1] + others[0] + others[1]).backward();
        head.visit("", &mut |path: &str, param: &autodiff_lite::Param| {
            assert!(gradients.of(param).is_some(), "{path}");
        });
    }
}
