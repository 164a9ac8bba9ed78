//! A counting allocator for tests of memory; see [`testkit`](crate::testkit).

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Sizes below this are not counted: a page.
const LARGE: usize = 4096;

/// The system's allocator, which counts the blocks of 4 KiB and more that are taken.
///
/// ```
/// use autodiff_lite::testkit::CountingAllocator;
///
/// #[global_allocator]
/// static ALLOCATOR: CountingAllocator = CountingAllocator::new();
///
/// fn main() {
///     let before = ALLOCATOR.blocks();
///     drop(std::hint::black_box(vec![0_u8; 5000]));
///     assert!(ALLOCATOR.blocks() > before);
///     assert!(ALLOCATOR.take_peak() >= 5000);
/// }
/// ```
#[derive(Debug, Default)]
pub struct CountingAllocator {
    blocks: AtomicUsize,
    bytes: AtomicUsize,
    held: AtomicUsize,
    peak: AtomicUsize,
}

impl CountingAllocator {
    /// Nothing counted yet.
    pub const fn new() -> Self {
        Self {
            blocks: AtomicUsize::new(0),
            bytes: AtomicUsize::new(0),
            held: AtomicUsize::new(0),
            peak: AtomicUsize::new(0),
        }
    }

    /// Large blocks taken so far, by all threads.
    pub fn blocks(&self) -> usize {
        self.blocks.load(Ordering::Relaxed)
    }

    /// Bytes in them.
    pub fn bytes(&self) -> usize {
        self.bytes.load(Ordering::Relaxed)
    }

    /// The most bytes that were held at once, in blocks of any size, since the last call.
    pub fn take_peak(&self) -> usize {
        self.peak.swap(self.held.load(Ordering::Relaxed), Ordering::Relaxed)
    }

    fn count(&self, size: usize) {
        if size >= LARGE {
            self.blocks.fetch_add(1, Ordering::Relaxed);
            self.bytes.fetch_add(size, Ordering::Relaxed);
        }
        let held = self.held.fetch_add(size, Ordering::Relaxed) + size;
        self.peak.fetch_max(held, Ordering::Relaxed);
    }

    fn forget(&self, size: usize) {
        self.held.fetch_sub(size, Ordering::Relaxed);
    }
}

// SAFETY: every call is handed to the system's allocator as it is, and counting takes no memory.
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        self.count(layout.size());
        // SAFETY: the caller keeps the contract.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        self.count(layout.size());
        // SAFETY: the caller keeps the contract.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        self.count(size);
        self.forget(layout.size());
        // SAFETY: the caller keeps the contract.
        unsafe { System.realloc(block, layout, size) }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        self.forget(layout.size());
        // SAFETY: the caller keeps the contract.
        unsafe { System.dealloc(block, layout) }
    }
}
