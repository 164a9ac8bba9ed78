//! Parameters: the arrays that a module owns.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::{Real, Tensor};

/// Identifies a parameter for as long as the program runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ParamId(u64);

impl ParamId {
    fn fresh() -> Self {
        // The number only tells parameters apart; nothing is computed from it.
        static NEXT: AtomicU64 = AtomicU64::new(0);
        Self(NEXT.fetch_add(1, Ordering::Relaxed))
    }
}

/// What was changed of a module so far: a parameter that stands in it twice, by cloning, is changed once, and both go on sharing
/// their memory.
pub(crate) struct Shared<F: Real> {
    /// Where the values of a parameter were before, and what they are now.
    changed: BTreeMap<ParamId, (usize, Tensor<F>)>,
}

impl<F: Real> Shared<F> {
    pub(crate) fn new() -> Self {
        Self { changed: BTreeMap::new() }
    }

    /// Calls `change` with a parameter, or gives it what another that shared its values has become.
    pub(crate) fn change(&mut self, param: &mut Param<F>, change: impl FnOnce(&mut Param<F>)) {
        let place = param.value.as_ptr().addr();
        match self.changed.get(&param.id) {
            // A clone that went its own way since lies elsewhere.
            Some((before, now)) if *before == place => param.value = now.clone(),
            _ => {
                change(param);
                self.changed.insert(param.id, (place, param.value.clone()));
            }
        }
    }
}

/// An array that a module owns and, if it is trainable, an optimiser changes.
///
/// Buffers such as the running statistics of a batch norm are parameters that are not trainable:
/// they are saved and loaded with the others, and no optimiser touches them.
///
/// Cloning shares the memory and keeps the identity, so that an operation may hold a clone of the
/// field it was called with, and a module may have one parameter in two places (`head = embed.clone()`):
/// optimisers change it once and keep it shared, which takes a fresh copy in each step.
#[derive(Clone, Debug)]
pub struct Param<F: Real = f32> {
    id: ParamId,
    /// The present value.
    pub value: Tensor<F>,
    /// Whether gradients are wanted and optimisers may write.
    pub trainable: bool,
    buffer: bool,
}

impl<F: Real> Param<F> {
    /// A trainable parameter with a new identity.
    ///
    /// # Shapes
    /// Any, which the parameter then has for good.
    pub fn new(value: impl Into<Tensor<F>>) -> Self {
        Self { id: ParamId::fresh(), value: value.into(), trainable: true, buffer: false }
    }

    /// A parameter that is saved but not trained.
    ///
    /// # Shapes
    /// Any, which the parameter then has for good.
    pub fn buffer(value: impl Into<Tensor<F>>) -> Self {
        Self { trainable: false, buffer: true, ..Self::new(value) }
    }

    /// Whether it was made as a [`buffer`](Self::buffer): one that is not trained whatever else is.
    pub fn is_buffer(&self) -> bool {
        self.buffer
    }

    /// Its identity.
    pub fn id(&self) -> ParamId {
        self.id
    }

    /// Its dimensions.
    pub fn shape(&self) -> &[usize] {
        self.value.shape()
    }

    /// Its number of elements.
    pub fn len(&self) -> usize {
        self.value.len()
    }

    /// Whether it has no element.
    pub fn is_empty(&self) -> bool {
        self.value.is_empty()
    }

    /// Its elements.
    pub fn as_slice(&self) -> &[F] {
        self.value.as_slice()
    }

    /// Its elements, to be written.
    ///
    /// In place when nobody else holds the value, that is, after the tape was reset; else the
    /// parameter gets a copy of its own first.
    pub fn as_slice_mut(&mut self) -> &mut [F] {
        self.value.as_slice_mut()
    }
}
