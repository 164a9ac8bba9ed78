//! Softmax over the last axis.

use crate::kernels::softmax;
use crate::{Backward, Real, Var};

impl<F: Real> Var<'_, F> {
    /// `exp(x) / Σ exp(x)` over the last axis; any finite row gives a finite result.
    ///
    /// # Shapes
    /// `[.., D]` → `[.., D]`; each row of `D` sums to 1.
    ///
    /// # Panics
    /// If there is no axis.
    #[track_caller]
    #[inline(never)]
    pub fn softmax(self) -> Self {
        self.by_rows("softmax", softmax::softmax, softmax::softmax_grad)
    }

    /// `x - ln Σ exp(x)` over the last axis: the logarithm of [`softmax`](Self::softmax), without
    /// its underflow.
    ///
    /// # Shapes
    /// `[.., D]` → `[.., D]`.
    ///
    /// # Panics
    /// If there is no axis.
    #[track_caller]
    #[inline(never)]
    pub fn log_softmax(self) -> Self {
        self.by_rows("log_softmax", softmax::log_softmax, softmax::log_softmax_grad)
    }

    #[track_caller]
    fn by_rows(
        self,
        name: &'static str,
        forward: fn(&[F], usize, &mut [F]),
        backward: fn(&[F], usize, &mut [F]),
    ) -> Self {
        let x = self.value();
        let Some(&width) = x.shape().last() else {
            self.tape.refuse(name, "at least one axis expected", &[("input", x.shape(), "")])
        };
        let mut y = self.tape.array(x.shape());
        forward(x.as_slice(), width, y.as_slice_mut());
        self.tape.record_fn(name, &[self], y, move |cx: &mut Backward<'_, F>| {
            let (y, mut g) = (cx.output(), cx.take_grad_out());
            backward(y.as_slice(), width, g.as_slice_mut());
            cx.give(0, g);
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::Tape;
    use crate::testkit::gradcheck;
    use ndarray::{arr1, arr2};

    gradcheck!(softmax: |x| x.softmax(), shapes [[[3, 5]], [[1]], [[2, 3, 17]], [[2, 40]], [[0, 3]]]);
    gradcheck!(log_softmax: |x| x.log_softmax(), shapes [[[3, 5]], [[1]], [[2, 3, 17]], [[2, 40]]]);

    #[test]
    fn large_numbers_do_not_overflow() {
        let tape = Tape::<f32>::eval();
        let x = tape.constant(arr2(&[[1000.0, 1000.0], [-1000.0, 0.0]]));
        let y = x.softmax().value();
        assert_eq!(y.as_slice(), [0.5, 0.5, 0.0, 1.0]);
        let y = x.log_softmax().value();
        assert!((y[[0, 0]] + std::f32::consts::LN_2).abs() < 1e-6);
        assert_eq!(y[[1, 0]], -1000.0);
    }

    #[test]
    fn values_by_hand() {
        let tape = Tape::<f64>::eval();
        let y = tape.constant(arr1(&[0.0, 2.0_f64.ln(), 3.0_f64.ln()])).softmax().value();
        for (y, expected) in y.iter().zip([1.0 / 6.0, 2.0 / 6.0, 3.0 / 6.0]) {
            assert!((y - expected).abs() < 1e-15);
        }
    }
}
