//! Group normalisation.

use autodiff_lite::{Activation, Param, Real, Var, impl_module};

use crate::Init;

/// Group norm of features-last images, as `torch.nn.GroupNorm`; the formula stands at
/// [`Var::group_norm`]. It has no batch statistics, so a batch may be split over tapes.
///
/// # References
/// Wu and He 2018, *Group normalization*.
#[derive(Clone, Debug)]
pub struct GroupNorm<F: Real = f32> {
    /// `[C]`.
    pub weight: Param<F>,
    /// `[C]`.
    pub bias: Param<F>,
    /// Into how many groups of neighbours the channels fall.
    pub groups: usize,
    /// Added to the variance.
    pub eps: f64,
}
impl_module!(GroupNorm { weight, bias } fixed { groups, eps });

impl<F: Real> GroupNorm<F> {
    /// PyTorch's defaults: weight 1, bias 0, `eps` 1e-5.
    ///
    /// # Panics
    /// If `groups` does not divide `channels`.
    #[track_caller]
    pub fn new(init: &Init, groups: usize, channels: usize) -> Self {
        assert!(
            groups > 0 && channels.is_multiple_of(groups),
            "{groups} groups do not divide {channels} channels"
        );
        Self {
            weight: init.at("weight").ones(&[channels]),
            bias: init.at("bias").zeros(&[channels]),
            groups,
            eps: 1e-5,
        }
    }

    forward! {
        /// [`Var::group_norm`] with this weight and bias.
        ///
        /// # Shapes
        /// `x [N, .., C]` → `[N, .., C]`.
        |self, x, activation| {
            let tape = x.tape();
            let (weight, bias) = (tape.param(&self.weight), tape.param(&self.bias));
            x.group_norm(self.groups, weight, bias, self.eps, activation)
        }
    }
}

#[cfg(test)]
mod tests {
    use autodiff_lite::Tape;
    use ndarray::arr2;

    use super::*;

    #[test]
    fn each_group_is_normalized_by_itself() {
        let norm = GroupNorm::<f64>::new(&Init::new(0), 2, 4);
        let tape = Tape::eval();
        let y = norm.forward(tape.constant(arr2(&[[1.0, 3.0, 100.0, 102.0]]))).value();
        for (y, expected) in y.iter().zip([-1.0, 1.0, -1.0, 1.0]) {
            assert!((y - expected).abs() < 1e-5, "{y}");
        }
    }

    #[test]
    #[should_panic(expected = "3 groups do not divide 4 channels")]
    fn groups_divide_the_channels() {
        let _ = GroupNorm::<f32>::new(&Init::new(0), 3, 4);
    }
}
