//! The pull of weights towards zero that stands in a loss, as Pixel2Mesh has it.

use autodiff_lite::{Module, Param, Tape, Var};
use ndarray::arr0;

/// Half the sum of the squares of all parameters of a module whose path `counts`.
pub(super) fn half_squares<'t, M: Module<f32>>(
    tape: &'t Tape,
    module: &M,
    counts: impl Fn(&str) -> bool,
) -> Var<'t> {
    let mut squares = Vec::new();
    module.visit("", &mut |path: &str, param: &Param| {
        if counts(path) {
            squares.push((0.5, tape.param(param).square().sum()));
        }
    });
    if squares.is_empty() { tape.constant(arr0(0.0)) } else { tape.lincomb(&squares) }
}

#[cfg(test)]
mod tests {
    use nets::{Init, Linear};

    use super::*;

    /// By hand, and its gradient is the weight itself.
    #[test]
    fn the_gradient_is_the_weight() {
        let linear = Linear::<f32>::new(&Init::new(0), 3, 2);
        let tape = Tape::train(0);
        let decay = half_squares(&tape, &linear, |path| path == "weight");
        let weight = linear.weight.as_slice();
        let expected = 0.5 * weight.iter().map(|w| w * w).sum::<f32>();
        assert!((decay.item() - expected).abs() < 1e-6);
        let gradients = decay.backward();
        assert_eq!(gradients.slice_of(&linear.weight), Some(weight));
        assert!(linear.bias.is_some_and(|bias| gradients.slice_of(&bias).is_none()));
    }
}
