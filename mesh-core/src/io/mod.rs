//! Mesh files: OBJ, PLY and GLB in and out, each written whole or not at all.

mod atomic;
mod error;

pub use atomic::write_atomic;
pub use error::WriteError;
