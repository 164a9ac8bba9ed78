//! Initial values of parameters, under PyTorch's names.
//!
//! A value is a function of the seed and of the parameter's path, not of the order in which
//! layers are made: adding a head to a model leaves the other layers as they were.
//!
//! ```
//! use nets::{FanMode, Init, Nonlinearity};
//!
//! let init = Init::new(42);
//! let weight = init.at("encoder").at("conv1").at("weight");
//! let w = weight.kaiming_normal::<f32>(&[64, 3, 7, 7], FanMode::Out, Nonlinearity::Relu);
//! assert_eq!(w.shape(), [64, 3, 7, 7]);
//! // The same seed and path, the same numbers.
//! let again = Init::new(42).at("encoder.conv1.weight");
//! let again = again.kaiming_normal::<f32>(w.shape(), FanMode::Out, Nonlinearity::Relu);
//! assert_eq!(w.value, again.value);
//! ```

use std::hash::Hasher;

use autodiff_lite::{Param, Real, join_path};
use fnv::FnvHasher;
use ndarray::{ArrayD, IxDyn};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A seed and a path: where the initial values of a parameter come from.
///
/// Its methods make one parameter each, named after the functions of `torch.nn.init` and with
/// their formulas; the numbers are those of ChaCha8, not PyTorch's.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Init {
    seed: u64,
    path: String,
}

/// Which side of a weight keeps its variance: activations or gradients.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FanMode {
    /// `fan_in`: forward activations.
    In,
    /// `fan_out`: backward gradients.
    Out,
}

/// What follows a layer, for [its gain](Self::gain).
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Nonlinearity {
    /// Nothing, or a sigmoid: gain 1.
    Linear,
    /// `max(x, 0)`: gain `√2`.
    Relu,
    /// A leaky rectifier of this slope: gain `√(2 / (1 + slope²))`. PyTorch's own layers use `√5`.
    LeakyRelu(f64),
    /// The hyperbolic tangent: gain `5/3`.
    Tanh,
}

impl Nonlinearity {
    /// `torch.nn.init.calculate_gain`.
    pub fn gain(self) -> f64 {
        match self {
            Self::Linear => 1.0,
            Self::Relu => 2.0_f64.sqrt(),
            Self::LeakyRelu(slope) => (2.0 / (1.0 + slope * slope)).sqrt(),
            Self::Tanh => 5.0 / 3.0,
        }
    }
}

/// `(fan_in, fan_out)` of a weight `[O, I, ..]`: `I` and `O`, each times the window's elements.
///
/// As PyTorch counts, for a transposed convolution `[C, O, KH, KW]` too, whose fans are thus
/// exchanged.
///
/// # Panics
/// If the weight has fewer than two axes.
pub fn fans(shape: &[usize]) -> (usize, usize) {
    let [o, i, window @ ..] = shape else {
        panic!("a weight of shape {shape:?} has no fans: at least two axes expected")
    };
    let window: usize = window.iter().product();
    (i * window, o * window)
}

impl Init {
    /// At the root of a model.
    pub fn new(seed: u64) -> Self {
        Self { seed, path: String::new() }
    }

    /// The same seed at a path below this one; dots are path separators.
    #[must_use]
    pub fn at(&self, name: &str) -> Self {
        Self { seed: self.seed, path: join_path(&self.path, name) }
    }

    /// The same seed at the `index`th part.
    #[must_use]
    pub fn index(&self, index: usize) -> Self {
        self.at(&index.to_string())
    }

    /// The path so far.
    pub fn path(&self) -> &str {
        &self.path
    }

    /// All the same number.
    pub fn constant<F: Real>(&self, shape: &[usize], value: f64) -> Param<F> {
        Param::new(ArrayD::from_elem(IxDyn(shape), F::from_f64(value)))
    }

    /// All 0.
    pub fn zeros<F: Real>(&self, shape: &[usize]) -> Param<F> {
        self.constant(shape, 0.0)
    }

    /// All 1.
    pub fn ones<F: Real>(&self, shape: &[usize]) -> Param<F> {
        self.constant(shape, 1.0)
    }

    /// Evenly from `[low, high]`.
    pub fn uniform<F: Real>(&self, shape: &[usize], low: f64, high: f64) -> Param<F> {
        let mut rng = self.rng();
        let draw = || F::from_f64(low + (high - low) * unit(&mut rng));
        Param::new(ArrayD::from_shape_simple_fn(IxDyn(shape), draw))
    }

