//! Batch normalisation, with running or frozen statistics.

use autodiff_lite::{Activation, BufferUpdate, Param, Real, Var, impl_module};

use crate::Init;

/// Batch norm over all axes but the last, as `torch.nn.BatchNorm2d`.
///
/// On a training tape it normalises with the statistics of the batch and notes the change of its
/// running ones ([`Tape::take_updates`](autodiff_lite::Tape::take_updates)); on an eval tape it
/// uses those, with gradients to input, weight and bias where the tape
/// [records](autodiff_lite::Tape::eval_with_gradients). `num_batches_tracked` of PyTorch's files is not kept.
///
/// ```
/// use autodiff_lite::Tape;
/// use nets::{BatchNorm2d, Init};
///
/// let mut norm = BatchNorm2d::<f32>::new(&Init::new(0), 4);
/// let mut tape = Tape::train(0);
/// let y = norm.forward(tape.constant(ndarray::Array4::ones((2, 3, 3, 4))));
/// assert_eq!(y.value().sum(), 0.0);
/// let updates = tape.take_updates();
/// tape.reset();
/// updates.apply(&mut norm); // together with the optimiser's step
/// assert!((norm.running_mean.value[0] - 0.1).abs() < 1e-7);
/// ```
///
/// # References
/// Ioffe and Szegedy 2015, *Batch normalization*, algorithms 1 and 2.
#[derive(Clone, Debug)]
pub struct BatchNorm2d<F: Real = f32> {
    /// `[C]`.
    pub weight: Param<F>,
    /// `[C]`.
    pub bias: Param<F>,
    /// `[C]`; not trained.
    pub running_mean: Param<F>,
    /// `[C]`, unbiased; not trained.
    pub running_var: Param<F>,
    /// Added to the variance.
    pub eps: f64,
    /// The part of a batch's statistics in the new running ones.
    pub momentum: f64,
}
impl_module!(BatchNorm2d { weight, bias, running_mean, running_var } fixed { eps, momentum });

/// Batch norm of rows `[N, C]`, or `[N, L, C]`; as `torch.nn.BatchNorm1d`. Features being last,
/// it is the same layer.
pub type BatchNorm1d<F = f32> = BatchNorm2d<F>;

impl<F: Real> BatchNorm2d<F> {
    /// PyTorch's defaults: the identity, `eps` 1e-5, `momentum` 0.1.
    pub fn new(init: &Init, channels: usize) -> Self {
        let frozen = FrozenBatchNorm2d::new(init, channels);
        Self {
            weight: init.at("weight").ones(&[channels]),
            bias: init.at("bias").zeros(&[channels]),
            running_mean: frozen.running_mean,
            running_var: frozen.running_var,
            eps: 1e-5,
            momentum: 0.1,
        }
    }

    forward! {
        /// By the statistics of the batch on a training tape, else by those that run along. A batch of one value for each channel has no
        /// variance: the result is the bias, and what runs along stays (PyTorch refuses it).
        ///
        /// # Shapes
        /// `x [.., C]` → `[.., C]`.
        |self, x, activation| {
            let tape = x.tape();
            let (weight, bias) = (tape.param(&self.weight), tape.param(&self.bias));
            if !tape.is_training() {
                if tape.wants_grad(&[weight, bias]) {
                    return self.with_running_statistics(x, [weight, bias], activation);
                }
                return affine(x, self.scale_and_shift(), activation);
            }
            let (y, seen) = x.batch_norm(weight, bias, self.eps, activation);
            if x.len() > self.weight.len() {
                let momentum = F::from_f64(self.momentum);
                tape.push_update(BufferUpdate::new(&self.running_mean, seen.mean, momentum));
                tape.push_update(BufferUpdate::new(&self.running_var, seen.variance, momentum));
            }
            y
        }
    }

    /// `(x - mean) / sqrt(variance + eps) · weight + bias` on the tape, the statistics as constants.
    #[track_caller]
    fn with_running_statistics<'t>(
        &self,
        x: Var<'t, F>,
        [weight, bias]: [Var<'t, F>; 2],
        activation: Activation,
    ) -> Var<'t, F> {
        let tape = x.tape();
        let root = |&variance: &F| (variance + F::from_f64(self.eps)).sqrt();
        let roots = ndarray::Array1::from_iter(self.running_var.as_slice().iter().map(root));
        let scale = weight.div(tape.constant(roots));
        let shift = bias.sub(tape.constant(self.running_mean.value.clone()).mul(scale));
        crate::activate(x.mul(scale).add(shift), activation)
    }

    /// What it is with its running statistics: `x scale + shift`.
    pub(crate) fn scale_and_shift(&self) -> [Vec<F>; 2] {
        fold([&self.weight, &self.bias, &self.running_mean, &self.running_var], self.eps)
    }
}

