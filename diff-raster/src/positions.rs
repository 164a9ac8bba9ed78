//! What projected positions may come as.

use autodiff_lite::{Real, Tensor, Var};
use ndarray::{Array3, ArrayView3, ArrayViewD, Ix3};

/// Projected positions `[N, V, 3]`: a variable of a tape, a tensor, or an array of ndarray.
pub trait Positions<F: Real> {
    /// Calls `f` with them as an array.
    ///
    /// # Shapes
    /// `[N, V, 3]`: x and y in NDC, planar depth.
    ///
    /// # Panics
    /// If they have not three axes.
    fn with<R>(self, f: impl FnOnce(ArrayView3<'_, F>) -> R) -> R;
}

fn three_axes<F>(view: ArrayViewD<'_, F>) -> ArrayView3<'_, F> {
    let shape = view.shape().to_vec();
    let Ok(view) = view.into_dimensionality::<Ix3>() else {
        panic!("projected positions need the shape [N, V, 3], not {shape:?}")
    };
    view
}

impl<F: Real> Positions<F> for ArrayView3<'_, F> {
    fn with<R>(self, f: impl FnOnce(ArrayView3<'_, F>) -> R) -> R {
        f(self)
    }
}

impl<F: Real> Positions<F> for &Array3<F> {
    fn with<R>(self, f: impl FnOnce(ArrayView3<'_, F>) -> R) -> R {
        f(self.view())
    }
}

impl<F: Real> Positions<F> for &Tensor<F> {
    #[track_caller]
    fn with<R>(self, f: impl FnOnce(ArrayView3<'_, F>) -> R) -> R {
        f(three_axes(self.view()))
    }
}

impl<F: Real> Positions<F> for Var<'_, F> {
    #[track_caller]
    fn with<R>(self, f: impl FnOnce(ArrayView3<'_, F>) -> R) -> R {
        f(three_axes(self.value().view()))
    }
}
