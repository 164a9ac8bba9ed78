//! Mesh files: OBJ, PLY, GLB and STL in and out, OFF in, 3MF out, each written whole or not at all; voxels as binvox.
//!
//! | format | geometry | colours | texture |
//! |---|---|---|---|
//! | OBJ | text, polygons on reading | sRGB after each `v` | MTL and a PNG beside it |
//! | PLY | binary or ASCII | sRGB bytes | read (`TextureFile`); written as vertex colours |
//! | GLB | binary, node transforms on reading | linear floats | PNG inside |
//! | STL | binary; text on reading | - | - |
//! | 3MF | XML in a ZIP archive; only written, with the feature `3mf` | sRGB bytes | PNG inside |
//! | OFF | text, polygons; only read | passed over | - |
//!
//! Colours in memory are sRGB. Where a mesh has both colours and a texture, OBJ keeps both, GLB
//! and 3MF keep the texture (a viewer would multiply the two) and PLY keeps the colours.
//!
//! Readers take any bytes: what is wrong becomes an error that names the file, the line or field,
//! what was found and what was expected; no length that a file claims is believed before the
//! bytes are there. Memory and images are held to [`Limits`]: those of `read` and `decode` are the
//! default, those of `read_with` and `decode_with` the caller's, and what the mesh does not hold of
//! the file is added to a list of [`Remark`]s. Only regular files are opened, and of those that a file
//! names only what is in its folder or below it.

mod atomic;
pub mod binvox;
mod check;
mod error;
pub mod glb;
pub mod obj;
pub mod off;
mod open;
pub mod ply;
mod remark;
pub mod stl;
#[cfg(feature = "3mf")]
pub mod threemf;

use std::path::{Path, PathBuf};

pub use atomic::write_atomic;
pub use error::{EncodeError, ReadMeshError, WriteError};
pub(crate) use open::regular;
pub use remark::{NotRead, Remark};

use crate::{Limits, TriMesh};

/// Reads a mesh; the file's extension says which format it is: `.obj`, `.ply`, `.glb`, `.off` or
/// `.stl`.
///
/// # Errors
/// Another extension, a file that cannot be read, one that is not as its format says, or one that needs
/// more than the default [`Limits`].
pub fn read_mesh(path: impl AsRef<Path>) -> Result<TriMesh, ReadMeshError> {
    read_mesh_with(path, &Limits::default(), &mut Vec::new())
}

/// [`read_mesh`] within other limits; what the mesh does not hold of the file is added to `remarks`.
///
/// # Errors
/// As [`read_mesh`].
pub fn read_mesh_with(
    path: impl AsRef<Path>,
    limits: &Limits,
    remarks: &mut Vec<Remark>,
) -> Result<TriMesh, ReadMeshError> {
    let path = path.as_ref();
    match extension(path).as_str() {
        "obj" => obj::read_with(path, limits, remarks),
        "ply" => ply::read_with(path, limits, remarks),
        "glb" => glb::read_with(path, limits, remarks),
        "off" => off::read_with(path, limits, remarks),
        "stl" => stl::read_with(path, limits, remarks),
        found => Err(ReadMeshError::Extension { path: path.to_owned(), found: found.to_owned() }),
    }
}

/// Writes a mesh in the format of the path's extension: `.obj`, `.ply` (binary), `.glb`, `.stl`, and with the
/// feature `3mf` `.3mf`.
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
        "stl" => stl::write(path, mesh),
        #[cfg(feature = "3mf")]
        "3mf" => threemf::write(path, mesh),
        found => Err(WriteError::Extension { path: path.to_owned(), found: found.to_owned() }),
    }
}

/// The files that [`write_mesh`] makes for a mesh, the one at `path` first: a textured OBJ has
/// [`companions`](obj::companions), whatever stood there before.
pub fn files_of(path: impl AsRef<Path>, mesh: &TriMesh) -> Vec<PathBuf> {
    let path = path.as_ref();
    let mut files = vec![path.to_owned()];
    if mesh.texture.is_some() && extension(path) == "obj" {
        files.extend(obj::companions(path));
    }
    files
}

fn extension(path: &Path) -> String {
    path.extension().map_or_else(String::new, |e| e.to_string_lossy().to_lowercase())
}
