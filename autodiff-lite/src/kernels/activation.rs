//! Activations that are fused into the store of a product.

use ndarray::NdFloat;

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

    /// `y = f(x)` of one number.
    #[inline(always)]
    pub fn apply<F: NdFloat>(self, x: F) -> F {
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
            Self::Sigmoid => F::one() / (F::one() + (-x).exp()),
            Self::Tanh => x.tanh(),
        }
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

#[inline(always)]
pub(crate) fn from_f64<F: NdFloat>(x: f64) -> F {
    F::from(x).expect("f32 and f64 hold any finite number, if rounded")
}
