//! A step of `fit` takes no fresh block of 4 KiB or more once it runs.
#![allow(unsafe_code, reason = "a counting allocator")]
#![allow(clippy::unwrap_used, reason = "tests")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

use datasets::shapes::AlarmClock;
use recon::fit::{FitConfig, Stepper};
use recon::synthetic::{Orbit, RenderOptions, render_views};

struct Counting;

static LARGE: AtomicUsize = AtomicUsize::new(0);

fn count(size: usize) {
    if size >= 4096 {
        LARGE.fetch_add(size, Ordering::Relaxed);
    }
}

// SAFETY: every call is handed to the system's allocator as it is.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        // SAFETY: the caller keeps the contract.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        // SAFETY: the caller keeps the contract.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size);
        // SAFETY: the caller keeps the contract.
        unsafe { System.realloc(block, layout, size) }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        // SAFETY: the caller keeps the contract.
        unsafe { System.dealloc(block, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn steps_of_a_fit_take_no_large_fresh_block() {
    let cameras = Orbit { count: 8, width: 96, height: 96, ..Orbit::default() }.cameras();
    let mesh = AlarmClock::default().build();
    let views = render_views(&mesh, &cameras, &RenderOptions::default(), &|_, _| ()).unwrap();
    let config = FitConfig { start_level: 4, ..FitConfig::default() };
    let mut stepper = Stepper::new(&views, &config).unwrap();
    // Buffers find their size while the sphere shrinks onto the object.
    for _ in 0..60 {
        stepper.step().unwrap();
    }
    let before = LARGE.load(Ordering::Relaxed);
    assert!(before > 0, "the allocator counts");
    for _ in 0..60 {
        stepper.step().unwrap();
    }
    let fresh = LARGE.load(Ordering::Relaxed) - before;
    // A list of crossings may still grow now and then, when the outline gets longer than ever.
    assert!(fresh <= 60 * 1024, "{fresh} bytes in 60 steps");
}
