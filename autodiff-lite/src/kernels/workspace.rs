//! Small working memory of a block of a kernel, kept by each thread for the next one.
//!
//! A fresh page costs about 2 µs here, more than many blocks. What is large or lives as long as a
//! whole kernel call is handed in by the caller instead (a tape has a pool).

use std::cell::RefCell;
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut, Range};

use crate::kernels::extent::elements;
use crate::kernels::lane::Lane;

thread_local! {
    static SPARE: RefCell<Vec<Vec<f64>>> = const { RefCell::new(Vec::new()) };
}

/// Doubles of a cache line.
const LINE: usize = 8;

/// Calls `f` with `len` numbers of unspecified value, the first at the beginning of a cache line.
pub(crate) fn with<F: Lane, R>(len: usize, f: impl FnOnce(&mut [F]) -> R) -> R {
    f(&mut lend(len))
}

/// `len` numbers of unspecified value, the first at the beginning of a cache line.
pub(crate) fn lend<F: Lane>(len: usize) -> Lent<F> {
    let doubles = elements(&[len, size_of::<F>()]).div_ceil(size_of::<f64>());
    let memory = SPARE.with_borrow_mut(|spare| take(spare, doubles + LINE));
    let start = memory.as_ptr().align_offset(LINE * size_of::<f64>()).min(LINE);
    Lent { memory, numbers: start..start + doubles, len, of: PhantomData }
}

/// Memory that the thread which drops it keeps.
pub(crate) struct Lent<F> {
    memory: Vec<f64>,
    numbers: Range<usize>,
    len: usize,
    of: PhantomData<F>,
}

impl<F: Lane> Deref for Lent<F> {
    type Target = [F];

    fn deref(&self) -> &[F] {
        &bytemuck::cast_slice(&self.memory[self.numbers.clone()])[..self.len]
    }
}

impl<F: Lane> DerefMut for Lent<F> {
    fn deref_mut(&mut self) -> &mut [F] {
        &mut bytemuck::cast_slice_mut(&mut self.memory[self.numbers.clone()])[..self.len]
    }
}

impl<F> Drop for Lent<F> {
    fn drop(&mut self) {
        let memory = std::mem::take(&mut self.memory);
        SPARE.with_borrow_mut(|spare| spare.push(memory));
    }
}

/// The shortest that is long enough, or else the longest, grown: so that what is large stays the memory of what is large.
fn take(spare: &mut Vec<Vec<f64>>, doubles: usize) -> Vec<f64> {
    let fits = |memory: &Vec<f64>| (memory.len() < doubles, memory.len().abs_diff(doubles));
    let best = (0..spare.len()).min_by_key(|&i| fits(&spare[i]));
    let mut memory = best.map(|i| spare.swap_remove(i)).unwrap_or_default();
    if memory.len() < doubles {
        memory.resize(doubles, 0.0);
    }
    memory
}