    /// Gaussian.
    pub fn normal<F: Real>(&self, shape: &[usize], mean: f64, deviation: f64) -> Param<F> {
        let mut rng = self.rng();
        let mut second = None;
        // Box and Muller 1958: two uniform numbers give two Gaussian ones.
        let draw = || {
            let z: f64 = second.take().unwrap_or_else(|| {
                let radius = (-2.0 * (1.0 - unit(&mut rng)).ln()).sqrt();
                let (sine, cosine) = (std::f64::consts::TAU * unit(&mut rng)).sin_cos();
                second = Some(radius * sine);
                radius * cosine
            });
            F::from_f64(mean + deviation * z)
        };
        Param::new(ArrayD::from_shape_simple_fn(IxDyn(shape), draw))
    }

    /// Evenly within `±gain √(3 / fan)`.
    ///
    /// # References
    /// He et al. 2015, *Delving deep into rectifiers*, section 2.2.
    pub fn kaiming_uniform<F: Real>(
        &self,
        shape: &[usize],
        mode: FanMode,
        nonlinearity: Nonlinearity,
    ) -> Param<F> {
        let bound = 3.0_f64.sqrt() * kaiming_deviation(shape, mode, nonlinearity);
        self.uniform(shape, -bound, bound)
    }

    /// Gaussian with deviation `gain / √fan`.
    ///
    /// # References
    /// He et al. 2015, *Delving deep into rectifiers*, section 2.2.
    pub fn kaiming_normal<F: Real>(
        &self,
        shape: &[usize],
        mode: FanMode,
        nonlinearity: Nonlinearity,
    ) -> Param<F> {
        self.normal(shape, 0.0, kaiming_deviation(shape, mode, nonlinearity))
    }

    /// Evenly within `±gain √(6 / (fan_in + fan_out))`.
    ///
    /// # References
    /// Glorot and Bengio 2010, *Understanding the difficulty of training deep feedforward neural
    /// networks*, equation 16.
    pub fn xavier_uniform<F: Real>(&self, shape: &[usize], gain: f64) -> Param<F> {
        let bound = 3.0_f64.sqrt() * xavier_deviation(shape, gain);
        self.uniform(shape, -bound, bound)
    }

    /// Gaussian with deviation `gain √(2 / (fan_in + fan_out))`.
    ///
    /// # References
    /// As [`xavier_uniform`](Self::xavier_uniform).
    pub fn xavier_normal<F: Real>(&self, shape: &[usize], gain: f64) -> Param<F> {
        self.normal(shape, 0.0, xavier_deviation(shape, gain))
    }

    /// What PyTorch's linear and convolution layers give their weights: evenly within
    /// `±1 / √fan_in`, which is `kaiming_uniform` for a leaky rectifier of slope `√5`.
    pub fn layer_weight<F: Real>(&self, shape: &[usize]) -> Param<F> {
        self.kaiming_uniform(shape, FanMode::In, Nonlinearity::LeakyRelu(5.0_f64.sqrt()))
    }

    /// What PyTorch's linear and convolution layers give the bias `[outputs]` beside a weight of
    /// this shape: evenly within `±1 / √fan_in`.
    pub fn layer_bias<F: Real>(&self, outputs: usize, weight: &[usize]) -> Param<F> {
        let bound = 1.0 / (fans(weight).0.max(1) as f64).sqrt();
        self.uniform(&[outputs], -bound, bound)
    }

    fn rng(&self) -> ChaCha8Rng {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        // The same on every machine and release, as the standard library's hashes need not be.
        let mut hash = FnvHasher::default();
        hash.write(self.path.as_bytes());
        rng.set_stream(hash.finish());
        rng
    }
}

fn kaiming_deviation(shape: &[usize], mode: FanMode, nonlinearity: Nonlinearity) -> f64 {
    let (fan_in, fan_out) = fans(shape);
    let fan = if mode == FanMode::In { fan_in } else { fan_out };
    nonlinearity.gain() / (fan.max(1) as f64).sqrt()
}

fn xavier_deviation(shape: &[usize], gain: f64) -> f64 {
    let (fan_in, fan_out) = fans(shape);
    gain * (2.0 / (fan_in + fan_out).max(1) as f64).sqrt()
}

