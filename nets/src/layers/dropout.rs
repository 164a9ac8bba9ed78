//! Dropout.

use autodiff_lite::{Module, Real, Var, Visitor, VisitorMut};

/// Sets a random part of the elements to zero while training, as `torch.nn.Dropout`; see
/// [`Var::dropout`] for what decides which.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dropout {
    /// The probability of an element to vanish, in `[0, 1)`; with 0 the layer does nothing.
    pub p: f64,
}

impl<F: Real> Module<F> for Dropout {
    fn visit(&self, _: &str, _: &mut dyn Visitor<F>) {}

    fn visit_mut(&mut self, _: &str, _: &mut dyn VisitorMut<F>) {}
}

impl Dropout {
    /// With this probability.
    ///
    /// # Panics
    /// If it is not within `[0, 1)`.
    #[track_caller]
    pub fn new(p: f64) -> Self {
        assert!((0.0..1.0).contains(&p), "the probability {p} of a dropout is not within [0, 1)");
        Self { p }
    }

    /// [`Var::dropout`] with this probability.
    ///
    /// # Shapes
    /// Any → the same.
    #[track_caller]
    pub fn forward<F: Real>(self, x: Var<'_, F>) -> Var<'_, F> {
        x.dropout(self.p)
    }
}
