//! Dropout: a random part of the elements is set to zero while training.

use crate::kernels::dropout::{Kept, draw, dropped};
use crate::{Backward, PoolVec, Real, Tape, Var};

impl<F: Real> Var<'_, F> {
    /// Sets each element to zero with probability `p` and divides the others by `1 - p`, so that
    /// the mean stays. On an eval tape nothing happens. `p` is rounded to a multiple of 2⁻¹⁶.
    ///
    /// What is dropped follows from the tape's seed and from how many random operations came
    /// before in the same step: without [`Tape::reseed`](crate::Tape::reseed) every step drops the same elements.
    ///
    /// # Shapes
    /// Any → the same.
    ///
    /// # Panics
    /// If `p` is not within `[0, 1)`.
    #[track_caller]
    #[inline(never)]
    pub fn dropout(self, p: f64) -> Self {
        let x = self.value();
        let Some(mask) = keep_mask(self.tape, x.len(), p) else { return self };
        let scale = keep_scale(p);
        let mut y = self.tape.array(x.shape());
        Kept { bits: &mask, scale }.apply_to(x.as_slice(), y.as_slice_mut());
        self.tape.record_fn("dropout", &[self], y, move |cx: &mut Backward<'_, F>| {
            let mut g = cx.take_grad_out();
            Kept { bits: &mask, scale }.apply_all(g.as_slice_mut());
            cx.give(0, g);
        })
    }
}

/// For each of `len` elements a bit that says whether it is kept; none where nothing is dropped.
#[track_caller]
pub(crate) fn keep_mask<F: Real>(tape: &Tape<F>, len: usize, p: f64) -> Option<PoolVec<u32>> {
    if !(0.0..1.0).contains(&p) {
        tape.refuse("dropout", format!("the probability {p} is not within [0, 1)"), &[]);
    }
    if !tape.is_training() || p == 0.0 {
        return None;
    }
    let mut mask = tape.indices(len.div_ceil(32));
    draw(&tape.rng(), dropped(p), &mut mask);
    Some(mask)
}

/// What kept elements are multiplied by, so that the mean stays.
pub(crate) fn keep_scale<F: Real>(p: f64) -> F {
    F::from_f64(65536.0 / (65536.0 - f64::from(dropped(p))))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use ndarray::Array1;

    use crate::Tape;
    use crate::testkit::gradcheck;

    gradcheck!(dropout: |x| x.dropout(0.4), shapes [[[3, 5]], [[100]], [[]], [[0]]]);

    #[test]
    fn the_mean_stays_and_the_seed_decides() {
        let mut tape = Tape::<f32>::train(3);
        let ones = Array1::<f32>::ones(100_000).into_shared();
        let first = tape.constant(ones.clone()).dropout(0.3).value();
        assert!((first.mean().unwrap() - 1.0).abs() < 0.01);
        let zeros = first.iter().filter(|&&x| x == 0.0).count();
        assert!((zeros as f64 / 100_000.0 - 0.3).abs() < 0.01, "{zeros} zeros");
        let second = tape.constant(ones.clone()).dropout(0.3).value();
        assert_ne!(first, second);
        tape.reset();
        assert_eq!(first, tape.constant(ones.clone()).dropout(0.3).value());
        let tape = Tape::<f32>::eval();
        assert_eq!(tape.constant(ones.clone()).dropout(0.3).value(), ones);
    }
}
