//! Work in fixed blocks, so that no result depends on the number of threads.

use super::threads::on_threads;

/// A slice that fixed blocks write disjoint parts of.
///
/// That parts lie within it is checked, once for each; that they are disjoint is the caller's
/// promise.
#[derive(Debug)]
pub(crate) struct Shared<F> {
    first: *mut F,
    len: usize,
}

impl<F> Clone for Shared<F> {
    fn clone(&self) -> Self {
        *self
    }
}

// Whatever the elements are.
impl<F> Copy for Shared<F> {}

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
pub(crate) fn for_each_block(count: usize, parallel: bool, f: impl Fn(usize) + Sync) {
    if parallel && count > 1 {
        on_threads(count, &f);
    } else {
        (0..count).for_each(f);
    }
}

/// Calls `f(i, part)` for each part of `len` elements of `out`.
pub(crate) fn for_each_part<F: Send>(
    out: &mut [F],
    len: usize,
    parallel: bool,
    f: impl Fn(usize, &mut [F]) + Sync,
) {
    if len == 0 {
        return;
    }
    let (count, all) = (out.len().div_ceil(len), out.len());
    let out = Shared::new(out);
    for_each_block(count, parallel, |i| {
        let start = i * len;
        // SAFETY: no other block has these elements.
        f(i, unsafe { out.slice(start, len.min(all - start)) });
    });
}

/// The part of `x` that belongs to the `k`-th part of `len` elements of another slice, `part`.
#[inline(always)]
pub(crate) fn beside<'a, F, G>(x: &'a [F], k: usize, len: usize, part: &[G]) -> &'a [F] {
    &x[k * len..][..part.len()]
}
