//! Every layout as it lies on disk, and as people have it: what is written is read, variants are too, and what is wrong is named.
//! One program: of several, each would be linked with all readers anew.
#![allow(clippy::unwrap_used, reason = "tests")]

mod bad_input;
#[path = "../common/mod.rs"]
mod common;
mod distortion;
mod layouts;
mod opened;
mod paths;
mod peculiar;
mod photos;
mod pixel2mesh;
mod projections;
mod r2n2;
mod rigs;
mod ways_in;
