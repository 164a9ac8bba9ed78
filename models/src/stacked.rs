//! Samples into the arrays of a batch.

use autodiff_lite::{Tape, Var};
use ndarray::ArrayD;

/// Parts of equal length, one after the other, as an array on the tape.
pub(crate) fn stacked<'t, 'a, T: Stackable>(
    tape: &'t Tape,
    parts: impl Iterator<Item = &'a [T]>,
    shape: &[usize],
) -> Var<'t> {
    let mut array = tape.array(shape);
    let mut rest = array.as_slice_mut();
    for part in parts {
        let (here, after) = rest.split_at_mut(part.len());
        T::write(part, here);
        rest = after;
    }
    debug_assert!(rest.is_empty(), "the parts fill {shape:?}");
    tape.constant(array)
}

/// The numbers of a variable.
pub(crate) fn numbers(x: Var<'_>) -> ArrayD<f32> {
    let values = x.value().as_slice().to_vec();
    ArrayD::from_shape_vec(x.shape(), values).expect("as many numbers as the shape says")
}

/// What arrays are stacked from.
pub(crate) trait Stackable: Copy + 'static {
    fn write(from: &[Self], to: &mut [f32]);
}

impl Stackable for f32 {
    fn write(from: &[Self], to: &mut [f32]) {
        to.copy_from_slice(from);
    }
}

/// Bytes stand for 0 to 1.
impl Stackable for u8 {
    fn write(from: &[Self], to: &mut [f32]) {
        for (to, &from) in to.iter_mut().zip(from) {
            *to = f32::from(from) / 255.0;
        }
    }
}