/// Batch norm whose statistics and weights are never trained, as
/// `torchvision.ops.FrozenBatchNorm2d`: an affine map of each channel on either tape.
#[derive(Clone, Debug)]
pub struct FrozenBatchNorm2d<F: Real = f32> {
    /// `[C]`; not trained.
    pub weight: Param<F>,
    /// `[C]`; not trained.
    pub bias: Param<F>,
    /// `[C]`; not trained.
    pub running_mean: Param<F>,
    /// `[C]`; not trained.
    pub running_var: Param<F>,
    /// Added to the variance.
    pub eps: f64,
}
impl_module!(FrozenBatchNorm2d { weight, bias, running_mean, running_var } fixed { eps });

impl<F: Real> FrozenBatchNorm2d<F> {
    /// The identity (but for `eps`, 1e-5), to be loaded.
    pub fn new(init: &Init, channels: usize) -> Self {
        let buffer = |name: &str, value: f64| {
            Param::buffer(init.at(name).constant(&[channels], value).value)
        };
        Self {
            weight: buffer("weight", 1.0),
            bias: buffer("bias", 0.0),
            running_mean: buffer("running_mean", 0.0),
            running_var: buffer("running_var", 1.0),
            eps: 1e-5,
        }
    }

    forward! {
        /// By the statistics that are kept; the gradient goes to `x` alone.
        ///
        /// # Shapes
        /// `x [.., C]` → `[.., C]`.
        |self, x, activation| {
            affine(x, self.scale_and_shift(), activation)
        }
    }

    /// What it is: `x scale + shift`.
    pub(crate) fn scale_and_shift(&self) -> [Vec<F>; 2] {
        fold([&self.weight, &self.bias, &self.running_mean, &self.running_var], self.eps)
    }
}

/// Scale and shift of `(x - mean) / sqrt(variance + eps) · w + b`.
fn fold<F: Real>(params: [&Param<F>; 4], eps: f64) -> [Vec<F>; 2] {
    let [w, b, mean, variance] = params.map(Param::as_slice);
    let scale = |(&w, &variance): (&F, &F)| w / (variance + F::from_f64(eps)).sqrt();
    let scale: Vec<F> = w.iter().zip(variance).map(scale).collect();
    let shift = b.iter().zip(mean).zip(&scale).map(|((&b, &mean), &s)| b - mean * s).collect();
    [scale, shift]
}

