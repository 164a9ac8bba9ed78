//! The tape: everything computed in one evaluation of a model.

use std::cell::{Cell, Ref, RefCell};
use std::collections::HashMap;
use std::fmt;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::gradients::Spare;
use crate::node::Node;
use crate::op::FnOp;
use crate::{
    Backward, BufferUpdate, Gradients, Op, Param, ParamId, Pool, PoolVec, Real, Tensor, Updates,
    Var,
};

/// Everything computed in one evaluation of a model, in the order of computation.
///
/// A *training* tape keeps every value and records every operation, so that
/// [`Var::backward`] can walk them in reverse. An *eval* tape runs the same code, drops the
/// operations at once and frees values as [scopes](Tape::scope) end. Between the two is a tape that records while
/// layers act as in evaluation: [`eval_with_gradients`](Tape::eval_with_gradients).
///
/// One tape serves a whole training: [`reset`](Tape::reset) empties it after each step and keeps
/// its memory, so that the next step takes none from the system.
///
/// A tape may move to another thread (so a whole step can run inside a thread pool), but is never
/// shared by two.
pub struct Tape<F: Real = f32> {
    pub(crate) nodes: RefCell<Vec<Node<F>>>,
    /// How each node was computed, if a gradient can flow through that.
    pub(crate) ops: RefCell<Vec<Option<Box<dyn Op<F>>>>>,
    /// Inputs of all nodes, one after the other.
    pub(crate) edges: RefCell<Vec<u32>>,
    /// Gradient slots, kept for the next backward pass: the vector itself is several pages.
    pub(crate) slots: RefCell<Vec<Option<Tensor<F>>>>,
    /// A spent vector of a [`Gradients`], for the same reason.
    pub(crate) spare: Spare<F>,
    params: RefCell<HashMap<ParamId, u32>>,
    pub(crate) pool: Pool,
    mode: Mode,
    seed: Cell<u64>,
    draws: Cell<u64>,
    pub(crate) path: RefCell<String>,
    updates: RefCell<Vec<BufferUpdate<F>>>,
    /// Numbers this step among those of all tapes.
    pub(crate) epoch: Cell<u64>,
    /// Emptied tapes that wait to be nested again.
    pub(crate) nests: Arc<Mutex<Vec<Self>>>,
    /// Whether it is nested: its resets are not steps, by which the age of pooled memory is told.
    nested: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mode {
    Train,
    /// Records as in training, and layers act as in evaluation.
    Recorded,
    Eval,
}

impl<F: Real> fmt::Debug for Tape<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Tape")
            .field("mode", &self.mode)
            .field("nodes", &self.len())
            .field("pool", &self.pool)
            .finish_non_exhaustive()
    }
}

/// A number that no step of any tape had before. It only tells them apart; nothing is computed from it.
fn next_epoch() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    NEXT.fetch_add(1, Ordering::Relaxed)
}

impl<F: Real> Tape<F> {
    fn new(mode: Mode, seed: u64) -> Self {
        Self {
            nodes: RefCell::default(),
            ops: RefCell::default(),
            edges: RefCell::default(),
            slots: RefCell::default(),
            spare: Spare::default(),
            params: RefCell::default(),
            pool: Pool::new(),
            mode,
            seed: Cell::new(seed),
            draws: Cell::new(0),
            path: RefCell::default(),
            updates: RefCell::default(),
            epoch: Cell::new(next_epoch()),
            nests: Arc::default(),
            nested: false,
        }
    }

    /// A new tape of the same mode and pool.
    pub(crate) fn nest(&self) -> Self {
        Self { pool: self.pool.clone(), nested: true, ..Self::new(self.mode, 0) }
    }

    /// A tape that records. `seed` decides all randomness on it (dropout) up to the next [`reset`](Self::reset), after which
    /// the same is drawn again: a loop that trains [reseeds](Self::reseed) it in each step.
    pub fn train(seed: u64) -> Self {
        Self::new(Mode::Train, seed)
    }

    /// A tape that only computes.
    pub fn eval() -> Self {
        Self::new(Mode::Eval, 0)
    }

    /// A tape that records, on which layers act as they do in evaluation: dropout is the identity, batch norm uses its
    /// running statistics and does not change them, and gradients go to inputs and parameters all the same.
    ///
    /// PyTorch's `model.eval()` outside of `no_grad`: for fine-tuning with fixed statistics, for optimising an input
    /// under a finished network, and for gradients that say what a network looks at.
    pub fn eval_with_gradients() -> Self {
        Self::new(Mode::Recorded, 0)
    }

