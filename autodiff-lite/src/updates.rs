//! Running statistics: what a forward pass learns without a gradient.

use crate::param::Shared;
use crate::{Module, Param, ParamId, PoolVec, Real};

/// A wish to move a buffer towards a new observation: `buffer ← (1 - momentum) buffer + momentum value`.
///
/// Forward passes take modules by shared reference, so a batch norm cannot write its running
/// statistics; it [pushes](crate::Tape::push_update) this, and whoever owns the module applies
/// it together with the optimiser's step.
#[derive(Debug)]
pub struct BufferUpdate<F: Real = f32> {
    param: ParamId,
    value: PoolVec<F>,
    momentum: F,
}

impl<F: Real> BufferUpdate<F> {
    /// Moves `buffer` towards `value` by the fraction `momentum` in `[0, 1]`.
    ///
    /// # Panics
    /// If the lengths differ.
    #[track_caller]
    pub fn new(buffer: &Param<F>, value: PoolVec<F>, momentum: F) -> Self {
        assert_eq!(buffer.len(), value.len(), "a buffer and its update differ in length");
        Self { param: buffer.id(), value, momentum }
    }

    /// The buffer that is moved.
    pub fn param(&self) -> ParamId {
        self.param
    }

    /// The observation.
    pub fn value(&self) -> &[F] {
        &self.value
    }

    /// The fraction of the way to it.
    pub fn momentum(&self) -> F {
        self.momentum
    }
}

/// The buffer updates of one step, in order; see [`Tape::take_updates`](crate::Tape::take_updates).
#[derive(Debug)]
pub struct Updates<F: Real = f32>(pub(crate) Vec<BufferUpdate<F>>);

impl<F: Real> Updates<F> {
    /// Applies them to the buffers of `module`. Reset the tape before, or each buffer is copied.
    pub fn apply(self, module: &mut (impl Module<F> + ?Sized)) {
        if self.0.is_empty() {
            return;
        }
        let mut shared = Shared::new();
        module.visit_mut("", &mut |_: &str, param: &mut Param<F>| {
            let id = param.id();
            if !self.0.iter().any(|update| update.param == id) {
                return;
            }
            shared.change(param, |param| {
                for update in self.0.iter().filter(|update| update.param == id) {
                    for (b, &v) in param.as_slice_mut().iter_mut().zip(update.value.iter()) {
                        *b += update.momentum * (v - *b);
                    }
                }
            });
        });
    }

    /// One by one, in order: to be told to another process, which makes them anew.
    pub fn iter(&self) -> impl Iterator<Item = &BufferUpdate<F>> {
        self.0.iter()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}