#[track_caller]
fn affine<F: Real>(x: Var<'_, F>, factors: [Vec<F>; 2], activation: Activation) -> Var<'_, F> {
    let [scale, shift] = factors.map(|v| x.tape().constant(ndarray::Array1::from_vec(v)));
    crate::activate(x.mul(scale).add(shift), activation)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use autodiff_lite::testkit::{Options, check, function};
    use autodiff_lite::{Module, Tape};
    use ndarray::{Array, Array2, Array4, arr1, arr2};

    use super::*;

    fn wavy(seed: f64) -> Param<f64> {
        Param::new(Array::from_shape_fn(3, |i| 1.0 + 0.3 * (seed + i as f64).sin()))
    }

    #[test]
    fn running_statistics_follow_pytorch() {
        // Batch (1, 3): mean 2, unbiased variance 2. After one step 0.1 * 2 and 0.9 + 0.1 * 2.
        let mut norm = BatchNorm1d::<f32>::new(&Init::new(0), 1);
        let mut tape = Tape::train(0);
        let y = norm.forward(tape.constant(arr2(&[[1.0], [3.0]]))).value();
        assert!((y[[0, 0]] + 1.0).abs() < 1e-4 && (y[[1, 0]] - 1.0).abs() < 1e-4);
        drop(y);
        let updates = tape.take_updates();
        tape.reset();
        updates.apply(&mut norm);
        assert!((norm.running_mean.value[0] - 0.2).abs() < 1e-6);
        assert!((norm.running_var.value[0] - 1.1).abs() < 1e-6);
        // And an eval tape uses them: (x - 0.2) / sqrt(1.1 + 1e-5).
        let tape = Tape::eval();
        let y = norm.forward(tape.constant(arr2(&[[1.0]]))).value();
        assert!((y[[0, 0]] - 0.8 / 1.10001_f32.sqrt()).abs() < 1e-6);
    }

    /// PyTorch's `model.eval()` outside of `no_grad`: values of evaluation, gradients to everything that is trained.
    #[test]
    fn evaluation_has_gradients_where_the_tape_records() {
        let mut norm = BatchNorm2d::<f64>::new(&Init::new(0), 3);
        (norm.running_mean.value, norm.running_var.value) = (wavy(1.0).value, wavy(2.0).value);
        let x = Array4::from_shape_fn((2, 2, 2, 3), |(n, i, j, c)| {
            ((3 * n + 5 * i + 7 * j + 2 * c) as f64).sin()
        });
        let tape = Tape::eval_with_gradients();
        let leaf = tape.leaf(x.clone());
        let y = norm.forward_then(leaf, Activation::Tanh);
        let plain = Tape::eval();
        assert_eq!(
            y.value(),
            norm.forward_then(plain.constant(x.clone()), Activation::Tanh).value()
        );
        assert!(tape.take_updates().is_empty(), "statistics stay");
        let gradients = y.square().sum().backward();
        let loss = |norm: &BatchNorm2d<f64>, x: &Array4<f64>| {
            let tape = Tape::eval();
            norm.forward_then(tape.constant(x.clone()), Activation::Tanh).square().sum().item()
        };
        let step = 1e-6;
        for c in 0..3 {
            type Field = fn(&mut BatchNorm2d<f64>) -> &mut Param<f64>;
            let changed = |field: Field, by: f64| {
                let mut norm = norm.clone();
                field(&mut norm).as_slice_mut()[c] += by;
                loss(&norm, &x)
            };
            let fields: [Field; 2] = [|norm| &mut norm.weight, |norm| &mut norm.bias];
            for (field, param) in fields.into_iter().zip([&norm.weight, &norm.bias]) {
                let expected = (changed(field, step) - changed(field, -step)) / (2.0 * step);
                let found = gradients.of(param).unwrap()[c];
                assert!((found - expected).abs() < 1e-7, "{found} {expected}");
            }
        }
        let mut moved = x.clone();
        moved[[1, 0, 1, 2]] += step;
        let expected = (loss(&norm, &moved) - loss(&norm, &x)) / step;
        assert!((gradients.wrt(leaf).unwrap()[[1, 0, 1, 2]] - expected).abs() < 1e-5);
    }

    #[test]
    fn frozen_norms_have_a_gradient_to_their_input_alone() {
        let mut norm = FrozenBatchNorm2d::<f64>::new(&Init::new(0), 3);
        assert_eq!(norm.parameter_count(), 0);
        (norm.running_mean, norm.running_var) = (wavy(1.0), wavy(2.0));
        (norm.weight, norm.bias) = (wavy(3.0), wavy(4.0));
        let f = function(|v| norm.forward_then(v[0], Activation::Tanh));
        let options = Options::default();
        check(&f, &options.draw(&[vec![2, 2, 2, 3]]), &options).unwrap();
    }

    #[test]
    fn a_trained_norm_equals_a_frozen_one_when_evaluated() {
        let mut norm = BatchNorm2d::<f32>::new(&Init::new(0), 2);
        norm.running_mean = Param::buffer(arr1(&[0.5, -1.0]));
        norm.running_var = Param::buffer(arr1(&[2.0, 0.25]));
        norm.weight = Param::new(arr1(&[3.0, -2.0]));
        let mut frozen = FrozenBatchNorm2d::<f32>::new(&Init::new(0), 2);
        frozen.weight = norm.weight.clone();
        (frozen.running_mean, frozen.running_var) =
            (norm.running_mean.clone(), norm.running_var.clone());
        let tape = Tape::eval();
        let x = Array4::from_shape_fn((1, 2, 2, 2), |(_, i, j, c)| (i + 2 * j + 3 * c) as f32);
        let x = tape.constant(x);
        let relu = Activation::Relu;
        assert_eq!(norm.forward_then(x, relu).value(), frozen.forward_then(x, relu).value());
        let tape = Tape::train(0);
        let _ = norm.forward(tape.constant(Array2::zeros((3, 2))));
        assert!(!tape.take_updates().is_empty());
    }
}
