//! Plain slices in, plain slices out: no tape here.
//!
//! The kernels are usable on their own; the operations of this crate are thin glue over them.

pub mod antialias;
pub mod bits;
pub mod blend;
mod distance;
pub mod gather;
pub mod interpolate;
pub mod lanes;
pub mod layers;
pub mod setup;
pub mod silhouette;
pub mod softras;
pub mod sphere;
pub mod texture;
pub mod visibility;
