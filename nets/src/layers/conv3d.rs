//! The convolution layer over three axes.

use autodiff_lite::{Activation, Conv3dGeometry, Param, Real, Var, impl_module};

use crate::Init;

/// A convolution of features-last volumes, as `torch.nn.Conv3d`; what it computes stands at [`Var::conv3d`].
///
/// ```
/// use autodiff_lite::{Activation, Conv3dGeometry, Tape};
/// use nets::{Conv3d, Init};
///
/// let halves = Conv3dGeometry::new().stride(2).padding(1);
/// let conv = Conv3d::<f32>::new(&Init::new(0).at("conv1"), 1, 8, 3, halves);
/// let tape = Tape::eval();
/// let cells = tape.constant(ndarray::Array5::zeros((1, 16, 16, 16, 1)));
/// assert_eq!(conv.forward_then(cells, Activation::Relu).shape(), [1, 8, 8, 8, 8]);
/// ```
#[derive(Clone, Debug)]
pub struct Conv3d<F: Real = f32> {
    /// `[O, I, KD, KH, KW]`.
    pub weight: Param<F>,
    /// `[O]`.
    pub bias: Option<Param<F>>,
    /// Stride, padding and dilation.
    pub geometry: Conv3dGeometry,
}
impl_module!(Conv3d { weight, bias } fixed { geometry });

impl<F: Real> Conv3d<F> {
    /// A cubic window and a bias; PyTorch's default initial values, `U(±1/√fan_in)`.
    pub fn new(
        init: &Init,
        inputs: usize,
        outputs: usize,
        kernel: usize,
        geometry: Conv3dGeometry,
    ) -> Self {
        let shape = [outputs, inputs, kernel, kernel, kernel];
        Self {
            weight: init.at("weight").layer_weight(&shape),
            bias: Some(init.at("bias").layer_bias(outputs, &shape)),
            geometry,
        }
    }

    /// The same layer without its bias, as before a norm.
    #[must_use]
    pub fn without_bias(self) -> Self {
        Self { bias: None, ..self }
    }

    forward! {
        /// [`Var::conv3d`] with this weight and bias.
        ///
        /// # Shapes
        /// `x [N, D, H, W, I]` → `[N, D', H', W', O]`.
        |self, x, activation| {
            let tape = x.tape();
            let bias = self.bias.as_ref().map(|bias| tape.param(bias));
            x.conv3d(tape.param(&self.weight), bias, self.geometry, activation)
        }
    }
}
