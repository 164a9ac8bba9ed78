//! Layer, group and batch normalisation, with the activation in the same pass.

use crate::kernels::activation::Activation;
use crate::kernels::norm::{self, NormSizes, Statistics};
use crate::{Backward, PoolVec, Real, Tensor, Var};

use super::linear::{before_activation, check_activation};

/// What a batch norm measured, for running averages
/// ([`BufferUpdate`](crate::BufferUpdate)).
#[derive(Debug)]
#[non_exhaustive]
pub struct BatchStatistics<F: Real = f32> {
    /// Mean of each channel.
    pub mean: PoolVec<F>,
    /// Unbiased variance of each channel, as PyTorch keeps it.
    pub variance: PoolVec<F>,
}

impl<F: Real> Var<'_, F> {
    /// Layer norm over the last axis:
    ///
    /// ```text
    /// y = activation( (x - mean) / sqrt(variance + epsilon) · weight + bias )
    /// ```
    ///
    /// Ba et al. 2016, *Layer Normalization*; variance biased, as everywhere.
    ///
    /// # Shapes
    /// `self [.., D]`, `weight [D]`, `bias [D]` → `[.., D]`.
    ///
    /// # Panics
    /// If `D` differs.
    #[track_caller]
    #[inline(never)]
    pub fn layer_norm(
        self,
        weight: Self,
        bias: Self,
        epsilon: f64,
        activation: Activation,
    ) -> Self {
        check_activation(self.tape, "layer_norm", activation);
        let x = self.value();
        let (w, b) = self.norm_operands("layer_norm", weight, bias);
        let rows = x.len().checked_div(w.len()).unwrap_or(0);
        let mut y = self.tape.array(x.shape());
        let mut stats = self.tape.buffer(2 * rows);
        norm::layer_norm(
            x.as_slice(),
            [w.as_slice(), b.as_slice()],
            F::from_f64(epsilon),
            activation,
            y.as_slice_mut(),
            &mut stats,
        );
        let rule = move |cx: &mut Backward<'_, F>| {
            let (x, w) = (cx.input(0), cx.input(1));
            let g = before_activation(cx, activation);
            give_all(cx, g, |g, grads| {
                norm::layer_norm_grad(x.as_slice(), &stats, w.as_slice(), g, grads);
            });
        };
        self.tape.record_fn("layer_norm", &[self, weight, bias], y, rule)
    }

    /// Group norm: statistics per element of the batch and group of neighbouring channels. The formula is that of
    /// [`layer_norm`](Self::layer_norm). With as many groups as channels it is instance norm.
    ///
    /// Wu and He 2018, *Group Normalization*.
    ///
    /// # Shapes
    /// `self [N, .., C]`, `weight [C]`, `bias [C]` → `[N, .., C]`.
    ///
    /// # Panics
    /// If `C` differs, or is not a multiple of `groups`.
    #[track_caller]
    #[inline(never)]
    pub fn group_norm(
        self,
        groups: usize,
        weight: Self,
        bias: Self,
        epsilon: f64,
        activation: Activation,
    ) -> Self {
        let (w, _) = self.norm_operands("group_norm", weight, bias);
        let shape = self.shape();
        let channels = w.len();
        let refuse = |message: String| {
            self.tape.refuse("group_norm", message, &[("input", &shape, "N, .., C")])
        };
        if shape.len() < 2 {
            refuse(format!("input has {} axes instead of 2 or more", shape.len()));
        }
        if groups == 0 || !channels.is_multiple_of(groups) {
            refuse(format!("{groups} groups do not divide the channels"));
        }
        let rows = shape[1..shape.len() - 1].iter().product();
        let sizes = NormSizes { sets: shape[0], rows, channels, groups };
        self.normalized("group_norm", sizes, weight, bias, epsilon, activation).0
    }

    /// Batch norm with the statistics of this batch, each channel over all else. The formula is that of
    /// [`layer_norm`](Self::layer_norm).
    ///
    /// Ioffe and Szegedy 2015, *Batch Normalization*. With running statistics the layer is
    /// affine: `x.mul(scale).add(shift)`.
    ///
    /// # Shapes
    /// `self [.., C]`, `weight [C]`, `bias [C]` → `[.., C]`, and the statistics, `C` of each kind.
    ///
    /// # Panics
    /// If `C` differs.
    #[track_caller]
    #[inline(never)]
    pub fn batch_norm(
        self,
        weight: Self,
        bias: Self,
        epsilon: f64,
        activation: Activation,
    ) -> (Self, BatchStatistics<F>) {
        let (w, _) = self.norm_operands("batch_norm", weight, bias);
        let channels = w.len();
        let rows = self.len().checked_div(channels).unwrap_or(0);
        let sizes = NormSizes { sets: 1, rows, channels, groups: channels.max(1) };
        let (y, mean, mut variance) =
            self.normalized("batch_norm", sizes, weight, bias, epsilon, activation);
        let unbiased = F::from_f64(rows as f64 / rows.saturating_sub(1).max(1) as f64);
        for variance in variance.iter_mut() {
            *variance *= unbiased;
        }
        (y, BatchStatistics { mean, variance })
    }

    #[track_caller]
    fn norm_operands(self, op: &'static str, weight: Self, bias: Self) -> (Tensor<F>, Tensor<F>) {
        let (x, w, b) = (self.value(), weight.value(), bias.value());
        self.tape.check(op, |shapes| {
            shapes.last_axes("input", x.shape(), ["C"])?;
            shapes.axes("weight", w.shape(), ["C"])?;
            shapes.axes("bias", b.shape(), ["C"])?;
            Ok(())
        });
        (w, b)
    }

    #[track_caller]
    fn normalized(
        self,
        name: &'static str,
        sizes: NormSizes,
        weight: Self,
        bias: Self,
        epsilon: f64,
        activation: Activation,
    ) -> (Self, PoolVec<F>, PoolVec<F>) {
        check_activation(self.tape, name, activation);
        let (x, w, b) = (self.value(), weight.value(), bias.value());
        let xs = x.as_slice();
        let count = sizes.sets * sizes.groups;
        let [mut mean, mut variance, mut inverse, mut kept] =
            [(); 4].map(|()| self.tape.buffer(count));
        norm::statistics(sizes, xs, &mut mean, &mut variance);
        for (inverse, &variance) in inverse.iter_mut().zip(variance.iter()) {
            *inverse = F::one() / (variance + F::from_f64(epsilon)).sqrt();
        }
        kept.copy_from_slice(&mean);
        let mut y = self.tape.array(x.shape());
        norm::normalize(
            sizes,
            xs,
            &Statistics { mean: &mean, inverse: &inverse },
            [w.as_slice(), b.as_slice()],
            activation,
            y.as_slice_mut(),
        );
        let rule = move |cx: &mut Backward<'_, F>| {
            let [x, w, b] = [0, 1, 2].map(|i| cx.input(i));
            // A ReLU is undone on the way, without a pass of its own over all that memory.
            let relu = activation == Activation::Relu;
            let g = if relu { cx.take_grad_out() } else { before_activation(cx, activation) };
            let statistics = Statistics { mean: &kept, inverse: &inverse };
            give_all(cx, g, |g, grads| {
                let [x, w, b] = [&x, &w, &b].map(Tensor::as_slice);
                norm::normalize_grad(sizes, x, &statistics, [w, b], relu, g, grads);
            });
        };
        (self.tape.record_fn(name, &[self, weight, bias], y, rule), mean, variance)
    }
}

