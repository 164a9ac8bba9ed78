//! Work in fixed blocks, so that no result depends on the number of threads.

use rayon::prelude::*;

/// A slice that fixed blocks write disjoint parts of.
///
/// That parts lie within it is checked, once for each; that they are disjoint is the caller's
/// promise.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shared<F> {
    first: *mut F,
    len: usize,
}

// SAFETY: the blocks that share it write disjoint elements; each use says which.
unsafe impl<F: Send> Send for Shared<F> {}
// SAFETY: as above.
unsafe impl<F: Send> Sync for Shared<F> {}

impl<F> Shared<F> {
    pub(crate) fn new(slice: &mut [F]) -> Self {
        Self { first: slice.as_mut_ptr(), len: slice.len() }
    }

    /// The address of element `start`, from which `len` elements lie within the slice.
    ///
    /// # Panics
    /// If they do not.
    #[inline(always)]
    pub(crate) fn at(self, start: usize, len: usize) -> *mut F {
        assert!(start <= self.len && len <= self.len - start, "a block beyond the end");
        self.first.wrapping_add(start)
    }

    /// Elements `start .. start + len`.
    ///
    /// # Safety
    /// No other block touches them while this lives.
    ///
    /// # Panics
    /// If they do not lie within the slice.
    #[inline(always)]
    pub(crate) unsafe fn slice<'a>(self, start: usize, len: usize) -> &'a mut [F] {
        // SAFETY: they lie within the slice; that they are nobody else's is the caller's promise.
        unsafe { std::slice::from_raw_parts_mut(self.at(start, len), len) }
    }
}

/// Floating-point operations under which a second thread does not pay.
pub(crate) const SERIAL_BELOW: usize = 2_000_000;

/// Elements moved under which a second thread does not pay.
pub(crate) const SERIAL_ELEMENTS: usize = 128 * 1024;

/// Calls `f` for each of `count` blocks; on several threads if `parallel`. The blocks are the
/// same either way.
#[inline]
pub(crate) fn for_each_block(count: usize, parallel: bool, f: impl Fn(usize) + Sync + Send) {
    if parallel && count > 1 {
        (0..count).into_par_iter().with_max_len(1).for_each(f);
    } else {
        (0..count).for_each(f);
    }
}

/// Calls `f(i, part)` for each part of `len` elements of `out`.
pub(crate) fn for_each_part<F: Send>(
    out: &mut [F],
    len: usize,
    parallel: bool,
    f: impl Fn(usize, &mut [F]) + Sync + Send,
) {
    if len == 0 {
        return;
    }
    if parallel {
        out.par_chunks_mut(len).enumerate().with_max_len(1).for_each(|(i, part)| f(i, part));
    } else {
        out.chunks_mut(len).enumerate().for_each(|(i, part)| f(i, part));
    }
}
