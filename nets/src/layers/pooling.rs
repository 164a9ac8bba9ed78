//! Pooling layers: plain descriptions of what is done to an image.

use autodiff_lite::{Module, PoolGeometry, Real, Var, Visitor, VisitorMut};

/// The largest pixel of each window, as `torch.nn.MaxPool2d`; see [`Var::max_pool2d`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MaxPool2d(pub PoolGeometry);

/// The mean of each window, as `torch.nn.AvgPool2d`; see [`Var::avg_pool2d`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AvgPool2d(pub PoolGeometry);

/// Means of as many windows as the output has pixels, as `torch.nn.AdaptiveAvgPool2d`; see
/// [`Var::adaptive_avg_pool2d`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AdaptiveAvgPool2d {
    /// Rows of the output.
    pub height: usize,
    /// Columns of the output.
    pub width: usize,
}

impl MaxPool2d {
    /// [`Var::max_pool2d`].
    ///
    /// # Shapes
    /// `x [N, H, W, C]` → `[N, H', W', C]`.
    #[track_caller]
    pub fn forward<F: Real>(self, x: Var<'_, F>) -> Var<'_, F> {
        x.max_pool2d(self.0)
    }
}

impl AvgPool2d {
    /// [`Var::avg_pool2d`].
    ///
    /// # Shapes
    /// `x [N, H, W, C]` → `[N, H', W', C]`.
    #[track_caller]
    pub fn forward<F: Real>(self, x: Var<'_, F>) -> Var<'_, F> {
        x.avg_pool2d(self.0)
    }
}

impl AdaptiveAvgPool2d {
    /// [`Var::adaptive_avg_pool2d`].
    ///
    /// # Shapes
    /// `x [N, H, W, C]` → `[N, height, width, C]`.
    #[track_caller]
    pub fn forward<F: Real>(self, x: Var<'_, F>) -> Var<'_, F> {
        x.adaptive_avg_pool2d(self.height, self.width)
    }
}

macro_rules! without_parameters {
    ($($name:ident),*) => {$(
        impl<F: Real> Module<F> for $name {
            fn visit(&self, _: &str, _: &mut dyn Visitor<F>) {}

            fn visit_mut(&mut self, _: &str, _: &mut dyn VisitorMut<F>) {}
        }
    )*};
}
without_parameters!(MaxPool2d, AvgPool2d, AdaptiveAvgPool2d);

#[cfg(test)]
mod tests {
    use autodiff_lite::Tape;
    use ndarray::Array4;

    use super::*;

    #[test]
    fn a_window_has_a_largest_pixel_and_a_mean() {
        let tape = Tape::<f32>::eval();
        let x = Array4::from_shape_fn((1, 2, 4, 1), |(_, i, j, _)| (4 * i + j) as f32);
        let x = tape.constant(x);
        let two = PoolGeometry::square(2);
        assert_eq!(MaxPool2d(two).forward(x).value().as_slice(), [5.0, 7.0]);
        assert_eq!(AvgPool2d(two).forward(x).value().as_slice(), [2.5, 4.5]);
        let one = AdaptiveAvgPool2d { height: 1, width: 1 };
        assert_eq!(one.forward(x).value().as_slice(), [3.5]);
    }
}
