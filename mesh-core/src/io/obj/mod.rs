//! Wavefront OBJ, with vertex colours, MTL and a texture.

mod mtl;
mod read;
mod write;

pub use read::{decode, read, read_with_notes};
pub use write::write;