/// Gives weight and bias their gradients, which `f` adds to zeros, and `g` to the input.
fn give_all<F: Real>(
    cx: &mut Backward<'_, F>,
    mut g: Tensor<F>,
    f: impl FnOnce(&mut [F], [&mut [F]; 2]),
) {
    let [mut gw, mut gb] = [1, 2].map(|i| cx.pool().filled(cx.input(i).shape(), F::zero()));
    f(g.as_slice_mut(), [gw.as_slice_mut(), gb.as_slice_mut()]);
    cx.give(0, g);
    cx.give(1, gw);
    cx.give(2, gb);
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use crate::Tape;
    use crate::kernels::activation::Activation;
    use crate::testkit::{Options, gradcheck};
    use ndarray::{Array4, arr1, arr2};

    const SAME: Activation = Activation::None;

    fn loose() -> Options {
        Options::default().tolerance(1e-6)
    }

    #[test]
    #[should_panic(expected = "group_norm: input has 1 axes instead of 2 or more")]
    fn groups_need_a_batch() {
        let tape = crate::Tape::<f32>::eval();
        let [x, w, b] = [(); 3].map(|()| tape.constant(vec![1.0, 2.0]));
        let _ = x.group_norm(1, w, b, 1e-5, Activation::None);
    }

    gradcheck!(layer: |x, w, b| x.layer_norm(w, b, 1e-3, SAME),
        shapes [[[3, 5], [5], [5]], [[2, 3, 17], [17], [17]], [[4, 1], [1], [1]]], options loose());
    gradcheck!(layer_then_tanh: |x, w, b| x.layer_norm(w, b, 1e-3, Activation::Tanh),
        shapes [[[3, 5], [5], [5]]], options loose());
    gradcheck!(group: |x, w, b| x.group_norm(3, w, b, 1e-3, SAME),
        shapes [[[2, 3, 5, 6], [6], [6]], [[1, 1, 1, 3], [3], [3]], [[2, 4, 9], [9], [9]]], options loose());
    gradcheck!(batch: |x, w, b| x.batch_norm(w, b, 1e-3, SAME).0,
        shapes [[[2, 3, 5, 3], [3], [3]], [[7, 1], [1], [1]], [[5, 17], [17], [17]]], options loose());
    gradcheck!(batch_then_sigmoid: |x, w, b| x.batch_norm(w, b, 1e-3, Activation::Sigmoid).0,
        shapes [[[2, 3, 5, 3], [3], [3]]], options loose());

    // The ReLU's kink lies away from these numbers by more than the checks' step.
    gradcheck!(batch_then_relu: |x, w, b| x.batch_norm(w, b, 1e-3, Activation::Relu).0,
        shapes [[[2, 3, 5, 3], [3], [3]], [[5, 17], [17], [17]]], options loose());
    gradcheck!(group_then_relu: |x, w, b| x.group_norm(2, w, b, 1e-3, Activation::Relu),
        shapes [[[2, 3, 5, 6], [6], [6]]], options loose());

    /// Far from zero, where squares would drown a variance; few rows and many, of which a few are sampled.
    #[test]
    fn statistics_far_from_zero() {
        let tape = Tape::<f32>::eval();
        for rows in [3, 20, 5000] {
            let x = ndarray::Array2::from_shape_fn((rows, 2), |(i, c)| {
                1000.0 * c as f32 + ((i * 7919) % 101) as f32 / 100.0
            });
            let [w, b] = [1.0_f32, 0.0].map(|x| tape.constant(arr1(&[x, x])));
            let (_, found) = tape.constant(x.clone()).batch_norm(w, b, 1e-5, SAME);
            for c in 0..2 {
                let column: Vec<f64> = x.column(c).iter().map(|&x| f64::from(x)).collect();
                let mean = column.iter().sum::<f64>() / rows as f64;
                let squares: f64 = column.iter().map(|x| (x - mean).powi(2)).sum();
                let variance = squares / (rows - 1) as f64;
                assert!((f64::from(found.mean[c]) - mean).abs() < 1e-6 * mean.max(1.0));
                let error = (f64::from(found.variance[c]) / variance - 1.0).abs();
                assert!(error < 1e-4, "{rows} rows, channel {c}: {error}");
            }
        }
    }

    fn image(f: impl Fn(usize) -> f32) -> Array4<f32> {
        Array4::from_shape_vec((2, 3, 4, 4), (0..96).map(f).collect()).unwrap()
    }

    /// Derived from the definition, one number at a time.
    #[test]
    fn group_and_batch_norm_by_definition() {
        let x = image(|i| ((i * 37 + 11) % 53) as f32 / 10.0);
        let (w, b) = ([1.0_f32, 2.0, -1.0, 0.5], [0.0_f32, 1.0, 0.25, -3.0]);
        let tape = Tape::<f32>::train(0);
        let [xv, wv, bv] = [tape.leaf(x.clone()), tape.leaf(arr1(&w)), tape.leaf(arr1(&b))];
        let group = xv.group_norm(2, wv, bv, 1e-5, Activation::Relu).value();
        let (batch, statistics) = xv.batch_norm(wv, bv, 1e-5, SAME);
        let batch = batch.value();
        for ((n, i, j, c), &value) in x.indexed_iter() {
            let set = |same: &dyn Fn(usize, usize) -> bool| {
                let all: Vec<f64> = x
                    .indexed_iter()
                    .filter(|((m, _, _, k), _)| same(*m, *k))
                    .map(|(_, &x)| x as f64)
                    .collect();
                let mean = all.iter().sum::<f64>() / all.len() as f64;
                let variance =
                    all.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / all.len() as f64;
                (mean, variance, all.len() as f64)
            };
            let (mean, variance, _) = set(&|m, k| m == n && k / 2 == c / 2);
            let y = (value as f64 - mean) / (variance + 1e-5).sqrt() * w[c] as f64 + b[c] as f64;
            assert!((group[[n, i, j, c]] as f64 - y.max(0.0)).abs() < 1e-5);
            let (mean, variance, count) = set(&|_, k| k == c);
            let y = (value as f64 - mean) / (variance + 1e-5).sqrt() * w[c] as f64 + b[c] as f64;
            assert!((batch[[n, i, j, c]] as f64 - y).abs() < 1e-5);
            assert!((statistics.mean[c] as f64 - mean).abs() < 1e-5);
            assert!(
                (statistics.variance[c] as f64 - variance * count / (count - 1.0)).abs() < 1e-4
            );
        }
    }

    #[test]
    fn layer_norm_by_hand() {
        let tape = Tape::<f64>::eval();
        let x = tape.constant(arr2(&[[1.0, 3.0], [-2.0, -2.0]]));
        let (w, b) = (tape.constant(arr1(&[2.0, 3.0])), tape.constant(arr1(&[0.5, 0.0])));
        let y = x.layer_norm(w, b, 0.0, SAME).value();
        assert_eq!((y[[0, 0]], y[[0, 1]]), (-1.5, 3.0));
        let y = x.layer_norm(w, b, 1.0, SAME).value();
        assert_eq!((y[[1, 0]], y[[1, 1]]), (0.5, 0.0));
    }
}
