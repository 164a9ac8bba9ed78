//! Plain slices in, plain slices out: no tape, no shapes beyond numbers.
#![allow(unsafe_code, reason = "instruction sets are chosen at run time; only kernels may")]

pub mod broadcast;
pub mod elementwise;
pub mod reduce;
pub mod rows;
mod simd;
pub mod transcendental;
pub mod update;
