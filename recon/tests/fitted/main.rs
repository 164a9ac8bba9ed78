//! Whole fits of shapes that are known: one test program, so that its tests share the processor's cores.
#![allow(clippy::unwrap_used, reason = "tests")]

mod cropped;
mod exposure;
mod fit;
mod flat_sides;
mod hollows;
mod inspected;
mod refined_cameras;
mod sparse_views;
mod verdict;