    /// Whether layers act as in training: those that act otherwise in evaluation (dropout, batch norm) ask this.
    pub fn is_training(&self) -> bool {
        self.mode == Mode::Train
    }

    /// Whether it records operations, so that [`Var::backward`] can walk them.
    pub fn is_recording(&self) -> bool {
        self.mode != Mode::Eval
    }

    /// The number of values put on it since the last reset.
    pub fn len(&self) -> usize {
        self.nodes.borrow().len()
    }

    /// Whether nothing was put on it since the last reset.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A value without gradient.
    ///
    /// # Shapes
    /// Any; the variable has that of `x`.
    #[track_caller]
    pub fn constant(&self, x: impl Into<Tensor<F>>) -> Var<'_, F> {
        self.push("constant", x.into(), &[], None, false, None)
    }

    /// A differentiable input; its gradient is [`Gradients::wrt`](crate::Gradients::wrt).
    ///
    /// # Shapes
    /// Any; the variable has that of `x`.
    #[track_caller]
    pub fn leaf(&self, x: impl Into<Tensor<F>>) -> Var<'_, F> {
        self.push("leaf", x.into(), &[], None, self.is_recording(), None)
    }

    /// A parameter, by reference count; the same parameter twice is the same node.
    ///
    /// # Shapes
    /// That of the parameter.
    #[track_caller]
    #[inline(never)]
    pub fn param(&self, param: &Param<F>) -> Var<'_, F> {
        if let Some(&id) = self.params.borrow().get(&param.id()) {
            // A clone that was changed has the same identity too, and would get the values of the first.
            assert_eq!(
                self.nodes.borrow()[id as usize].value().as_ptr(),
                param.value.as_ptr(),
                "a parameter changed while a tape held it: reset the tape before an optimiser step"
            );
            return Var { tape: self, id };
        }
        let wanted = param.trainable && self.is_recording();
        let id = Some(param.id());
        let var = self.push("param", param.value.clone(), &[], None, wanted, id);
        self.params.borrow_mut().insert(param.id(), var.id);
        var
    }

    /// Puts the result of an operation on the tape: the only way to record an op, for all crates.
    ///
    /// The operation is kept only if a gradient can flow through it.
    ///
    /// # Shapes
    /// `inputs` of any shapes; the variable has that of `value`. The rule gives each input a gradient of its shape.
    ///
    /// # Panics
    /// If an input is of another tape.
    #[track_caller]
    pub fn record(
        &self,
        inputs: &[Var<'_, F>],
        value: impl Into<Tensor<F>>,
        op: impl Op<F>,
    ) -> Var<'_, F> {
        let name = op.name();
        self.assert_own(name, inputs);
        let wanted = self.wants_grad(inputs);
        let op: Option<Box<dyn Op<F>>> = if wanted { Some(Box::new(op)) } else { None };
        self.push(name, value.into(), inputs, op, wanted, None)
    }

    /// [`record`](Self::record) with a closure as the rule, which keeps what it captures. An [`Op`] of its own
    /// is for rules of several functions.
    ///
    /// # Shapes
    /// As [`record`](Self::record).
    ///
    /// # Panics
    /// If an input is of another tape.
    #[track_caller]
    pub fn record_fn(
        &self,
        name: &'static str,
        inputs: &[Var<'_, F>],
        value: impl Into<Tensor<F>>,
        pullback: impl Fn(&mut Backward<'_, F>) + Send + 'static,
    ) -> Var<'_, F> {
        self.record(inputs, value, FnOp { name, pullback })
    }

    /// Whether any of the inputs needs a gradient: if not, an operation need not save anything.
    ///
    /// # Shapes
    /// Any.
    ///
    /// # Panics
    /// If one is of another tape.
    #[track_caller]
    #[inline(never)]
    pub fn wants_grad(&self, inputs: &[Var<'_, F>]) -> bool {
        self.assert_own("wants_grad", inputs);
        let nodes = self.nodes.borrow();
        inputs.iter().any(|input| nodes[input.id as usize].needs_grad)
    }

    #[track_caller]
    fn assert_own(&self, name: &str, inputs: &[Var<'_, F>]) {
        let own = inputs.iter().all(|input| std::ptr::eq(input.tape, self));
        assert!(own, "`{name}` was given values of another tape");
    }

    #[track_caller]
    #[inline(never)]
    fn push(
        &self,
        name: &'static str,
        value: Tensor<F>,
        inputs: &[Var<'_, F>],
        op: Option<Box<dyn Op<F>>>,
        needs_grad: bool,
        param: Option<ParamId>,
    ) -> Var<'_, F> {
        let mut nodes = self.nodes.borrow_mut();
        let mut edges = self.edges.borrow_mut();
        let first_edge = edges.len() as u32;
        if op.is_some() {
            edges.extend(inputs.iter().map(|input| input.id));
        }
        let edge_count = edges.len() as u32 - first_edge;
        let id = nodes.len() as u32;
        let value = Some(value);
        nodes.push(Node { value, first_edge, edge_count, needs_grad, param, name });
        self.ops.borrow_mut().push(op);
        Var { tape: self, id }
    }

    /// Empties the tape and keeps its memory.
    ///
    /// Values that nobody else holds go to the pool; parameters are unique again, so that an
    /// optimiser writes them in place. Randomness starts again from the seed, and statistics
    /// updates that were not [taken](Self::take_updates) are dropped.
    #[inline(never)]
    pub fn reset(&mut self) {
        // Operations go first: they may hold clones of values.
        self.ops.get_mut().clear();
        let mut nodes = std::mem::take(self.nodes.get_mut());
        for node in nodes.drain(..) {
            if let Some(value) = node.value {
                self.recycle(value);
            }
        }
        *self.nodes.get_mut() = nodes;
        self.edges.get_mut().clear();
        self.params.get_mut().clear();
        self.updates.get_mut().clear();
        self.draws.set(0);
        self.epoch.set(next_epoch());
        if !self.nested {
            self.pool.tick();
        }
    }

    /// Sets the seed from which the randomness of the next step follows.
    ///
    /// Derive it from the run's seed and the step number, so that a resumed run draws the same.
    pub fn reseed(&self, seed: u64) {
        self.seed.set(seed);
        self.draws.set(0);
    }

    /// A generator that is a function of the tape's seed and of how many were asked for before.
    pub fn rng(&self) -> ChaCha8Rng {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed.get());
        rng.set_stream(self.draws.get());
        self.draws.set(self.draws.get() + 1);
        rng
    }

    /// The pool that all buffers of this tape come from.
    pub fn pool(&self) -> &Pool {
        &self.pool
    }

    /// `len` elements, stale but initialised (NaN in debug builds), returned to the pool on drop.
    pub fn buffer(&self, len: usize) -> PoolVec<F> {
        self.pool.vec(len)
    }

    /// `len` indices, stale but initialised, returned to the pool on drop.
    pub fn indices(&self, len: usize) -> PoolVec<u32> {
        self.pool.vec(len)
    }

    /// A tensor from the pool, stale but initialised: to be written whole and recorded.
    ///
    /// # Shapes
    /// `shape`.
    pub fn array(&self, shape: &[usize]) -> Tensor<F> {
        self.pool.array(shape)
    }

    /// Gives the memory of a value to the pool, if nobody else holds it.
    ///
    /// # Shapes
    /// Any.
    pub fn recycle(&self, value: impl Into<Tensor<F>>) {
        self.pool.recycle(value.into());
    }

    /// Notes a change of a buffer (a running statistic), to be applied by the owner of the module.
    ///
    /// Ignored where layers do not act as in training.
    pub fn push_update(&self, update: BufferUpdate<F>) {
        if self.is_training() {
            self.updates.borrow_mut().push(update);
        }
    }

    /// No gradients yet, in this tape's memory: for those that other processes computed
    /// ([`Gradients::insert`]).
    #[inline(never)]
    pub fn gradients(&self) -> Gradients<F> {
        Gradients::empty(&self.spare, &self.pool, self.epoch.get())
    }

    /// All buffer changes noted since the last reset, in order.
    #[inline(never)]
    pub fn take_updates(&self) -> Updates<F> {
        Updates(self.updates.take())
    }

    pub(crate) fn node(&self, id: u32) -> Ref<'_, Node<F>> {
        Ref::map(self.nodes.borrow(), |nodes| &nodes[id as usize])
    }

    #[track_caller]
    pub(crate) fn value_of(&self, id: u32) -> Tensor<F> {
        self.nodes.borrow()[id as usize].value().clone()
    }

    #[track_caller]
    pub(crate) fn with_value<R>(&self, id: u32, f: impl FnOnce(&Tensor<F>) -> R) -> R {
        f(self.nodes.borrow()[id as usize].value())
    }

    pub(crate) fn needs_grad(&self, id: u32) -> bool {
        self.node(id).needs_grad
    }

    pub(crate) fn describe(&self, id: u32) -> String {
        let node = self.node(id);
        match &node.value {
            Some(value) => format!("{} {:?}", node.name, value.shape()),
            None => format!("{} (freed)", node.name),
        }
    }
}

