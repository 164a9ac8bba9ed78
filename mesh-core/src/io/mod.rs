//! Mesh files: OBJ, PLY, GLB and STL in and out, OFF in, 3MF out, each written whole or not at all; voxels as binvox.
//!
//! | format | geometry | colours | texture |
//! |---|---|---|---|
//! | OBJ | text, polygons on reading | sRGB after each `v` | MTL and a PNG beside it |
//! | PLY | binary or ASCII | sRGB bytes | read (`TextureFile`); written as vertex colours |
//! | GLB | binary, node transforms on reading | linear floats | PNG inside |
//! | STL | binary; text on reading | - | - |
//! | 3MF | XML in a ZIP archive; only written, with the feature `3mf` | sRGB bytes | PNG inside |
//! | OFF | text, polygons; only read | of vertices | - |
//!
//! Colours in memory are sRGB. Where a mesh has both colours and a texture, OBJ keeps both, GLB
//! and 3MF keep the texture (a viewer would multiply the two) and PLY keeps the colours.
//!
//! Polygons become triangles: a fan from the first corner, or, where that would leave the polygon, ears that are cut off (up to 1,024
//! corners).
//!
//! Readers take any bytes: what is wrong becomes an error that names the file, the line or field,
//! what was found and what was expected; no length that a file claims is believed before the
//! bytes are there. Memory and images are held to [`Limits`](crate::Limits): those of `read` and `decode` are the
//! default, those of `read_with` and `decode_with` the caller's, and what the mesh does not hold of
//! the file is added to a list of [`Remark`]s. Only regular files are opened, and of those that a file
//! names only what is in its folder or below it.
//!
//! All formats are behind the feature `files`; [`write_atomic`] comes with `images` too. Both are on by default.

mod atomic;
mod error;
mod regular;

#[cfg(feature = "files")]
mod any;
#[cfg(feature = "files")]
mod atlas;
#[cfg(feature = "files")]
pub mod binvox;
#[cfg(feature = "files")]
mod check;
#[cfg(feature = "files")]
pub mod glb;
#[cfg(feature = "files")]
pub mod obj;
#[cfg(feature = "files")]
pub mod off;
#[cfg(feature = "files")]
mod open;
#[cfg(feature = "files")]
pub mod ply;
#[cfg(feature = "files")]
mod polygons;
#[cfg(feature = "files")]
mod remark;
#[cfg(feature = "files")]
pub mod stl;
#[cfg(feature = "3mf")]
pub mod threemf;

#[cfg(feature = "files")]
pub use any::{files_of, read_mesh, read_mesh_with, read_mesh_with_uvs, write_mesh};
pub use atomic::write_atomic;
pub use error::{EncodeError, ReadMeshError, WriteError};
pub(crate) use regular::regular;
#[cfg(feature = "files")]
pub use remark::{NotRead, Remark};
