//! What a convolution reads and writes.

use crate::kernels::activation::Activation;
use crate::kernels::blocks::{SERIAL_ELEMENTS, for_each_part};
use crate::kernels::lane::Lane;

/// What a pass reads, and where its result goes: of the convolution from `x` to `y`, of the gradient of its input from
/// the gradient of `y` to that of `x`.
#[derive(Debug)]
pub struct Operands<'a, F> {
    pub(crate) from: &'a [F],
    pub(crate) w: &'a [F],
    pub(crate) bias: Option<&'a [F]>,
    pub(crate) activation: Activation,
    pub(crate) to: &'a mut [F],
    pub(crate) scratch: &'a mut [F],
}

/// `activation(x)` in place, for those that the tiles do not apply.
pub(super) fn finish<F: Lane>(activation: Activation, y: &mut [F]) {
    const CHUNK: usize = 16 * 1024;
    if activation.in_store() {
        return;
    }
    let parallel = y.len() >= SERIAL_ELEMENTS;
    for_each_part(y, CHUNK, parallel, |_, part| {
        activation.apply_all(part);
    });
}
