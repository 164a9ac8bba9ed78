//! Mesh files: OBJ, PLY and GLB in and out, each written whole or not at all; voxels as binvox.
//!
//! | format | geometry | colours | texture |
//! |---|---|---|---|
//! | OBJ | text, polygons on reading | sRGB after each `v` | MTL and a PNG beside it |
//! | PLY | binary or ASCII | sRGB bytes | read (`TextureFile`); written as vertex colours |
//! | GLB | binary, node transforms on reading | linear floats | PNG inside |
//! | OFF | text, polygons; only read | passed over | - |
//!
//! Colours in memory are sRGB. Where a mesh has both colours and a texture, OBJ keeps both, GLB
//! keeps the texture (a viewer would multiply the two) and PLY keeps the colours.
//!
//! Readers take any bytes: what is wrong becomes an error that names the file, the line or field,
//! what was found and what was expected; no length that a file claims is believed before the
//! bytes are there.

mod atomic;
pub mod binvox;
mod check;
mod error;
pub mod glb;
pub mod obj;
pub mod off;
pub mod ply;

use std::path::Path;

pub use atomic::write_atomic;
pub use error::{ReadMeshError, WriteError};

use crate::TriMesh;

/// Reads a mesh; the file's extension says which format it is: `.obj`, `.ply`, `.glb` or `.off`.
///
/// # Errors
/// Another extension, a file that cannot be read, or one that is not as its format says.
pub fn read_mesh(path: impl AsRef<Path>) -> Result<TriMesh, ReadMeshError> {
    let path = path.as_ref();
    match extension(path).as_str() {
        "obj" => obj::read(path),
        "ply" => ply::read(path),
        "glb" => glb::read(path),
        "off" => off::read(path),
        found => Err(ReadMeshError::Extension { path: path.to_owned(), found: found.to_owned() }),
    }
}

/// Writes a mesh in the format of the path's extension; PLY is binary.
///
/// # Errors
/// Another extension, a file that cannot be written, or a mesh with an index out of range or a
/// position that is not finite.
pub fn write_mesh(path: impl AsRef<Path>, mesh: &TriMesh) -> Result<(), WriteError> {
    let path = path.as_ref();
    match extension(path).as_str() {
        "obj" => obj::write(path, mesh),
        "ply" => ply::write(path, mesh, ply::Encoding::Binary),
        "glb" => glb::write(path, mesh),
        found => Err(WriteError::Extension { path: path.to_owned(), found: found.to_owned() }),
    }
}

fn extension(path: &Path) -> String {
    path.extension().map_or_else(String::new, |e| e.to_string_lossy().to_lowercase())
}

fn read_bytes(path: &Path) -> Result<Vec<u8>, ReadMeshError> {
    std::fs::read(path).map_err(|source| ReadMeshError::Io { path: path.to_owned(), source })
}
