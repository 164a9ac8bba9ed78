//! What a rule may see and do.

use crate::node::Node;
use crate::{Pool, PoolVec, Real, ShapeError, Tensor};

/// What a rule may see and do: read values, and accumulate gradients in place.
pub struct Backward<'a, F: Real> {
    pub(crate) nodes: &'a [Node<F>],
    pub(crate) inputs: &'a [u32],
    pub(crate) node: usize,
    pub(crate) grad_out: Option<Tensor<F>>,
    pub(crate) slots: &'a mut [Option<Tensor<F>>],
    pub(crate) pool: &'a Pool,
}

impl<F: Real> std::fmt::Debug for Backward<'_, F> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Backward").field("op", &self.nodes[self.node].name).finish_non_exhaustive()
    }
}

impl<F: Real> Backward<'_, F> {
    /// The number of inputs.
    pub fn input_count(&self) -> usize {
        self.inputs.len()
    }

    /// Whether input `i` wants a gradient. Skip the work where it does not.
    pub fn needs(&self, i: usize) -> bool {
        self.nodes[self.inputs[i] as usize].needs_grad
    }

    /// The value of input `i`.
    ///
    /// # Shapes
    /// That of input `i`.
    pub fn input(&self, i: usize) -> Tensor<F> {
        self.nodes[self.inputs[i] as usize].value().clone()
    }

    /// The value that the operation gave.
    ///
    /// # Shapes
    /// That which the operation gave.
    pub fn output(&self) -> Tensor<F> {
        self.nodes[self.node].value().clone()
    }

    /// The gradient of the output. Drop it before [`take_grad_out`](Self::take_grad_out), which
    /// must else copy.
    ///
    /// # Shapes
    /// That of the output.
    ///
    /// # Panics
    /// If it was taken.
    pub fn grad_out(&self) -> Tensor<F> {
        self.grad_out.clone().expect("the gradient of the output was taken")
    }

    /// The gradient of the output, to be changed in place and [given](Self::give) on. If it is
    /// not given on, [`recycle`](Self::recycle) it, or its memory is lost to the pool.
    ///
    /// # Shapes
    /// That of the output.
    ///
    /// # Panics
    /// If it was taken before.
    pub fn take_grad_out(&mut self) -> Tensor<F> {
        let shared = self.grad_out.take().expect("the gradient of the output was taken");
        self.pool.own(shared)
    }

    /// The gradient of input `i`, to be added to. Zero when it is touched first.
    #[inline(never)]
    pub fn grad_slice_mut(&mut self, i: usize) -> &mut [F] {
        let id = self.inputs[i] as usize;
        let (nodes, pool) = (self.nodes, self.pool);
        let zeros = || pool.filled(nodes[id].value().shape(), F::zero());
        self.slots[id].get_or_insert_with(zeros).as_slice_mut()
    }

    /// Whether input `i` has no gradient yet, so that one that is [given](Self::give) is moved
    /// rather than added.
    pub fn is_first(&self, i: usize) -> bool {
        self.slots[self.inputs[i] as usize].is_none()
    }

    /// Adds `gradient` to that of input `i`; moves it in when there is none yet. It goes back to
    /// the pool when input `i` wants none.
    ///
    /// # Shapes
    /// `gradient`: that of input `i`.
    ///
    /// # Panics
    /// If its shape is not that of the input.
    pub fn give(&mut self, i: usize, gradient: impl Into<Tensor<F>>) {
        let gradient = gradient.into();
        let id = self.inputs[i] as usize;
        let expected = self.nodes[id].value().shape();
        if gradient.shape() != expected {
            ShapeError::new(
                self.nodes[self.node].name,
                format!("the rule gave input {i} a gradient of another shape"),
            )
            .operand("gradient", gradient.shape(), "")
            .operand("input", expected, "")
            .panic();
        }
        if !self.nodes[id].needs_grad {
            self.recycle(gradient);
            return;
        }
        match &mut self.slots[id] {
            Some(sum) => {
                crate::kernels::elementwise::add_to(gradient.as_slice(), sum.as_slice_mut());
                self.pool.recycle(gradient);
            }
            empty => *empty = Some(self.pool.own(gradient)),
        }
    }

    /// [Gives](Self::give) input `i` the gradient that `write` puts into a stale slice of its length, every element
    /// of it. Does nothing when the input wants none.
    pub fn give_with(&mut self, i: usize, write: impl FnOnce(&mut [F])) {
        if self.needs(i) {
            let mut gradient = self.pool.array(self.nodes[self.inputs[i] as usize].value().shape());
            write(gradient.as_slice_mut());
            self.give(i, gradient);
        }
    }

    /// As [`give_with`](Self::give_with), but where input `i` has a gradient already, `write` is called with that and
    /// `true`, and adds to it.
    pub fn add_with(&mut self, i: usize, write: impl FnOnce(&mut [F], bool)) {
        if self.is_first(i) {
            self.give_with(i, |gradient| write(gradient, false));
        } else if self.needs(i) {
            write(self.grad_slice_mut(i), true);
        }
    }

    /// Gives the memory of an array to the pool, if nobody else holds it.
    ///
    /// # Shapes
    /// Any.
    pub fn recycle(&self, array: impl Into<Tensor<F>>) {
        self.pool.recycle(array.into());
    }

    /// Working memory, stale but initialised.
    pub fn scratch(&self, len: usize) -> PoolVec<F> {
        self.pool.vec(len)
    }

    /// A tensor from the pool, stale but initialised: to be written whole and [given](Self::give).
    ///
    /// # Shapes
    /// `shape`.
    pub fn array(&self, shape: &[usize]) -> Tensor<F> {
        self.pool.array(shape)
    }

    /// The pool that all buffers of the tape come from.
    pub fn pool(&self) -> &Pool {
        self.pool
    }
}
