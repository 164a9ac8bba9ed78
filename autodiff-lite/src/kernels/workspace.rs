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

/// Calls `f` with `len` numbers of unspecified value.
pub(crate) fn with<F: Lane, R>(len: usize, f: impl FnOnce(&mut [F]) -> R) -> R {
    let doubles = elements(&[len, size_of::<F>()]).div_ceil(size_of::<f64>());
    let mut memory = SPARE.with_borrow_mut(Vec::pop).unwrap_or_default();
    if memory.len() < doubles {
        memory.resize(doubles, 0.0);
    }
    let result = f(&mut bytemuck::cast_slice_mut::<f64, F>(&mut memory[..doubles])[..len]);
    SPARE.with_borrow_mut(|spare| spare.push(memory));
    result
}
