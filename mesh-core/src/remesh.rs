//! Changing the triangles of a closed surface while keeping its shape.

mod error;
mod improve;
mod isotropic;
mod shape;
mod surface;

pub use error::RemeshError;
pub use improve::{ImproveOptions, Improvement, improve};
pub use isotropic::{RemeshOptions, Remeshed, remesh};
