//! A step of `fit` takes no fresh block of 4 KiB or more once it runs.
#![allow(clippy::unwrap_used, reason = "tests")]

use autodiff_lite::testkit::CountingAllocator;
use recon::fit::{FitConfig, Stepper};
use synth::shapes::AlarmClock;
use synth::{Orbit, RenderOptions, render_views};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator::new();

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
    let before = ALLOCATOR.bytes();
    assert!(before > 0, "the allocator counts");
    for _ in 0..60 {
        stepper.step().unwrap();
    }
    let fresh = ALLOCATOR.bytes() - before;
    // A list of crossings may still grow now and then, when the outline gets longer than ever.
    assert!(fresh <= 60 * 1024, "{fresh} bytes in 60 steps");
}
