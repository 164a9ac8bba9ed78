//! Handles to values on a tape.

use std::fmt;

use crate::{Real, Tape, Tensor};

/// A value on a tape: a pointer and an index, copied freely.
#[derive(Clone, Copy)]
#[must_use = "a value that nobody uses was computed for nothing"]
pub struct Var<'t, F: Real = f32> {
    pub(crate) tape: &'t Tape<F>,
    pub(crate) id: u32,
}

impl<F: Real> fmt::Debug for Var<'_, F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Var({}: {})", self.id, self.tape.describe(self.id))
    }
}

/// # Shapes
/// Any, where nothing else is said.
impl<'t, F: Real> Var<'t, F> {
    /// The tape it lives on.
    pub fn tape(self) -> &'t Tape<F> {
        self.tape
    }

    /// The value, shared by reference count.
    ///
    /// # Panics
    /// If the value was freed at the end of a scope of an eval tape.
    #[track_caller]
    pub fn value(self) -> Tensor<F> {
        self.tape.value_of(self.id)
    }

    /// The sizes of its axes.
    #[track_caller]
    pub fn shape(self) -> Vec<usize> {
        self.tape.with_value(self.id, |value| value.shape().to_vec())
    }

    /// The number of its axes.
    #[track_caller]
    pub fn rank(self) -> usize {
        self.tape.with_value(self.id, |value| value.ndim())
    }

    /// The number of its elements.
    #[track_caller]
    pub fn len(self) -> usize {
        self.tape.with_value(self.id, |value| value.len())
    }

    /// Whether it has no element.
    #[track_caller]
    pub fn is_empty(self) -> bool {
        self.len() == 0
    }

    /// The sizes of exactly `N` axes.
    #[track_caller]
    pub fn dims<const N: usize>(self) -> [usize; N] {
        let shape = self.shape();
        let Ok(dims) = <[usize; N]>::try_from(shape.as_slice()) else {
            let message = format!("{N} axes expected");
            self.tape.refuse("dims", message, &[("value", &shape, "")])
        };
        dims
    }

    /// The only element.
    #[track_caller]
    pub fn item(self) -> F {
        let value = self.value();
        let &[only] = value.as_slice() else {
            let operands = [("value", value.shape(), "")];
            self.tape.refuse("item", "exactly one element expected", &operands)
        };
        only
    }

    /// Whether a gradient would flow into it.
    pub fn needs_grad(self) -> bool {
        self.tape.needs_grad(self.id)
    }

    /// The same value, cut off from what it was computed from.
    #[track_caller]
    pub fn detach(self) -> Self {
        self.tape.constant(self.value())
    }
}
