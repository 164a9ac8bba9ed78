//! What can be integrated.

use autodiff_lite::kernels::elementwise;
use autodiff_lite::{Real, Tensor, Var};
use ndarray::{ArrayBase, DataMut, DataOwned, Dimension, RawDataClone};

use super::Tolerance;

/// What integration asks of a state: linear combinations, and the size of an error.
///
/// Numbers, `[F; N]`, `Vec<F>`, arrays of `ndarray`, variables on a tape, and pairs and triples of states have it. On a
/// tape each combination is one recorded operation, so that a gradient flows through all of the integration.
pub trait State: Clone {
    /// `Σ c y` over all terms, of which there is at least one; all have the same shape.
    #[must_use]
    fn lincomb(terms: &[(f64, &Self)]) -> Self;

    /// The squares of `error / (absolute + relative max(|before|, |after|))`, element by element, summed.
    fn error_squares(error: &Self, before: &Self, after: &Self, tolerance: Tolerance) -> Squares;
}

/// A sum of squares and how many there are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Squares {
    /// Their sum.
    pub sum: f64,
    /// Their number.
    pub count: usize,
}

impl Squares {
    /// The root of their mean, 0 where there are none.
    pub fn rms(self) -> f64 {
        (self.sum / self.count.max(1) as f64).sqrt()
    }

    /// Of both together.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        Self { sum: self.sum + other.sum, count: self.count + other.count }
    }
}

/// Whether every element is a finite number.
pub(crate) fn is_finite<Y: State>(y: &Y) -> bool {
    // |y| / (1 + |y|) is below 1, and infinity over infinity is no number.
    Y::error_squares(y, y, y, Tolerance { relative: 1.0, absolute: 1.0 }).sum.is_finite()
}

/// Elements summed in their own precision before the sum goes on in double precision.
const CHUNK: usize = 1024;

/// [`State::error_squares`] of slices: fixed chunks, so that no bit depends on the machine.
pub(crate) fn slice_squares<F: Real>(
    error: &[F],
    before: &[F],
    after: &[F],
    tolerance: Tolerance,
) -> Squares {
    // Sixteen sums side by side: one alone would wait for each addition.
    const LANES: usize = 16;
    let (relative, absolute) = (F::from_f64(tolerance.relative), F::from_f64(tolerance.absolute));
    let square = |e: F, b: F, a: F| {
        let (b, a) = (b.abs(), a.abs());
        let scaled = e / (absolute + relative * if b > a { b } else { a });
        scaled * scaled
    };
    let chunks = error.chunks(CHUNK).zip(before.chunks(CHUNK)).zip(after.chunks(CHUNK));
    let sum = chunks.map(|((error, before), after)| {
        let (e, e_rest) = error.as_chunks::<LANES>();
        let (b, b_rest) = before.as_chunks::<LANES>();
        let (a, a_rest) = after.as_chunks::<LANES>();
        let mut sums = [F::zero(); LANES];
        for ((e, b), a) in e.iter().zip(b).zip(a) {
            for k in 0..LANES {
                sums[k] += square(e[k], b[k], a[k]);
            }
        }
        let rest = e_rest.iter().zip(b_rest).zip(a_rest).map(|((&e, &b), &a)| square(e, b, a));
        let wide: f64 = sums.iter().map(|&s| Real::to_f64(s)).sum();
        wide + Real::to_f64(rest.sum::<F>())
    });
    Squares { sum: sum.sum(), count: error.len() }
}

/// Combines slices of one length into one that was made for it.
pub(crate) fn combine<F: Real>(factors: &[f64], slices: &[&[F]], out: &mut [F]) {
    let terms: Vec<(F, &[F])> =
        factors.iter().map(|&c| F::from_f64(c)).zip(slices.iter().copied()).collect();
    elementwise::lincomb(&terms, out);
}

/// Why these arrays have slices.
const STANDARD: &str = "it was just made in standard layout";

macro_rules! number_state {
    ($($number:ty),*) => {$(
        impl State for $number {
            fn lincomb(terms: &[(f64, &Self)]) -> Self {
                terms.iter().map(|&(c, y)| c as Self * y).sum()
            }

            fn error_squares(
                error: &Self,
                before: &Self,
                after: &Self,
                tolerance: Tolerance,
            ) -> Squares {
                slice_squares(&[*error], &[*before], &[*after], tolerance)
            }
        }
    )*};
}
number_state!(f32, f64);

