//! Recycled memory.
//!
//! A page that the operating system hands out fresh costs more than anything that is computed on
//! it, so a tape never gives its buffers back: they wait on free lists, by exact length, until a
//! value, a gradient or a saved index list of that length is wanted again.

use std::collections::BTreeMap;
use std::fmt;
use std::mem;
use std::ops::{Deref, DerefMut};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use ndarray::{ArrayD, IxDyn};

use crate::Tensor;

/// Free lists that saw no request during this many resets are emptied: sizes change when a mesh is
/// subdivided, and the old ones would wait for ever.
const FORGET_AFTER: u64 = 256;

/// How much may wait, in multiples of what was handed out since the last reset. Where lengths differ from step to step, as
/// with meshes that a network sizes itself, every step would else leave its own behind for hundreds of others.
const MOST_WAITING: usize = 3;

/// What the pool keeps: `f32`, `f64` and `u32`.
pub trait Pooled: Copy + Default + Send + 'static + private::Listed {}

impl Pooled for f32 {}
impl Pooled for f64 {}
impl Pooled for u32 {}

mod private {
    use super::{FreeList, FreeLists};

    pub trait Listed: Sized {
        fn free_list(free_lists: &mut FreeLists) -> &mut FreeList<Self>;
        /// What debug builds fill a buffer with before they hand it out.
        const POISON: Self;
    }

    impl Listed for f32 {
        fn free_list(free_lists: &mut FreeLists) -> &mut FreeList<Self> {
            &mut free_lists.singles
        }
        const POISON: Self = Self::NAN;
    }

    impl Listed for f64 {
        fn free_list(free_lists: &mut FreeLists) -> &mut FreeList<Self> {
            &mut free_lists.doubles
        }
        const POISON: Self = Self::NAN;
    }

    impl Listed for u32 {
        fn free_list(free_lists: &mut FreeLists) -> &mut FreeList<Self> {
            &mut free_lists.indices
        }
        const POISON: Self = Self::MAX;
    }
}

/// All buffers of one length.
struct Stack<T> {
    free: Vec<Vec<T>>,
    /// Handed out and not yet returned. Only so many are taken back: a buffer that came from
    /// elsewhere (a constant that the caller allocated) would else make the free list grow each step.
    lent: usize,
    last_used: u64,
}

#[doc(hidden)]
#[allow(missing_debug_implementations, reason = "reachable only through a private trait")]
pub struct FreeList<T>(BTreeMap<usize, Stack<T>>);

impl<T> Default for FreeList<T> {
    fn default() -> Self {
        Self(BTreeMap::new())
    }
}

#[doc(hidden)]
#[derive(Default)]
#[allow(missing_debug_implementations, reason = "reachable only through a private trait")]
pub struct FreeLists {
    singles: FreeList<f32>,
    doubles: FreeList<f64>,
    indices: FreeList<u32>,
    clock: u64,
    /// Bytes handed out since the last reset.
    handed_out: usize,
}

