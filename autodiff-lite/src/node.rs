//! What a tape keeps of each value.

use crate::{ParamId, Real, Tensor};

/// A value and what is known of it.
pub(crate) struct Node<F: Real> {
    /// `None` once it was freed.
    pub(crate) value: Option<Tensor<F>>,
    pub(crate) first_edge: u32,
    pub(crate) edge_count: u32,
    pub(crate) needs_grad: bool,
    pub(crate) param: Option<ParamId>,
    pub(crate) name: &'static str,
}

impl<F: Real> Node<F> {
    #[track_caller]
    pub(crate) fn value(&self) -> &Tensor<F> {
        match &self.value {
            Some(value) => value,
            None => panic!(
                "the result of `{}` was freed when its scope ended: hand it out of the scope",
                self.name
            ),
        }
    }
}
