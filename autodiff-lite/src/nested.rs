//! Tapes within a tape: a part of a model that is computed now and recorded later.

use std::ops::{Deref, DerefMut};
use std::sync::{Arc, Mutex, PoisonError};

use crate::{Real, Tape};

/// A tape of its own within another: same mode, same pool. Dropping it empties it and keeps it for the next
/// [`Tape::nested`].
#[derive(Debug)]
pub struct NestedTape<F: Real = f32> {
    /// `None` only while it is dropped.
    tape: Option<Tape<F>>,
    home: Arc<Mutex<Vec<Tape<F>>>>,
}

impl<F: Real> Tape<F> {
    /// A tape that records or only computes as this one does, and shares its memory.
    ///
    /// An operation that trades time for memory computes on it forward, keeps only its inputs, and computes once
    /// more and walks back in its rule, where the nested tape may be held until then. It is seeded with 0:
    /// [reseed](Tape::reseed) it where a model draws, and do so alike both times.
    ///
    /// ```
    /// use autodiff_lite::{Backward, Tape};
    ///
    /// let outer = Tape::<f64>::train(0);
    /// let x = outer.leaf(ndarray::arr1(&[2.0, 3.0]));
    /// // sin(x)² without keeping sin(x): forward on constants records nothing,
    /// let forward = outer.nested();
    /// let y = forward.constant(x.value()).sin().square().value();
    /// let y = outer.record_fn("sine_squared", &[x], y, {
    ///     let replay = std::sync::Mutex::new(forward);
    ///     move |cx: &mut Backward<'_, f64>| {
    ///         // and what is needed is recorded anew when the gradient has come.
    ///         let mut tape = replay.lock().expect("one walk at a time");
    ///         let x = tape.leaf(cx.input(0));
    ///         let gradient = x.sin().square().backward_with(cx.grad_out()).wrt(x).expect("used").to_owned();
    ///         tape.reset();
    ///         cx.give(0, gradient);
    ///     }
    /// });
    /// let gradients = y.sum().backward();
    /// let found = gradients.wrt(x).expect("used");
    /// assert!((found[0] - 4.0_f64.sin()).abs() < 1e-12); // 2 sin x cos x
    /// ```
    pub fn nested(&self) -> NestedTape<F> {
        let home = Arc::clone(&self.nests);
        let waiting = home.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut tape = waiting.unwrap_or_else(|| self.nest());
        tape.reseed(0);
        // Panics name the whole way.
        tape.path.get_mut().push_str(&self.path());
        NestedTape { tape: Some(tape), home }
    }
}

impl<F: Real> Deref for NestedTape<F> {
    type Target = Tape<F>;

    fn deref(&self) -> &Tape<F> {
        self.tape.as_ref().expect("there until it is dropped")
    }
}

impl<F: Real> DerefMut for NestedTape<F> {
    fn deref_mut(&mut self) -> &mut Tape<F> {
        self.tape.as_mut().expect("there until it is dropped")
    }
}

impl<F: Real> Drop for NestedTape<F> {
    fn drop(&mut self) {
        if let Some(mut tape) = self.tape.take() {
            tape.reset();
            tape.path.get_mut().clear();
            self.home.lock().unwrap_or_else(PoisonError::into_inner).push(tape);
        }
    }
}

#[cfg(test)]
mod tests {
    use ndarray::arr1;

    use crate::Tape;

    #[test]
    fn memory_and_the_tape_itself_are_used_again() {
        let outer = Tape::<f32>::train(0);
        let address = outer.nested().buffer(3).as_ptr();
        assert_eq!(outer.array(&[3]).as_ptr(), address, "the buffer is in the shared pool");
        let mut inner = outer.nested();
        let _ = inner.leaf(arr1(&[1.0]));
        inner.reset();
        assert!(inner.is_empty() && inner.is_training());
        assert!(!Tape::<f32>::eval().nested().is_training());
    }

    #[test]
    fn inner_steps_do_not_age_the_memory_of_the_outer_tape() {
        let outer = Tape::<f32>::train(0);
        drop(outer.buffer(1000));
        for _ in 0..2000 {
            let mut inner = outer.nested();
            let _ = inner.leaf(arr1(&[1.0]));
            inner.reset();
        }
        assert!(outer.pool().bytes() >= 4000);
    }

    #[test]
    #[should_panic(expected = "at flow")]
    fn panics_name_the_way_from_the_outermost_tape() {
        let outer = Tape::<f32>::eval();
        let _ = outer.scope("flow", || {
            let inner = outer.nested();
            let _ = inner.constant(arr1(&[1.0, 2.0])) + inner.constant(arr1(&[1.0, 2.0, 3.0]));
            outer.constant(arr1(&[0.0]))
        });
    }
}
