//! The convolution layer.

use autodiff_lite::{Activation, ConvGeometry, Param, Real, Var, impl_module};

use crate::{FanMode, Init, Nonlinearity};

/// A two-dimensional convolution of features-last images, as `torch.nn.Conv2d`; the formula
/// stands at [`Var::conv2d`].
///
/// ```
/// use autodiff_lite::{Activation, ConvGeometry, Tape};
/// use nets::{Conv2d, Init};
///
/// let halves = ConvGeometry::new().stride(2).padding(1);
/// let conv = Conv2d::<f32>::new(&Init::new(0).at("conv1"), 3, 16, 3, halves);
/// let tape = Tape::eval();
/// let image = tape.constant(ndarray::Array4::zeros((1, 64, 48, 3)));
/// assert_eq!(conv.forward_then(image, Activation::Relu).shape(), [1, 32, 24, 16]);
/// ```
#[derive(Clone, Debug)]
pub struct Conv2d<F: Real = f32> {
    /// `[O, I, KH, KW]`.
    pub weight: Param<F>,
    /// `[O]`.
    pub bias: Option<Param<F>>,
    /// Stride, padding and dilation.
    pub geometry: ConvGeometry,
}
impl_module!(Conv2d { weight, bias } fixed { geometry });

impl<F: Real> Conv2d<F> {
    /// A square window and a bias; PyTorch's default initial values, `U(±1/√fan_in)`.
    pub fn new(
        init: &Init,
        inputs: usize,
        outputs: usize,
        kernel: usize,
        geometry: ConvGeometry,
    ) -> Self {
        let shape = [outputs, inputs, kernel, kernel];
        Self {
            weight: init.at("weight").layer_weight(&shape),
            bias: Some(init.at("bias").layer_bias(outputs, &shape)),
            geometry,
        }
    }

    /// Weights begin Gaussian with this deviation, biases at 0.
    pub fn normal(
        init: &Init,
        inputs: usize,
        outputs: usize,
        kernel: usize,
        deviation: f64,
        geometry: ConvGeometry,
    ) -> Self {
        let shape = [outputs, inputs, kernel, kernel];
        let weight = init.at("weight").normal(&shape, 0.0, deviation);
        Self { weight, bias: Some(init.at("bias").zeros(&[outputs])), geometry }
    }

    /// Weights begin as torchvision's: Gaussian, so that a ReLU's gradients keep their variance; biases at 0.
    pub fn kaiming(
        init: &Init,
        inputs: usize,
        outputs: usize,
        kernel: usize,
        geometry: ConvGeometry,
    ) -> Self {
        let shape = [outputs, inputs, kernel, kernel];
        let weight = init.at("weight").kaiming_normal(&shape, FanMode::Out, Nonlinearity::Relu);
        Self { weight, bias: Some(init.at("bias").zeros(&[outputs])), geometry }
    }

    /// The same layer without its bias, as before a batch norm.
    #[must_use]
    pub fn without_bias(self) -> Self {
        Self { bias: None, ..self }
    }

    forward! {
        /// [`Var::conv2d`] with this weight and bias.
        ///
        /// # Shapes
        /// `x [N, H, W, I]` → `[N, H', W', O]`.
        |self, x, activation| {
            let tape = x.tape();
            let bias = self.bias.as_ref().map(|bias| tape.param(bias));
            x.conv2d(tape.param(&self.weight), bias, self.geometry, activation)
        }
    }
}

#[cfg(test)]
mod tests {
    use autodiff_lite::Tape;
    use ndarray::Array4;

    use super::*;

    /// A window of ones sums the 3 x 3 neighbourhood.
    #[test]
    fn values_by_hand() {
        let same = ConvGeometry::new().padding(1);
        let mut conv = Conv2d::<f32>::new(&Init::new(0), 1, 1, 3, same);
        conv.weight = Init::new(0).ones(&[1, 1, 3, 3]);
        conv.bias = Some(Init::new(0).constant(&[1], -20.0));
        let tape = Tape::eval();
        let image = Array4::from_shape_fn((1, 3, 3, 1), |(_, i, j, _)| (3 * i + j + 1) as f32);
        let x = tape.constant(image);
        let y = conv.forward(x).value();
        let expected = [-8.0, 1.0, -4.0, 7.0, 25.0, 13.0, 4.0, 19.0, 8.0];
        assert_eq!(y.as_slice(), expected);
        let y = conv.without_bias().forward_then(x, Activation::LeakyRelu(0.1)).value();
        assert_eq!(y[[0, 0, 0, 0]], 12.0);
    }
}
