//! Small working memory of a block of a kernel, kept by each thread for the next one.
//!
//! A fresh page costs about 2 µs here, more than many blocks. What is large or lives as long as a
//! whole kernel call is handed in by the caller instead (a tape has a pool).

use std::cell::RefCell;

use crate::kernels::extent::elements;
use crate::kernels::lane::Lane;

thread_local! {
    static SPARE: RefCell<Vec<Vec<f64>>> = const { RefCell::new(Vec::new()) };
}

/// Doubles of a cache line.
const LINE: usize = 8;

/// Calls `f` with `len` numbers of unspecified value, the first at the beginning of a cache line.
pub(crate) fn with<F: Lane, R>(len: usize, f: impl FnOnce(&mut [F]) -> R) -> R {
    let doubles = elements(&[len, size_of::<F>()]).div_ceil(size_of::<f64>());
    let mut memory = SPARE.with_borrow_mut(|spare| take(spare, doubles + LINE));
    let start = memory.as_ptr().align_offset(LINE * size_of::<f64>()).min(LINE);
    let numbers = &mut memory[start..start + doubles];
    let result = f(&mut bytemuck::cast_slice_mut::<f64, F>(numbers)[..len]);
    SPARE.with_borrow_mut(|spare| spare.push(memory));
    result
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
