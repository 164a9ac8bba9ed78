//! Recycled memory.
//!
//! A page that the operating system hands out fresh costs more than anything that is computed on
//! it, so a tape never gives its buffers back: they wait on shelves, by capacity, until a value, a
//! gradient or a saved index list that fits is wanted. Where lengths differ from step to step, as
//! with meshes that a network sizes itself, the shelves hold what the largest step needs.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::fmt;
use std::mem;
use std::ops::{Deref, DerefMut};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use ndarray::{ArrayBase, ArrayD, Dimension, IxDyn, OwnedRepr};

/// Capacities that served no request during this many resets are freed: sizes change when a mesh is
/// subdivided, and the old ones would wait for ever.
const FORGET_AFTER: u64 = 256;

/// The largest capacity that serves a request, in multiples of its length.
const SLACK: usize = 2;

/// What the pool keeps: `f32`, `f64` and `u32`.
pub trait Pooled: Copy + Default + Send + 'static + private::Shelved {}

impl Pooled for f32 {}
impl Pooled for f64 {}
impl Pooled for u32 {}

mod private {
    use super::{Shelf, Shelves};

    pub trait Shelved: Sized {
        fn shelf(shelves: &mut Shelves) -> &mut Shelf<Self>;
        /// What debug builds fill a buffer with before they hand it out.
        const POISON: Self;
    }

    impl Shelved for f32 {
        fn shelf(shelves: &mut Shelves) -> &mut Shelf<Self> {
            &mut shelves.singles
        }
        const POISON: Self = Self::NAN;
    }

    impl Shelved for f64 {
        fn shelf(shelves: &mut Shelves) -> &mut Shelf<Self> {
            &mut shelves.doubles
        }
        const POISON: Self = Self::NAN;
    }

    impl Shelved for u32 {
        fn shelf(shelves: &mut Shelves) -> &mut Shelf<Self> {
            &mut shelves.indices
        }
        const POISON: Self = Self::MAX;
    }
}

/// The buffers of one capacity that wait.
struct Stack<T> {
    free: Vec<Vec<T>>,
    last_used: u64,
}

#[doc(hidden)]
#[allow(missing_debug_implementations, reason = "reachable only through a private trait")]
pub struct Shelf<T> {
    /// By capacity; none is empty.
    stacks: BTreeMap<usize, Stack<T>>,
    /// How many of each capacity were handed out and are not back. Only so many are taken back: a
    /// buffer that came from elsewhere (a constant that the caller allocated) would else make the
    /// shelf grow each step.
    lent: BTreeMap<usize, usize>,
}

impl<T> Default for Shelf<T> {
    fn default() -> Self {
        Self { stacks: BTreeMap::new(), lent: BTreeMap::new() }
    }
}

#[doc(hidden)]
#[derive(Default)]
#[allow(missing_debug_implementations, reason = "reachable only through a private trait")]
pub struct Shelves {
    singles: Shelf<f32>,
    doubles: Shelf<f64>,
    indices: Shelf<u32>,
    clock: u64,
}

/// A shared store of buffers. Cloning it gives another handle to the same store.
#[derive(Clone, Default)]
pub struct Pool(Arc<Mutex<Shelves>>);

impl fmt::Debug for Pool {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Pool").field("bytes", &self.bytes()).finish()
    }
}

impl Pool {
    /// An empty pool.
    pub fn new() -> Self {
        Self::default()
    }

    fn lock(&self) -> MutexGuard<'_, Shelves> {
        // A panic elsewhere leaves the shelves whole: they only move complete vectors.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A vector of `len` elements whose content is whatever it last held (zeros when it is new), of
    /// at most twice that capacity.
    ///
    /// Debug builds fill it with NaN (`u32::MAX` for indices), so that a kernel that forgets to
    /// write some of its output is seen.
    pub fn take<T: Pooled>(&self, len: usize) -> Vec<T> {
        if len == 0 {
            return Vec::new();
        }
        let recycled = {
            let mut shelves = self.lock();
            let clock = shelves.clock;
            T::shelf(&mut shelves).lend(len, clock)
        };
        let mut buffer = recycled.unwrap_or_else(|| vec![T::default(); len]);
        buffer.resize(len, T::default());
        if cfg!(debug_assertions) {
            buffer.fill(T::POISON);
        }
        buffer
    }

    /// Puts a vector on its shelf.
    pub fn give<T: Pooled>(&self, buffer: Vec<T>) {
        if buffer.is_empty() {
            return;
        }
        let mut shelves = self.lock();
        let clock = shelves.clock;
        T::shelf(&mut shelves).take_back(buffer, clock);
    }

    /// Puts the memory of an array on its shelf.
    pub fn give_array<T: Pooled, D: Dimension>(&self, array: ArrayBase<OwnedRepr<T>, D>) {
        self.give(array.into_raw_vec_and_offset().0);
    }

    /// A [`PoolVec`] of `len` elements, stale but initialised.
    pub fn vec<T: Pooled>(&self, len: usize) -> PoolVec<T> {
        PoolVec { buffer: self.take(len), pool: self.clone() }
    }

    /// A row-major array of this shape, stale but initialised.
    pub fn array<T: Pooled>(&self, shape: &[usize]) -> ArrayD<T> {
        let buffer = self.take(shape.iter().product());
        ArrayD::from_shape_vec(IxDyn(shape), buffer).expect("the buffer has the shape's length")
    }