impl<F: Real, const N: usize> State for [F; N] {
    fn lincomb(terms: &[(f64, &Self)]) -> Self {
        let mut sum = [F::zero(); N];
        for (c, y) in terms {
            let c = F::from_f64(*c);
            for (sum, &y) in sum.iter_mut().zip(*y) {
                *sum += c * y;
            }
        }
        sum
    }

    fn error_squares(error: &Self, before: &Self, after: &Self, tolerance: Tolerance) -> Squares {
        slice_squares(error, before, after, tolerance)
    }
}

impl<F: Real> State for Vec<F> {
    fn lincomb(terms: &[(f64, &Self)]) -> Self {
        let mut out = vec![F::zero(); terms[0].1.len()];
        let factors: Vec<f64> = terms.iter().map(|&(c, _)| c).collect();
        let slices: Vec<&[F]> = terms.iter().map(|(_, y)| y.as_slice()).collect();
        combine(&factors, &slices, &mut out);
        out
    }

    fn error_squares(error: &Self, before: &Self, after: &Self, tolerance: Tolerance) -> Squares {
        slice_squares(error, before, after, tolerance)
    }
}

/// Owned and shared arrays.
impl<F: Real, S, D: Dimension> State for ArrayBase<S, D>
where
    S: DataOwned<Elem = F> + DataMut + RawDataClone,
{
    fn lincomb(terms: &[(f64, &Self)]) -> Self {
        let standard: Vec<_> = terms.iter().map(|(_, y)| y.as_standard_layout()).collect();
        let slices: Vec<&[F]> = standard.iter().map(|y| y.as_slice().expect(STANDARD)).collect();
        let factors: Vec<f64> = terms.iter().map(|&(c, _)| c).collect();
        let mut out = Self::zeros(terms[0].1.raw_dim());
        combine(&factors, &slices, out.as_slice_mut().expect(STANDARD));
        out
    }

    fn error_squares(error: &Self, before: &Self, after: &Self, tolerance: Tolerance) -> Squares {
        let standard = [error, before, after].map(|y| y.as_standard_layout());
        let [e, b, a] = standard.each_ref().map(|y| y.as_slice().expect(STANDARD));
        slice_squares(e, b, a, tolerance)
    }
}

impl<F: Real> State for Var<'_, F> {
    #[track_caller]
    fn lincomb(terms: &[(f64, &Self)]) -> Self {
        let own: Vec<_> = terms.iter().map(|&(c, &y)| (F::from_f64(c), y)).collect();
        terms[0].1.tape().lincomb(&own)
    }

    fn error_squares(error: &Self, before: &Self, after: &Self, tolerance: Tolerance) -> Squares {
        let values = [error, before, after].map(|y| y.value());
        let [e, b, a] = values.each_ref().map(Tensor::as_slice);
        slice_squares(e, b, a, tolerance)
    }
}

impl<A: State, B: State> State for (A, B) {
    fn lincomb(terms: &[(f64, &Self)]) -> Self {
        let first: Vec<_> = terms.iter().map(|(c, y)| (*c, &y.0)).collect();
        let second: Vec<_> = terms.iter().map(|(c, y)| (*c, &y.1)).collect();
        (A::lincomb(&first), B::lincomb(&second))
    }

    fn error_squares(error: &Self, before: &Self, after: &Self, tolerance: Tolerance) -> Squares {
        let first = A::error_squares(&error.0, &before.0, &after.0, tolerance);
        first.plus(B::error_squares(&error.1, &before.1, &after.1, tolerance))
    }
}

impl<A: State, B: State, C: State> State for (A, B, C) {
    fn lincomb(terms: &[(f64, &Self)]) -> Self {
        let first: Vec<_> = terms.iter().map(|(c, y)| (*c, &y.0)).collect();
        let second: Vec<_> = terms.iter().map(|(c, y)| (*c, &y.1)).collect();
        let third: Vec<_> = terms.iter().map(|(c, y)| (*c, &y.2)).collect();
        (A::lincomb(&first), B::lincomb(&second), C::lincomb(&third))
    }

    fn error_squares(error: &Self, before: &Self, after: &Self, tolerance: Tolerance) -> Squares {
        let first = A::error_squares(&error.0, &before.0, &after.0, tolerance);
        let second = B::error_squares(&error.1, &before.1, &after.1, tolerance);
        first.plus(second).plus(C::error_squares(&error.2, &before.2, &after.2, tolerance))
    }
}
