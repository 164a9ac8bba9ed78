//! Arrays as the tape takes and keeps them.

use ndarray::{ArcArray, Array, Dimension, IxDyn};

use crate::Real;

/// A value: shared by reference count; on a tape always row-major and contiguous.
pub type Tensor<F = f32> = ArcArray<F, IxDyn>;

/// The reason why `as_slice` on a tape's value cannot fail.
pub const CONTIGUOUS: &str = "values on a tape are row-major and contiguous";

/// What may become a value: owned and shared arrays of any dimension. Nothing is copied.
pub trait IntoTensor<F: Real> {
    /// The array with dynamic dimension and shared ownership.
    fn into_tensor(self) -> Tensor<F>;
}

impl<F: Real, D: Dimension> IntoTensor<F> for Array<F, D> {
    fn into_tensor(self) -> Tensor<F> {
        self.into_dyn().into_shared()
    }
}

impl<F: Real, D: Dimension> IntoTensor<F> for ArcArray<F, D> {
    fn into_tensor(self) -> Tensor<F> {
        self.into_dyn()
    }
}