/// A shared store of buffers. Cloning it gives another handle to the same store.
#[derive(Clone, Default)]
pub struct Pool(Arc<Mutex<FreeLists>>);

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

    fn lock(&self) -> MutexGuard<'_, FreeLists> {
        // A panic elsewhere leaves the free lists whole: they only move complete vectors.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A vector of `len` elements whose content is whatever it last held (zeros when it is new).
    ///
    /// Debug builds fill it with NaN (`u32::MAX` for indices), so that a kernel that forgets to
    /// write some of its output is seen.
    pub fn take<T: Pooled>(&self, len: usize) -> Vec<T> {
        if len == 0 {
            return Vec::new();
        }
        let recycled = {
            let mut free_lists = self.lock();
            let clock = free_lists.clock;
            free_lists.handed_out += len * mem::size_of::<T>();
            let stack = T::free_list(&mut free_lists).0.entry(len).or_insert_with(|| Stack {
                free: Vec::new(),
                lent: 0,
                last_used: clock,
            });
            stack.lent += 1;
            stack.last_used = clock;
            stack.free.pop()
        };
        let mut buffer = recycled.unwrap_or_else(|| vec![T::default(); len]);
        if cfg!(any(debug_assertions, feature = "testkit")) {
            buffer.fill(T::POISON);
        }
        buffer
    }

    /// Puts a vector on its free list.
    pub fn give<T: Pooled>(&self, buffer: Vec<T>) {
        if buffer.is_empty() {
            return;
        }
        let mut free_lists = self.lock();
        if let Some(stack) = T::free_list(&mut free_lists).0.get_mut(&buffer.len())
            && stack.lent > 0
        {
            stack.lent -= 1;
            stack.free.push(buffer);
        }
    }

    /// Puts the memory of a tensor on its free list, if nobody else holds it.
    ///
    /// # Shapes
    /// Any.
    pub fn recycle<T: Pooled>(&self, tensor: Tensor<T>) {
        if let Some(buffer) = tensor.try_into_vec() {
            self.give(buffer);
        }
    }

    /// A [`PoolVec`] of `len` elements, stale but initialised.
    pub fn vec<T: Pooled>(&self, len: usize) -> PoolVec<T> {
        PoolVec { buffer: self.take(len), pool: self.clone() }
    }

    /// A tensor of this shape, stale but initialised.
    ///
    /// # Shapes
    /// `shape`.
    pub fn array<T: Pooled>(&self, shape: &[usize]) -> Tensor<T> {
        let buffer = self.take(shape.iter().product());
        let array = ArrayD::from_shape_vec(IxDyn(shape), buffer);
        array.expect("the buffer has the shape's length").into()
    }

    /// A tensor of this shape, all of whose elements are `value`.
    ///
    /// # Shapes
    /// `shape`.
    pub fn filled<T: Pooled>(&self, shape: &[usize], value: T) -> Tensor<T> {
        let mut tensor = self.array(shape);
        tensor.as_slice_mut().fill(value);
        tensor
    }

    /// A tensor of one's own with the elements of another.
    ///
    /// # Shapes
    /// That of `tensor`.
    pub fn copy<T: Pooled>(&self, tensor: &Tensor<T>) -> Tensor<T> {
        let mut own = self.array(tensor.shape());
        own.as_slice_mut().copy_from_slice(tensor.as_slice());
        own
    }

    /// The tensor itself if nobody else holds it, else a copy.
    pub(crate) fn own<T: Pooled>(&self, tensor: Tensor<T>) -> Tensor<T> {
        if tensor.is_unique() { tensor } else { self.copy(&tensor) }
    }

    /// Bytes that wait on the free lists.
    pub fn bytes(&self) -> usize {
        self.lock().waiting()
    }

    /// Frees everything that waits on the free lists.
    pub fn clear(&self) {
        let mut free_lists = self.lock();
        free_lists.forget(|_| true);
    }

    /// Notes that a step has ended, and now and then frees lengths that went out of use.
    pub(crate) fn tick(&self) {
        let mut free_lists = self.lock();
        let handed_out = mem::take(&mut free_lists.handed_out);
        if handed_out == 0 {
            return;
        }
        let clock = free_lists.clock + 1;
        free_lists.clock = clock;
        if free_lists.waiting() > MOST_WAITING * handed_out {
            free_lists.forget(|last_used| last_used + 1 < clock);
        } else if clock.is_multiple_of(FORGET_AFTER) {
            free_lists.forget(|last_used| last_used + FORGET_AFTER < clock);
        }
    }
}

impl FreeLists {
    fn waiting(&self) -> usize {
        fn of<T>(free_list: &FreeList<T>) -> usize {
            free_list
                .0
                .iter()
                .map(|(len, stack)| len * stack.free.len() * mem::size_of::<T>())
                .sum()
        }
        of(&self.singles) + of(&self.doubles) + of(&self.indices)
    }

    fn forget(&mut self, stale: impl Fn(u64) -> bool + Copy) {
        self.singles.forget(stale);
        self.doubles.forget(stale);
        self.indices.forget(stale);
    }
}

impl<T> FreeList<T> {
    fn forget(&mut self, stale: impl Fn(u64) -> bool) {
        for stack in self.0.values_mut().filter(|stack| stale(stack.last_used)) {
            stack.free = Vec::new();
        }
        self.0.retain(|_, stack| stack.lent > 0 || !stack.free.is_empty());
    }
}

/// A slice from a [`Pool`]; dropping it puts it back.
pub struct PoolVec<T: Pooled> {
    buffer: Vec<T>,
    pool: Pool,
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
    fn lengths_that_differ_each_time_do_not_pile_up() {
        let pool = Pool::new();
        for step in 0..FORGET_AFTER as usize {
            let lengths = [701, 1009].map(|prime| 1000 + step * prime % 1000);
            drop(lengths.map(|len| pool.vec::<f32>(len)));
            pool.tick();
        }
        // Four times the two largest; without a limit it is over a megabyte.
        assert!(pool.bytes() <= 64_000, "{}", pool.bytes());
    }

    #[test]
    #[cfg(any(debug_assertions, feature = "testkit"))]
    fn debug_builds_poison() {
        let pool = Pool::new();
        assert!(pool.vec::<f64>(3).iter().all(|x| x.is_nan()));
        assert!(pool.vec::<u32>(3).iter().all(|&x| x == u32::MAX));
    }
}
