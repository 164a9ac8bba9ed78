//! Sums and means.

use ndarray::arr0;

use crate::{Backward, CONTIGUOUS, Real, Var};

impl<F: Real> Var<'_, F> {
    /// The sum of all elements, a scalar `[]`.
    #[track_caller]
    pub fn sum(self) -> Self {
        let x = self.value();
        let total: F = x.as_slice().expect(CONTIGUOUS).iter().sum();
        let mut y = self.tape.array(&[]);
        y.assign(&arr0(total));
        self.tape.record_fn("sum", &[self], y, |cx: &mut Backward<'_, F>| {
            let g = *cx.grad_out().first().expect("a scalar has one element");
            cx.grad_slice_mut(0).iter_mut().for_each(|x| *x += g);
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::testkit::gradcheck;

    gradcheck!(sum: |x| x.sum(), shapes [[[3, 5]], [[]], [[2, 0]]]);
}
