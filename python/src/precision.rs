//! The two precisions, chosen by the `dtype` of what Python gives.

use std::sync::{LazyLock, Mutex, MutexGuard, PoisonError};

use autodiff_lite::{NestedTape, Real, Tape};
use numpy::{Element, PyReadonlyArrayDyn};

use crate::arrays::Floats;

/// `f32` or `f64`, with what depends on which of the two it is.
pub(crate) trait Precision: Real + Element {
    /// NumPy's name.
    const DTYPE: &'static str;

    /// The tape whose memory the tapes of all calls share, so that a loop takes no fresh pages.
    fn home() -> &'static Mutex<Tape<Self>>;

    /// The array, if it is of this precision.
    fn of<'a, 'py>(array: &'a Floats<'py>) -> Option<&'a PyReadonlyArrayDyn<'py, Self>>;
}

/// A tape for one call.
pub(crate) fn tape<F: Precision>() -> NestedTape<F> {
    let mut home: MutexGuard<'_, Tape<F>> =
        F::home().lock().unwrap_or_else(PoisonError::into_inner);
    // Nothing is on it: this only counts, so that memory which went out of use is given back.
    home.reset();
    home.nested()
}

macro_rules! precision {
    ($number:ty, $dtype:literal, $variant:ident) => {
        impl Precision for $number {
            const DTYPE: &'static str = $dtype;

            fn home() -> &'static Mutex<Tape<Self>> {
                static HOME: LazyLock<Mutex<Tape<$number>>> =
                    LazyLock::new(|| Mutex::new(Tape::eval_with_gradients()));
                &HOME
            }

            fn of<'a, 'py>(array: &'a Floats<'py>) -> Option<&'a PyReadonlyArrayDyn<'py, Self>> {
                match array {
                    Floats::$variant(array) => Some(array),
                    _ => None,
                }
            }
        }
    };
}
precision!(f32, "float32", Single);
precision!(f64, "float64", Double);
