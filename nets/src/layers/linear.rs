//! The linear layer.

use autodiff_lite::{Activation, LinearThen, Param, Real, Var, impl_module};

use crate::Init;

/// `y = x Wᵀ + b`, as `torch.nn.Linear`.
///
/// ```
/// use autodiff_lite::Tape;
/// use nets::{Init, Linear};
///
/// let head = Linear::<f32>::new(&Init::new(0).at("head"), 8, 3);
/// let tape = Tape::eval();
/// let y = head.forward(tape.constant(ndarray::Array3::zeros((2, 5, 8))));
/// assert_eq!(y.shape(), [2, 5, 3]);
/// ```
#[derive(Clone, Debug)]
pub struct Linear<F: Real = f32> {
    /// `[out, in]`.
    pub weight: Param<F>,
    /// `[out]`.
    pub bias: Option<Param<F>>,
}
impl_module!(Linear { weight, bias });

impl<F: Real> Linear<F> {
    /// With a bias; PyTorch's default initial values, `U(±1/√inputs)`.
    pub fn new(init: &Init, inputs: usize, outputs: usize) -> Self {
        let shape = [outputs, inputs];
        Self {
            weight: init.at("weight").layer_weight(&shape),
            bias: Some(init.at("bias").layer_bias(outputs, &shape)),
        }
    }

    /// Weights begin Gaussian with this deviation, biases at 0.
    pub fn normal(init: &Init, inputs: usize, outputs: usize, deviation: f64) -> Self {
        let weight = init.at("weight").normal(&[outputs, inputs], 0.0, deviation);
        Self { weight, bias: Some(init.at("bias").zeros(&[outputs])) }
    }

    /// All begins at 0.
    pub fn zeros(init: &Init, inputs: usize, outputs: usize) -> Self {
        let weight = init.at("weight").zeros(&[outputs, inputs]);
        Self { weight, bias: Some(init.at("bias").zeros(&[outputs])) }
    }

    /// The same layer without its bias.
    #[must_use]
    pub fn without_bias(self) -> Self {
        Self { bias: None, ..self }
    }

    forward! {
        /// [`Var::linear`] with this weight and bias.
        ///
        /// # Shapes
        /// `x [.., in]` → `[.., out]`.
        |self, x, activation| {
            let tape = x.tape();
            let bias = self.bias.as_ref().map(|bias| tape.param(bias));
            x.linear(tape.param(&self.weight), bias, activation)
        }
    }

    /// `residual + dropout(activation(x Wᵀ + b))` in one pass, as `then` says; see [`Var::linear_then`].
    ///
    /// # Shapes
    /// `x [.., in]`, a residual `[.., out]` → `[.., out]`.
    #[track_caller]
    pub fn forward_fused<'t>(&self, x: Var<'t, F>, then: LinearThen<'t, F>) -> Var<'t, F> {
        let tape = x.tape();
        let bias = self.bias.as_ref().map(|bias| tape.param(bias));
        x.linear_then(tape.param(&self.weight), bias, then)
    }
}

#[cfg(test)]
mod tests {
    use autodiff_lite::{Module, Tape};
    use ndarray::{arr1, arr2};

    use super::*;

    #[test]
    fn values_by_hand() {
        let mut linear = Linear::<f32>::new(&Init::new(0), 2, 1);
        linear.weight = Param::new(arr2(&[[2.0, -1.0]]));
        linear.bias = Some(Param::new(arr1(&[0.5])));
        let tape = Tape::eval();
        let x = tape.constant(arr2(&[[1.0, 2.0], [0.0, 4.0]]));
        assert_eq!(linear.forward(x).value().as_slice(), [0.5, -3.5]);
        let y = linear.forward_then(x, Activation::Relu).value();
        assert_eq!(y.as_slice(), [0.5, 0.0]);
        assert_eq!(linear.parameter_count(), 3);
        assert_eq!(linear.without_bias().parameter_count(), 2);
    }
}