    /// Bytes that wait on the shelves.
    pub fn bytes(&self) -> usize {
        fn of<T>(shelf: &Shelf<T>) -> usize {
            let stacks = shelf.stacks.iter();
            stacks.map(|(capacity, stack)| capacity * stack.free.len() * mem::size_of::<T>()).sum()
        }
        let shelves = self.lock();
        of(&shelves.singles) + of(&shelves.doubles) + of(&shelves.indices)
    }

    /// Frees everything that waits on the shelves.
    pub fn clear(&self) {
        let mut shelves = self.lock();
        shelves.singles.forget(|_| true);
        shelves.doubles.forget(|_| true);
        shelves.indices.forget(|_| true);
    }

    /// Notes that a step has ended, and now and then frees lengths that went out of use.
    pub(crate) fn tick(&self) {
        let mut shelves = self.lock();
        shelves.clock += 1;
        let clock = shelves.clock;
        if clock.is_multiple_of(FORGET_AFTER) {
            let stale = |last_used| last_used + FORGET_AFTER < clock;
            shelves.singles.forget(stale);
            shelves.doubles.forget(stale);
            shelves.indices.forget(stale);
        }
    }
}

impl<T> Shelf<T> {
    /// The smallest waiting buffer that has room for `len` and is not far too large. Where there
    /// is none, a new one takes the place of the largest that is a little too small: shelves
    /// would else gather a buffer of every length that a step has ever asked for.
    fn lend(&mut self, len: usize, clock: u64) -> Option<Vec<T>> {
        let fits = self.stacks.range(len..=len.saturating_mul(SLACK)).next();
        let capacity = fits.map(|(&capacity, _)| capacity);
        *self.lent.entry(capacity.unwrap_or(len)).or_default() += 1;
        if let Some(capacity) = capacity {
            return self.pop(capacity, clock);
        }
        let smaller = self.stacks.range(len.div_ceil(SLACK)..len).next_back();
        if let Some((&capacity, _)) = smaller {
            self.pop(capacity, clock);
        }
        None
    }

    fn pop(&mut self, capacity: usize, clock: u64) -> Option<Vec<T>> {
        let stack = self.stacks.get_mut(&capacity)?;
        stack.last_used = clock;
        let buffer = stack.free.pop();
        if stack.free.is_empty() {
            self.stacks.remove(&capacity);
        }
        buffer
    }

    fn take_back(&mut self, buffer: Vec<T>, clock: u64) {
        let Entry::Occupied(mut lent) = self.lent.entry(buffer.capacity()) else {
            return;
        };
        *lent.get_mut() -= 1;
        if *lent.get() == 0 {
            lent.remove();
        }
        let empty = || Stack { free: Vec::new(), last_used: clock };
        self.stacks.entry(buffer.capacity()).or_insert_with(empty).free.push(buffer);
    }

    fn forget(&mut self, stale: impl Fn(u64) -> bool) {
        self.stacks.retain(|_, stack| !stale(stack.last_used));
    }
}

/// A slice from a [`Pool`]; dropping it puts it back.
pub struct PoolVec<T: Pooled> {
    buffer: Vec<T>,
    pool: Pool,
}

impl<T: Pooled> PoolVec<T> {
    /// The plain vector, taken out of the pool's care. Prefer to let it drop.
    pub fn into_vec(mut self) -> Vec<T> {
        mem::take(&mut self.buffer)
    }
}

impl<T: Pooled> Drop for PoolVec<T> {
    fn drop(&mut self) {
        self.pool.give(mem::take(&mut self.buffer));
    }
}

impl<T: Pooled> Deref for PoolVec<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.buffer
    }
}

impl<T: Pooled> DerefMut for PoolVec<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.buffer
    }
}

impl<T: Pooled + fmt::Debug> fmt::Debug for PoolVec<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.buffer.fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dropped_buffer_is_handed_out_again() {
        let pool = Pool::new();
        let first = pool.vec::<f32>(1000);
        let address = first.as_ptr();
        drop(first);
        assert_eq!(pool.bytes(), 4000);
        let second = pool.vec::<f32>(1000);
        assert_eq!(second.as_ptr(), address);
        assert_eq!(pool.bytes(), 0);
    }

    #[test]
    fn foreign_buffers_do_not_pile_up() {
        let pool = Pool::new();
        drop(pool.vec::<f32>(10));
        for _ in 0..100 {
            pool.give(vec![0.0_f32; 10]);
        }
        assert_eq!(pool.bytes(), 40);
    }

    #[test]
    fn lengths_that_went_out_of_use_are_freed() {
        let pool = Pool::new();
        drop(pool.vec::<u32>(7));
        for _ in 0..3 * FORGET_AFTER {
            drop(pool.vec::<u32>(8));
            pool.tick();
        }
        assert_eq!(pool.bytes(), 32);
    }

    #[test]
    fn lengths_that_differ_each_time_share_memory() {
        let pool = Pool::new();
        for step in 0..3 * FORGET_AFTER as usize {
            let [first, second] = [701, 1009].map(|prime| 1000 + step * prime % 1000);
            let buffers = [pool.vec::<f32>(first), pool.vec(second)];
            assert_eq!(buffers.each_ref().map(|buffer| buffer.len()), [first, second]);
            drop(buffers);
            pool.tick();
        }
        // By exact length it would be megabytes.
        assert!(pool.bytes() <= 16_000, "{}", pool.bytes());
    }

    #[test]
    #[cfg(debug_assertions)]
    fn debug_builds_poison() {
        let pool = Pool::new();
        assert!(pool.vec::<f64>(3).iter().all(|x| x.is_nan()));
        assert!(pool.vec::<u32>(3).iter().all(|&x| x == u32::MAX));
    }
}
