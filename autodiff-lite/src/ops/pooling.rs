//! Max, mean and adaptive mean pooling.

use crate::kernels::pooling::{self, PoolGeometry, Windows};
use crate::{Backward, Real, Var};

impl<F: Real> Var<'_, F> {
    /// The largest pixel of each window. The gradient goes to the first largest.
    ///
    /// # Shapes
    /// `[N, H, W, C]` → `[N, H', W', C]` with `H' = (H + 2 padding - kernel) / stride + 1`, and `W'` likewise.
    ///
    /// # Panics
    /// If the window does not fit, or padding is more than half of it.
    #[track_caller]
    #[inline(never)]
    pub fn max_pool2d(self, geometry: PoolGeometry) -> Self {
        let windows = self.windows("max_pool2d", |x| Windows::new(x, &geometry));
        let x = self.value();
        let mut y = self.tape.array(&windows.output_shape());
        let mut argument = self.tape.indices(y.len());
        pooling::max_pool(&windows, x.as_slice(), y.as_slice_mut(), &mut argument);
        self.tape.record_fn("max_pool2d", &[self], y, move |cx: &mut Backward<'_, F>| {
            let g = cx.grad_out();
            let g = g.as_slice();
            pooling::max_pool_grad(&windows, g, &argument, cx.grad_slice_mut(0));
        })
    }

    /// The mean of each window; padding counts as zeros, as in PyTorch.
    ///
    /// # Shapes
    /// As for [`max_pool2d`](Self::max_pool2d).
    ///
    /// # Panics
    /// If the window does not fit, or padding is more than half of it.
    #[track_caller]
    #[inline(never)]
    pub fn avg_pool2d(self, geometry: PoolGeometry) -> Self {
        self.mean_pool("avg_pool2d", |x| Windows::new(x, &geometry))
    }

    /// The means of `height x width` windows that share out the image: output `i` covers rows
    /// `floor(i H / height) .. ceil((i + 1) H / height)`.
    ///
    /// # Shapes
    /// `[N, H, W, C]` → `[N, height, width, C]`.
    ///
    /// # Panics
    /// If the image is empty.
    #[track_caller]
    #[inline(never)]
    pub fn adaptive_avg_pool2d(self, height: usize, width: usize) -> Self {
        self.mean_pool("adaptive_avg_pool2d", |x| Windows::adaptive(x, [height, width]))
    }

    #[track_caller]
    fn mean_pool(
        self,
        name: &'static str,
        windows: impl FnOnce([usize; 4]) -> Option<Windows>,
    ) -> Self {
        let windows = self.windows(name, windows);
        let x = self.value();
        let mut y = self.tape.array(&windows.output_shape());
        pooling::avg_pool(&windows, x.as_slice(), y.as_slice_mut());
        self.tape.record_fn(name, &[self], y, move |cx: &mut Backward<'_, F>| {
            let g = cx.grad_out();
            pooling::avg_pool_grad(&windows, g.as_slice(), cx.grad_slice_mut(0));
        })
    }

    #[track_caller]
    fn windows(
        self,
        op: &'static str,
        windows: impl FnOnce([usize; 4]) -> Option<Windows>,
    ) -> Windows {
        let shape = self.shape();
        self.tape.check(op, |shapes| {
            let x = shapes.axes("input", &shape, ["N", "H", "W", "C"])?;
            windows(x).ok_or_else(|| shapes.error("the windows do not fit the input"))
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::Tape;
    use crate::kernels::pooling::PoolGeometry;
    use crate::testkit::{Options, gradcheck};
    use ndarray::Array4;

    fn kinked() -> Options {
        Options::default().pieces()
    }

    gradcheck!(max: |x| x.max_pool2d(PoolGeometry::square(2)),
        shapes [[[1, 4, 6, 3]], [[2, 3, 2, 1]], [[1, 2, 2, 17]]], options kinked());
    gradcheck!(max_overlapping: |x| x.max_pool2d(PoolGeometry::square(3).stride(2).padding(1)),
        shapes [[[2, 7, 5, 3]], [[1, 1, 1, 1]]], options kinked());
    gradcheck!(avg: |x| x.avg_pool2d(PoolGeometry::square(3).stride(2).padding(1)),
        shapes [[[2, 7, 5, 3]], [[1, 1, 1, 1]], [[1, 4, 4, 17]]]);
    gradcheck!(adaptive: |x| x.adaptive_avg_pool2d(3, 2),
        shapes [[[2, 7, 5, 3]], [[1, 1, 1, 1]], [[1, 3, 2, 17]], [[1, 2, 9, 2]]]);

    #[test]
    fn values_by_hand() {
        let tape = Tape::<f32>::train(0);
        let image = Array4::from_shape_vec((1, 3, 3, 1), (1..=9).map(|x| x as f32).collect());
        let x = tape.leaf(image.expect("nine numbers"));
        let pooled = |geometry| x.max_pool2d(geometry).value().iter().copied().collect::<Vec<_>>();
        assert_eq!(pooled(PoolGeometry::square(2).stride(1)), [5.0, 6.0, 8.0, 9.0]);
        assert_eq!(pooled(PoolGeometry::square(2).padding(1)), [1.0, 3.0, 7.0, 9.0]);
        // Padding counts: 1/4, (2 + 3)/4, (4 + 7)/4, (5 + 6 + 8 + 9)/4.
        let mean = x.avg_pool2d(PoolGeometry::square(2).padding(1)).value();
        assert_eq!(mean.as_slice(), [0.25, 1.25, 2.75, 7.0]);
        let mean = x.adaptive_avg_pool2d(2, 1).value();
        assert_eq!(mean.as_slice(), [3.5, 6.5]);
    }

    #[test]
    #[should_panic(expected = "the windows do not fit the input")]
    fn windows_must_fit() {
        let tape = Tape::<f32>::eval();
        let _ =
            tape.constant(Array4::<f32>::zeros((1, 2, 2, 1))).max_pool2d(PoolGeometry::square(3));
    }
}
