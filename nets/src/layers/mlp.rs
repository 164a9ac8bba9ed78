//! A chain of linear layers.

use autodiff_lite::{Activation, Real, Var, impl_module};

use crate::{Init, Linear};

/// Linear layers with an activation between them, none after the last.
///
/// ```
/// use autodiff_lite::{Activation, Tape};
/// use nets::{Init, Mlp};
///
/// let mlp = Mlp::<f32>::new(&Init::new(0).at("head"), &[8, 32, 3], Activation::Relu);
/// let tape = Tape::eval();
/// assert_eq!(mlp.forward(tape.constant(ndarray::Array2::zeros((4, 8)))).shape(), [4, 3]);
/// ```
#[derive(Clone, Debug)]
pub struct Mlp<F: Real = f32> {
    /// In order.
    pub layers: Vec<Linear<F>>,
    /// Between them.
    pub activation: Activation,
}
impl_module!(Mlp { layers } fixed { activation });

impl<F: Real> Mlp<F> {
    /// From `widths[0]` inputs to the last width.
    pub fn new(init: &Init, widths: &[usize], activation: Activation) -> Self {
        let init = init.at("layers");
        let layer = |(i, pair): (usize, &[usize])| Linear::new(&init.index(i), pair[0], pair[1]);
        Self { layers: widths.windows(2).enumerate().map(layer).collect(), activation }
    }

    /// All layers, one after the other.
    ///
    /// # Shapes
    /// `x [.., D]`, `D` the first of the widths → `[.., O]`, `O` the last.
    #[track_caller]
    pub fn forward<'t>(&self, x: Var<'t, F>) -> Var<'t, F> {
        let Some((last, others)) = self.layers.split_last() else { return x };
        let hidden = others.iter().fold(x, |x, layer| layer.forward_then(x, self.activation));
        last.forward(hidden)
    }
}

#[cfg(test)]
mod tests {
    use autodiff_lite::{Module, Tape};

    use super::*;

    #[test]
    fn activations_stand_between_layers() {
        let mut mlp = Mlp::<f32>::new(&Init::new(0), &[1, 1, 1], Activation::Relu);
        for layer in &mut mlp.layers {
            layer.weight = Init::new(0).constant(&[1, 1], -1.0);
            layer.bias = None;
        }
        let tape = Tape::eval();
        let y = mlp.forward(tape.constant(ndarray::arr2(&[[2.0], [-2.0]]))).value();
        // -2 is rectified to 0 in between; the last layer may be negative.
        assert_eq!(y.as_slice(), [0.0, -2.0]);
        let mut paths = Vec::new();
        mlp.visit("", &mut |path: &str, _: &_| paths.push(path.to_owned()));
        assert_eq!(paths, ["layers.0.weight", "layers.1.weight"]);
    }
}