/// A number in `[0, 1)` of 32 random bits.
fn unit(rng: &mut ChaCha8Rng) -> f64 {
    f64::from(rng.next_u32()) * 2.0_f64.powi(-32)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Initial values stay what they were: the stream is the path's FNV-1a, by its published values.
    #[test]
    fn streams_are_hashes_of_paths() {
        assert_eq!(Init::new(3).at("foobar").rng().get_stream(), 0x8594_4171_f739_67e8);
        assert_eq!(Init::new(3).rng().get_stream(), 0xcbf2_9ce4_8422_2325);
    }

    const SHAPE: [usize; 4] = [128, 64, 3, 3]; // fans 576 and 1152, 73,728 elements

    fn moments(param: &Param<f32>) -> (f64, f64, f64) {
        let n = param.len() as f64;
        let mean = param.value.iter().map(|&x| x as f64).sum::<f64>() / n;
        let square = |x: &f32| (*x as f64 - mean).powi(2);
        let variance = param.value.iter().map(square).sum::<f64>() / n;
        let largest = param.value.iter().fold(0.0_f64, |l, &x| l.max((x as f64).abs()));
        (mean, variance.sqrt(), largest)
    }

    /// The sample deviation of n numbers errs by about 1/√(2n) = 0.3 %; uniform ones by less.
    fn assert_spread(param: &Param<f32>, deviation: f64, bound: Option<f64>) {
        let (mean, found, largest) = moments(param);
        assert!(mean.abs() < 4.0 * deviation / (param.len() as f64).sqrt(), "mean {mean}");
        assert!((found / deviation - 1.0).abs() < 0.012, "{found} instead of {deviation}");
        if let Some(bound) = bound {
            assert!(largest <= bound * (1.0 + 1e-6) && largest > 0.999 * bound, "{largest}");
        } else {
            // Tails: among 73,728 Gaussian numbers the largest lies near 4.4 deviations.
            assert!((3.6..6.0).contains(&(largest / deviation)), "{largest}");
        }
    }

    /// Bounds and deviations written out from PyTorch's documentation.
    #[test]
    fn spreads_are_those_of_pytorch() {
        let init = Init::new(1).at("w");
        let relu = Nonlinearity::Relu;
        let u = init.kaiming_uniform(&SHAPE, FanMode::In, relu);
        assert_spread(&u, (2.0_f64 / 576.0).sqrt(), Some((6.0_f64 / 576.0).sqrt()));
        let u = init.kaiming_uniform(&SHAPE, FanMode::Out, Nonlinearity::LeakyRelu(0.2));
        let deviation = (2.0_f64 / 1.04 / 1152.0).sqrt();
        assert_spread(&u, deviation, Some(deviation * 3.0_f64.sqrt()));
        let n = init.kaiming_normal(&SHAPE, FanMode::Out, relu);
        assert_spread(&n, (2.0_f64 / 1152.0).sqrt(), None);
        let u = init.xavier_uniform(&SHAPE, 1.0);
        assert_spread(&u, (2.0_f64 / 1728.0).sqrt(), Some((6.0_f64 / 1728.0).sqrt()));
        let n = init.xavier_normal(&SHAPE, Nonlinearity::Tanh.gain());
        assert_spread(&n, 5.0 / 3.0 * (2.0_f64 / 1728.0).sqrt(), None);
        let d = init.layer_weight(&SHAPE);
        assert_spread(&d, 1.0 / (3.0 * 576.0_f64).sqrt(), Some(1.0 / 24.0));
        let b = init.layer_bias::<f32>(100_000, &SHAPE);
        assert_spread(&b, 1.0 / (3.0 * 576.0_f64).sqrt(), Some(1.0 / 24.0));
    }

    #[test]
    fn normal_numbers_are_normal() {
        let z = Init::new(3).normal::<f32>(&[100_000], 0.0, 1.0);
        let within = |d: f32| z.value.iter().filter(|x| x.abs() < d).count() as f64 / 1e5;
        // The Gaussian distribution within 1, 2 and 3 deviations; errors of a sample below 0.002.
        for (d, expected) in [(1.0, 0.6827), (2.0, 0.9545), (3.0, 0.9973)] {
            assert!((within(d) - expected).abs() < 0.005, "{d}: {}", within(d));
        }
        // Neighbours share a draw of Box and Muller; they are still independent.
        let z = z.as_slice();
        let product: f64 = z.chunks(2).map(|p| (p[0] * p[1]) as f64).sum::<f64>() / 5e4;
        assert!(product.abs() < 0.02, "{product}");
    }

    #[test]
    fn seed_and_path_decide_and_nothing_else() {
        let draw = |seed, path: &str| Init::new(seed).at(path).uniform::<f32>(&[4], 0.0, 1.0).value;
        assert_eq!(
            draw(1, "a.b"),
            Init::new(1).at("a").at("b").uniform::<f32>(&[4], 0.0, 1.0).value
        );
        assert_ne!(draw(1, "a.b"), draw(2, "a.b"));
        assert_ne!(draw(1, "a.b"), draw(1, "a.c"));
        // The stream does not drift with releases.
        let expected = draw(0, "layers.0.weight");
        assert_eq!(
            expected,
            Init::new(0).at("layers").index(0).at("weight").uniform::<f32>(&[4], 0.0, 1.0).value
        );
    }

    #[test]
    fn fans_count_as_in_pytorch() {
        assert_eq!(fans(&[5, 7]), (7, 5));
        assert_eq!(fans(&[5, 7, 3, 2]), (42, 30));
        assert_eq!(Nonlinearity::LeakyRelu(5.0_f64.sqrt()).gain(), (1.0_f64 / 3.0).sqrt());
    }
}
