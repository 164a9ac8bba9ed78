//! DIB-R, a differentiable rasteriser, on the CPU.

pub mod kernels;
pub mod ops;
pub mod reference;

mod faces;
mod fragments;
mod settings;

pub use faces::{Faces, FacesError, NONE};
pub use fragments::{Fragments, rasterize, rasterize_into};
pub use ops::{
    antialiased_silhouette, depth, interpolate, interpolate_corners, soft_silhouette, texture,
};
pub use settings::{Instructions, Rule, Settings};
