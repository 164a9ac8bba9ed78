//! Activations where no kernel applies them in its own pass.

use autodiff_lite::{Activation, Real, Var};

/// `activation(x)` as an operation of its own.
///
/// # Shapes
/// Any → the same.
#[track_caller]
pub fn activate<F: Real>(x: Var<'_, F>, activation: Activation) -> Var<'_, F> {
    match activation {
        Activation::None => x,
        Activation::Relu => x.relu(),
        Activation::LeakyRelu(slope) => x.leaky_relu(F::from_f64(slope)),
        Activation::Sigmoid => x.sigmoid(),
        Activation::Tanh => x.tanh(),
    }
}
