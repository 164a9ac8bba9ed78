//! States outside of any tape, whose memory is the tape's.

use autodiff_lite::{Pool, Real, Tensor};

use crate::solve::{Squares, State, Tolerance, combine, slice_squares};

/// An array whose memory goes back to a pool with its last owner.
#[derive(Clone, Debug)]
pub(super) struct Kept<F: Real> {
    /// `None` only while it is dropped.
    value: Option<Tensor<F>>,
    pool: Pool,
}

impl<F: Real> Kept<F> {
    pub(super) fn new(value: Tensor<F>, pool: &Pool) -> Self {
        Self { value: Some(value), pool: pool.clone() }
    }

    pub(super) fn zeros(shape: &[usize], pool: &Pool) -> Self {
        Self::new(pool.filled(shape, F::zero()), pool)
    }

    /// The array, out of the pool's care.
    pub(super) fn into_tensor(mut self) -> Tensor<F> {
        self.value.take().expect("there until it is dropped")
    }

    pub(super) fn tensor(&self) -> &Tensor<F> {
        self.value.as_ref().expect("there until it is dropped")
    }
}

impl<F: Real> Drop for Kept<F> {
    fn drop(&mut self) {
        if let Some(value) = self.value.take() {
            self.pool.recycle(value);
        }
    }
}

impl<F: Real> State for Kept<F> {
    fn lincomb(terms: &[(f64, &Self)]) -> Self {
        let (first, pool) = (terms[0].1, &terms[0].1.pool);
        let mut out = pool.array(first.tensor().shape());
        let factors: Vec<f64> = terms.iter().map(|&(c, _)| c).collect();
        let slices: Vec<&[F]> = terms.iter().map(|(_, y)| y.tensor().as_slice()).collect();
        combine(&factors, &slices, out.as_slice_mut());
        Self::new(out, pool)
    }

    fn error_squares(error: &Self, before: &Self, after: &Self, tolerance: Tolerance) -> Squares {
        let [error, before, after] = [error, before, after].map(|y| y.tensor().as_slice());
        slice_squares(error, before, after, tolerance)
    }
}
