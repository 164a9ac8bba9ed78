//! Plain slices in, plain slices out; no tape.

pub mod alignment;
pub mod assignment;
pub mod chunks;
pub mod compare;
pub mod lab;
pub mod matching;
pub mod neighbors;
pub mod point_tree;
pub mod ssim;
pub mod vec3;