#[cfg(test)]
mod tests {
    use ndarray::{arr1, arr2};

    use super::*;

    #[test]
    fn a_parameter_enters_by_reference_and_once() {
        let mut tape = Tape::<f32>::train(0);
        let mut param = Param::new(arr1(&[1.0, 2.0]));
        let address = param.value.as_ptr();
        let (a, b) = (tape.param(&param), tape.param(&param));
        assert_eq!(a.id, b.id);
        assert_eq!(a.value().as_ptr(), address);
        tape.reset();
        param.as_slice_mut()[0] = 5.0;
        assert_eq!(param.value.as_ptr(), address, "written in place after the reset");
    }

    #[test]
    fn numbers_and_vectors_are_values() {
        let tape = Tape::<f32>::eval();
        let y = tape.constant(vec![1.0, 2.0]) * tape.constant(3.0);
        assert_eq!((y.shape(), y.value().as_slice()), (vec![2], &[3.0, 6.0][..]));
        assert_eq!(Tape::<f64>::eval().constant(3.0).item(), 3.0);
    }

    #[test]
    fn values_are_made_row_major() {
        let tape = Tape::<f32>::eval();
        let x = arr2(&[[1.0, 2.0], [3.0, 4.0]]).reversed_axes();
        let x = tape.constant(x).value();
        assert_eq!(x.as_slice(), [1.0, 3.0, 2.0, 4.0]);
    }

