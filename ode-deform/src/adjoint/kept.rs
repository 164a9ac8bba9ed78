//! States outside of any tape, whose memory is the tape's.

use autodiff_lite::{CONTIGUOUS, Pool, Real, Tensor};

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
        let mut zeros = pool.array(shape);
        zeros.fill(F::zero());
        Self::new(zeros.into_shared(), pool)
    }

    pub(super) fn tensor(&self) -> &Tensor<F> {
        self.value.as_ref().expect("there until it is dropped")
    }

    pub(super) fn slice(&self) -> &[F] {
        self.tensor().as_slice().expect(CONTIGUOUS)
    }
}

impl<F: Real> Drop for Kept<F> {
    fn drop(&mut self) {
        if let Some(Ok(own)) = self.value.take().map(Tensor::try_into_owned_nocopy) {
            self.pool.give_array(own);
        }
    }
}

impl<F: Real> State for Kept<F> {
    fn lincomb(terms: &[(f64, &Self)]) -> Self {
        let (first, pool) = (terms[0].1, &terms[0].1.pool);
        let mut out = pool.array(first.tensor().shape());
        let factors: Vec<f64> = terms.iter().map(|&(c, _)| c).collect();
        let slices: Vec<&[F]> = terms.iter().map(|(_, y)| y.slice()).collect();
        combine(&factors, &slices, out.as_slice_mut().expect(CONTIGUOUS));
        Self::new(out.into_shared(), pool)
    }

    fn error_squares(error: &Self, before: &Self, after: &Self, tolerance: Tolerance) -> Squares {
        slice_squares(error.slice(), before.slice(), after.slice(), tolerance)
    }
}
