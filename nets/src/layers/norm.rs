//! The norm behind a convolution.

use autodiff_lite::{Activation, Module, Real, Var, Visitor, VisitorMut};

use crate::{BatchNorm2d, Conv2d, FrozenBatchNorm2d, GroupNorm, Init};

/// Channels of a group, where that divides all of them; else they are one group.
const GROUP: usize = 16;

/// The norm behind a convolution: a batch norm that is trained with the network or a frozen one, or a group norm.
/// The batch norms have the same names in files.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Norm<F: Real = f32> {
    /// Statistics of the batch while training.
    Batch(BatchNorm2d<F>),
    /// An affine map that is never trained.
    Frozen(FrozenBatchNorm2d<F>),
    /// Statistics of each image.
    Group(GroupNorm<F>),
}

/// Which [`Norm`] a network has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "kebab-case")
)]
pub enum NormKind {
    /// [`BatchNorm2d`]: to train from scratch, or to go on training with batches of many images.
    #[default]
    Batch,
    /// [`FrozenBatchNorm2d`]: for pretrained networks and small batches. Its maps do not depend on
    /// what else is in the batch.
    Frozen,
    /// [`GroupNorm`] of 16 channels a group: to train from scratch with few images a batch, or with a batch that is spread over
    /// shards.
    Group,
}

impl<F: Real> Module<F> for Norm<F> {
    fn visit(&self, path: &str, visitor: &mut dyn Visitor<F>) {
        match self {
            Self::Batch(norm) => norm.visit(path, visitor),
            Self::Frozen(norm) => norm.visit(path, visitor),
            Self::Group(norm) => norm.visit(path, visitor),
        }
    }

    fn visit_mut(&mut self, path: &str, visitor: &mut dyn VisitorMut<F>) {
        match self {
            Self::Batch(norm) => norm.visit_mut(path, visitor),
            Self::Frozen(norm) => norm.visit_mut(path, visitor),
            Self::Group(norm) => norm.visit_mut(path, visitor),
        }
    }
}

impl<F: Real> Norm<F> {
    /// The identity, with `eps` 1e-5.
    pub fn new(init: &Init, channels: usize, kind: NormKind) -> Self {
        match kind {
            NormKind::Batch => Self::Batch(BatchNorm2d::new(init, channels)),
            NormKind::Frozen => Self::Frozen(FrozenBatchNorm2d::new(init, channels)),
            NormKind::Group => {
                let size = if channels.is_multiple_of(GROUP) { GROUP } else { channels };
                Self::Group(GroupNorm::new(init, channels / size, channels))
            }
        }
    }

    /// The same with another `eps`.
    #[must_use]
    pub fn with_eps(mut self, eps: f64) -> Self {
        match &mut self {
            Self::Batch(norm) => norm.eps = eps,
            Self::Frozen(norm) => norm.eps = eps,
            Self::Group(norm) => norm.eps = eps,
        }
        self
    }

