//! Wavefront OBJ, with vertex colours, MTL and a texture.

mod lines;
mod mtl;
mod parse;
mod read;
mod skin;
mod write;

pub(super) use read::mesh;
pub use read::{decode, decode_with, read, read_with};
pub use write::{companions, write};
