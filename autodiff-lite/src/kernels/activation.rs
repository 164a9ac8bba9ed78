//! Activations that are fused into the store of a product.

use ndarray::NdFloat;

use crate::kernels::simd::clones;
use crate::kernels::transcendental::Transcendental;

/// What is applied to the output of a linear layer, a convolution or a norm, in the same pass.
///
/// Each one's derivative can be told from its output, so backward keeps no second array.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "kebab-case")
)]
pub enum Activation {
    /// `y = x`.
    #[default]
    None,
    /// `y = max(x, 0)`; derivative 0 at 0.
    Relu,
    /// `y = x` above 0, `slope x` below; the slope lies in (0, 1].
    LeakyRelu(f64),
    /// `y = 1 / (1 + exp(-x))`.
    Sigmoid,
    /// `y = tanh(x)`.
    Tanh,
}

impl Activation {
    /// What is wrong with it, if anything: kernels take the larger of `x` and `slope x`, and tell from the output on which side
    /// of 0 the input was.
    pub(crate) fn fault(self) -> Option<String> {
        match self {
            Self::LeakyRelu(slope) if !(slope > 0.0 && slope <= 1.0) => {
                Some(format!("the slope {slope} of a leaky ReLU is not within (0, 1]"))
            }
            _ => None,
        }
    }

    /// Whether the vector kernels apply it while they store.
    pub(crate) fn in_store(self) -> bool {
        matches!(self, Self::None | Self::Relu | Self::LeakyRelu(_))
    }

    /// `y = f(x)` of one number, with the bits of [`Var::sigmoid`](crate::Var::sigmoid) and [`Var::tanh`](crate::Var::tanh).
    #[inline(always)]
    pub fn apply<F: NdFloat + Transcendental>(self, x: F) -> F {
        let zero = F::zero();
        match self {
            Self::None => x,
            Self::Relu => {
                if x < zero {
                    zero
                } else {
                    x
                }
            }
            Self::LeakyRelu(slope) => {
                if x < zero {
                    x * from_f64(slope)
                } else {
                    x
                }
            }
            Self::Sigmoid => x.fast_sigmoid(),
            Self::Tanh => x.fast_tanh(),
        }
    }

    /// `y = f(y)` of each number.
    pub(crate) fn apply_all<F: NdFloat + Transcendental>(self, y: &mut [F]) {
        apply_chunk(self, y);
    }

    /// `dy/dx` where the output is `y`.
    #[inline(always)]
    pub fn derivative<F: NdFloat>(self, y: F) -> F {
        let (zero, one) = (F::zero(), F::one());
        match self {
            Self::None => one,
            Self::Relu => {
                if y > zero {
                    one
                } else {
                    zero
                }
            }
            Self::LeakyRelu(slope) => {
                if y > zero {
                    one
                } else {
                    from_f64(slope)
                }
            }
            Self::Sigmoid => y * (one - y),
            Self::Tanh => one - y * y,
        }
    }
}

/// [`Activation::apply`] of each number, for the inside of a clone. Named one by one, so that each loop vectorises.
#[inline(always)]
pub(crate) fn apply<F: NdFloat + Transcendental>(activation: Activation, y: &mut [F]) {
    match activation {
        Activation::None => {}
        Activation::Relu => y.iter_mut().for_each(|y| *y = Activation::Relu.apply(*y)),
        Activation::LeakyRelu(slope) => {
            for y in y {
                *y = Activation::LeakyRelu(slope).apply(*y);
            }
        }
        Activation::Sigmoid => y.iter_mut().for_each(|y| *y = y.fast_sigmoid()),
        Activation::Tanh => y.iter_mut().for_each(|y| *y = y.fast_tanh()),
    }
}

clones!(fn apply_chunk[F: NdFloat + Transcendental](activation: Activation, y: &mut [F]) = apply);

#[inline(always)]
pub(crate) fn from_f64<F: NdFloat>(x: f64) -> F {
    F::from(x).expect("f32 and f64 hold any finite number, if rounded")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Tape;

    /// Fused or an operation of its own, the bits are the same.
    #[test]
    fn fused_activations_are_those_of_the_tape() {
        let x: Vec<f32> = (-300..300).map(|k| k as f32 * 0.037).collect();
        let tape = Tape::<f32>::eval();
        let var = tape.constant(ndarray::Array1::from_vec(x.clone()));
        for (activation, expected) in [
            (Activation::Sigmoid, var.sigmoid()),
            (Activation::Tanh, var.tanh()),
            (Activation::Relu, var.relu()),
            (Activation::LeakyRelu(0.1), var.leaky_relu(0.1)),
        ] {
            let mut y = x.clone();
            activation.apply_all(&mut y);
            assert_eq!(y, expected.value().as_slice());
            assert!(x.iter().zip(&y).all(|(&x, y)| activation.apply(x).to_bits() == y.to_bits()));
        }
    }

    #[test]
    #[should_panic(expected = "conv2d: the slope -0.1 of a leaky ReLU is not within (0, 1]")]
    fn slopes_that_kernels_do_not_know_are_refused() {
        let tape = Tape::<f32>::eval();
        let x = tape.constant(ndarray::Array4::<f32>::zeros((1, 4, 4, 2)));
        let w = tape.constant(ndarray::Array4::<f32>::zeros((3, 2, 1, 1)));
        let _ = x.conv2d(w, None, crate::ConvGeometry::new(), Activation::LeakyRelu(-0.1));
    }
}
