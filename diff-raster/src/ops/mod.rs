//! The differentiable operations: thin glue between the tape and the kernels.
//!
//! What these functions need between their passes is allocated in each call; the same operations of a
//! [`Frame`](crate::Frame) use that of earlier frames.

mod blend;
mod depth;
mod interpolate;
mod layers;
mod silhouette;
mod softras;
mod sphere_texture;
mod texture;

pub use blend::BlendSettings;
pub use depth::depth;
pub use interpolate::{interpolate, interpolate_corners};
pub use silhouette::{antialiased_silhouette, soft_silhouette};
pub use softras::{Paint, softras};
pub use sphere_texture::sphere_texture;
pub use texture::texture;