    #[test]
    fn randomness_follows_from_the_seed_and_the_count() {
        use rand::RngExt;
        let mut tape = Tape::<f32>::train(7);
        let first: [u64; 2] = [tape.rng().random(), tape.rng().random()];
        assert_ne!(first[0], first[1]);
        tape.reset();
        let again: [u64; 2] = [tape.rng().random(), tape.rng().random()];
        assert_eq!(first, again);
        tape.reseed(8);
        assert_ne!(first[0], tape.rng().random::<u64>());
    }

    /// Of a node that this tape does not have, too.
    #[test]
    #[should_panic(expected = "`add` was given values of another tape")]
    fn values_of_two_tapes_do_not_meet() {
        let (a, b) = (Tape::<f32>::train(0), Tape::<f32>::train(0));
        let x = a.leaf(arr1(&[1.0]));
        let y = b.leaf(arr1(&[1.0])).square().square();
        let _ = x + y;
    }

    #[test]
    fn what_a_later_rule_holds_goes_to_the_pool() {
        let mut tape = Tape::<f32>::train(0);
        let x = tape.leaf(tape.array(&[1000]));
        let held = x.value();
        let rule = move |cx: &mut Backward<'_, f32>| cx.give(0, held.clone());
        let _ = tape.record_fn("hold", &[x], tape.array(&[24]), rule);
        tape.reset();
        assert_eq!(tape.pool().bytes(), 4096);
    }

    /// Layers see evaluation, gradients flow, and scopes keep what the walk back needs.
    #[test]
    fn evaluation_can_be_recorded() {
        let tape = Tape::<f32>::eval_with_gradients();
        assert!(tape.is_recording() && !tape.is_training());
        let x = tape.leaf(arr1(&[1.0, 2.0]));
        let y = tape.scope("block", || x.square().dropout(0.5).square().sum());
        assert_eq!(y.item(), 17.0, "nothing is dropped");
        let gradients = y.backward();
        assert_eq!(gradients.wrt(x).map(|g| g.as_slice().to_vec()), Some(vec![4.0, 32.0]));
        assert!(tape.nested().is_recording() && !tape.nested().is_training());
        let frozen = Tape::<f32>::eval();
        assert!(!frozen.is_recording() && !frozen.leaf(arr1(&[1.0])).needs_grad());
    }

    #[test]
    fn a_tape_can_move_to_another_thread() {
        fn moves<T: Send>() {}
        moves::<Tape<f32>>();
        moves::<crate::Gradients<f32>>();
    }
}