    /// `activation(norm(conv(x)))`.
    ///
    /// Where the norm is an affine map (frozen, or on a tape that only computes) it is multiplied into the weight
    /// of the convolution, which then does all in one pass.
    ///
    /// # Shapes
    /// `x [N, H, W, I]` → `[N, H', W', O]`.
    #[track_caller]
    pub fn after<'t>(&self, conv: &Conv2d<F>, x: Var<'t, F>, activation: Activation) -> Var<'t, F> {
        let tape = x.tape();
        let [scale, shift] = match self {
            Self::Batch(norm) if tape.is_recording() => {
                return norm.forward_then(conv.forward(x), activation);
            }
            Self::Group(norm) => return norm.forward_then(conv.forward(x), activation),
            Self::Batch(norm) => norm.scale_and_shift(),
            Self::Frozen(norm) => norm.scale_and_shift(),
        };
        let [scale, shift] = [scale, shift].map(|v| tape.constant(ndarray::Array1::from_vec(v)));
        let channels = scale.len();
        let weight = tape.param(&conv.weight).mul(scale.reshape(&[channels, 1, 1, 1]));
        let bias = match &conv.bias {
            Some(bias) => tape.param(bias).mul(scale).add(shift),
            None => shift,
        };
        x.conv2d(weight, Some(bias), conv.geometry, activation)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use autodiff_lite::testkit::{Options, check, function};
    use autodiff_lite::{ConvGeometry, Tape};
    use ndarray::{Array1, Array4};

    use super::*;

    fn filled(kind: NormKind) -> (Conv2d<f64>, Norm<f64>) {
        let init = Init::new(3);
        let conv = Conv2d::new(&init.at("conv"), 2, 3, 3, ConvGeometry::new().padding(1));
        let mut norm = Norm::new(&init.at("norm"), 3, kind);
        let mut k = 0.0;
        norm.visit_mut("", &mut |_: &str, param: &mut autodiff_lite::Param<f64>| {
            k += 1.0;
            let wavy = Array1::from_shape_fn(3, |i| 1.0 + 0.4 * (k + 2.0 * i as f64).sin());
            param.value = wavy.into();
        });
        (conv, norm)
    }

    /// Convolution, then norm, then activation, each on its own.
    #[test]
    fn folding_changes_rounding_alone() {
        for kind in [NormKind::Batch, NormKind::Frozen, NormKind::Group] {
            let (conv, norm) = filled(kind);
            for conv in [conv.clone(), conv.without_bias()] {
                let tape = Tape::<f64>::eval();
                let x = Array4::from_shape_fn((2, 5, 4, 2), |(n, i, j, c)| {
                    ((7 * n + 3 * i + 5 * j + 11 * c) as f64).sin()
                });
                let x = tape.constant(x);
                let y = conv.forward(x);
                let y = match &norm {
                    Norm::Batch(norm) => norm.forward_then(y, Activation::Relu),
                    Norm::Frozen(norm) => norm.forward_then(y, Activation::Relu),
                    Norm::Group(norm) => norm.forward_then(y, Activation::Relu),
                };
                let folded = norm.after(&conv, x, Activation::Relu);
                for (a, b) in y.value().iter().zip(&folded.value()) {
                    assert!((a - b).abs() < 1e-13, "{a} and {b}");
                }
            }
        }
    }

    #[test]
    fn a_frozen_norm_passes_gradients_to_the_convolution() {
        let (conv, norm) = filled(NormKind::Frozen);
        let f = function(|v| {
            let conv = Conv2d { weight: autodiff_lite::Param::new(v[1].value()), ..conv.clone() };
            // The weight enters as a leaf of the check, by the same rule as in `after`.
            let Norm::Frozen(frozen) = &norm else { unreachable!("made frozen") };
            let [scale, _] = frozen.scale_and_shift();
            let tape = v[0].tape();
            let scale = tape.constant(Array1::from_vec(scale)).reshape(&[3, 1, 1, 1]);
            let through = v[0].conv2d(v[1].mul(scale), None, conv.geometry, Activation::None);
            let direct = norm.after(&conv.without_bias(), v[0], Activation::Tanh);
            through.tanh().add(direct.detach().scale(0.0))
        });
        let options = Options::default();
        check(&f, &options.draw(&[vec![1, 3, 4, 2], vec![3, 2, 3, 3]]), &options).unwrap();
        // The gradient of the parameter itself is that of the leaf.
        let tape = Tape::<f64>::train(0);
        let x = tape.leaf(Array4::from_elem((1, 3, 3, 2), 0.3));
        let gradients = norm.after(&conv, x, Activation::None).sum().backward();
        assert!(gradients.of(&conv.weight).unwrap().iter().any(|&g| g != 0.0));
        assert!(gradients.of(conv.bias.as_ref().unwrap()).is_some());
        let Norm::Frozen(frozen) = &norm else { unreachable!("made frozen") };
        assert_eq!(frozen.weight.shape(), [3]);
    }
}
