//! The crate from outside: sizes that wrap, files of state, bits that do not depend on threads. One program: of several, each
//! would compile the kernels anew.
#![allow(clippy::unwrap_used, reason = "tests")]

mod determinism;
mod extents;
mod peers;
mod state;
