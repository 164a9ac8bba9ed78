//! Loops over plain slices that are worth writing for the machine.
//!
//! With the feature `simd` each takes the instruction set as an argument (`Arch`), so that tests can force every path; the
//! functions at the crate root choose it themselves.

pub mod nearest;
pub(crate) mod threads;

#[cfg(feature = "simd")]
pub use pulp::Arch;
