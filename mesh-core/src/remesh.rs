//! Changing the triangles of a closed surface while keeping its shape.

mod error;
mod graded;
mod improve;
mod isotropic;
mod shape;
#[cfg(feature = "camera")]
mod simplify;
mod surface;

pub use error::RemeshError;
pub use graded::coarsen;
pub use improve::{ImproveOptions, Improvement, improve};
pub use isotropic::{RemeshOptions, Remeshed, remesh};
#[cfg(feature = "camera")]
pub use simplify::simplify;
