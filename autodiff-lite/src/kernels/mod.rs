//! Plain slices in, plain slices out: no tape, no shapes beyond numbers.
#![allow(unsafe_code, reason = "instruction sets are chosen at run time; only kernels may")]

pub mod activation;
pub mod attention;
pub(crate) mod blocks;
pub mod broadcast;
pub mod columns;
pub mod compiled;
pub mod conv;
pub mod convolution;
#[cfg(feature = "testkit")]
pub(crate) mod counting;
pub mod dropout;
pub mod elementwise;
pub(crate) mod extent;
pub mod gemm;
pub mod isa;
pub mod lane;
pub mod norm;
pub mod parallel;
pub mod pooling;
pub mod product;
pub mod project;
pub mod reduce;
pub mod resample;
pub mod rows;
pub mod sampling;
mod simd;
pub mod softmax;
pub mod sparse;
pub mod threads;
mod tile;
pub mod transcendental;
pub mod update;
pub(crate) mod workspace;
