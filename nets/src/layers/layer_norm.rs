//! Layer normalisation.

use autodiff_lite::{Activation, Param, Real, Var, impl_module};

use crate::Init;

/// Layer norm over the last axis, as `torch.nn.LayerNorm(D)`; the formula stands at
/// [`Var::layer_norm`].
///
/// # References
/// Ba et al. 2016, *Layer normalization*.
#[derive(Clone, Debug)]
pub struct LayerNorm<F: Real = f32> {
    /// `[D]`.
    pub weight: Param<F>,
    /// `[D]`.
    pub bias: Param<F>,
    /// Added to the variance.
    pub eps: f64,
}
impl_module!(LayerNorm { weight, bias } fixed { eps });

impl<F: Real> LayerNorm<F> {
    /// PyTorch's defaults: weight 1, bias 0, `eps` 1e-5.
    pub fn new(init: &Init, width: usize) -> Self {
        Self {
            weight: init.at("weight").ones(&[width]),
            bias: init.at("bias").zeros(&[width]),
            eps: 1e-5,
        }
    }

    /// [`Var::layer_norm`] with this weight and bias.
    ///
    /// # Shapes
    /// `x [.., D]` → `[.., D]`.
    #[track_caller]
    pub fn forward<'t>(&self, x: Var<'t, F>) -> Var<'t, F> {
        let tape = x.tape();
        let (weight, bias) = (tape.param(&self.weight), tape.param(&self.bias));
        x.layer_norm(weight, bias, self.eps, Activation::None)
    }
}

#[cfg(test)]
mod tests {
    use autodiff_lite::Tape;
    use ndarray::arr2;

    use super::*;

    #[test]
    fn values_by_hand() {
        let norm = LayerNorm::<f64>::new(&Init::new(0), 2);
        let tape = Tape::eval();
        let y = norm.forward(tape.constant(arr2(&[[1.0, 3.0]]))).value();
        // Mean 2, biased variance 1.
        assert!((y[[0, 1]] - 1.0 / 1.00001_f64.sqrt()).abs() < 1e-12);
    }
}
