//! The transposed convolution layer.

use autodiff_lite::{Activation, ConvGeometry, Param, Real, Var, impl_module};

use crate::Init;

/// A two-dimensional transposed convolution, as `torch.nn.ConvTranspose2d`; sizes stand at
/// [`Var::conv_transpose2d`].
///
/// ```
/// use autodiff_lite::{ConvGeometry, Tape};
/// use nets::{ConvTranspose2d, Init};
///
/// let twice = ConvTranspose2d::<f32>::new(&Init::new(0), 8, 4, 2, ConvGeometry::new().stride(2));
/// let tape = Tape::eval();
/// let y = twice.forward(tape.constant(ndarray::Array4::zeros((1, 5, 6, 8))));
/// assert_eq!(y.shape(), [1, 10, 12, 4]);
/// ```
#[derive(Clone, Debug)]
pub struct ConvTranspose2d<F: Real = f32> {
    /// `[I, O, KH, KW]`.
    pub weight: Param<F>,
    /// `[O]`.
    pub bias: Option<Param<F>>,
    /// Stride, padding and dilation of the convolution whose input's gradient this is.
    pub geometry: ConvGeometry,
    /// Rows and columns added at the bottom and right; below the stride.
    pub output_padding: usize,
}
impl_module!(ConvTranspose2d { weight, bias } fixed { geometry, output_padding });

impl<F: Real> ConvTranspose2d<F> {
    /// A square window and a bias; PyTorch's default initial values, whose `fan_in` is
    /// `O · KH · KW` here.
    pub fn new(
        init: &Init,
        inputs: usize,
        outputs: usize,
        kernel: usize,
        geometry: ConvGeometry,
    ) -> Self {
        let shape = [inputs, outputs, kernel, kernel];
        Self {
            weight: init.at("weight").layer_weight(&shape),
            bias: Some(init.at("bias").layer_bias(outputs, &shape)),
            geometry,
            output_padding: 0,
        }
    }

    /// The same layer without its bias.
    #[must_use]
    pub fn without_bias(self) -> Self {
        Self { bias: None, ..self }
    }

    forward! {
        /// [`Var::conv_transpose2d`] with this weight and bias.
        ///
        /// # Shapes
        /// `x [N, H, W, I]` → `[N, H', W', O]`.
        |self, x, activation| {
            let tape = x.tape();
            let bias = self.bias.as_ref().map(|bias| tape.param(bias));
            let weight = tape.param(&self.weight);
            x.conv_transpose2d(weight, bias, self.geometry, self.output_padding, activation)
        }
    }
}

#[cfg(test)]
mod tests {
    use autodiff_lite::Tape;
    use ndarray::Array4;

    use super::*;

    /// Windows that do not overlap: every pixel becomes its multiple of the window.
    #[test]
    fn values_by_hand() {
        let geometry = ConvGeometry::new().stride(2);
        let mut conv = ConvTranspose2d::<f32>::new(&Init::new(0), 1, 1, 2, geometry);
        let window = Array4::from_shape_fn((1, 1, 2, 2), |(_, _, u, v)| (1 + 2 * u + v) as f32);
        conv.weight = Param::new(window);
        conv.bias = Some(Init::new(0).constant(&[1], 0.5));
        let tape = Tape::eval();
        let x = Array4::from_shape_fn((1, 1, 2, 1), |(_, _, j, _)| 10.0_f32.powi(j as i32));
        let y = conv.forward(tape.constant(x)).value();
        assert_eq!(y.as_slice(), [1.5, 2.5, 10.5, 20.5, 3.5, 4.5, 30.5, 40.5]);
    }
}
