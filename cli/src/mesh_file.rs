//! Meshes that the user names.

use std::path::Path;

use mesh_core::{Limits, ReadMeshError, Remark, TriMesh, read_mesh_with};

use crate::console::Console;
use crate::failure::Failure;

/// Reads a mesh, and says in a line each what of the file it does not hold.
pub(crate) fn read_mesh(console: Console, path: &Path) -> Result<TriMesh, Failure> {
    remarked(console, path, |remarks| read_mesh_with(path, &Limits::default(), remarks))
}

/// The same by another reader.
pub(crate) fn remarked(
    console: Console,
    path: &Path,
    read: impl FnOnce(&mut Vec<Remark>) -> Result<TriMesh, ReadMeshError>,
) -> Result<TriMesh, Failure> {
    let mut remarks = Vec::new();
    let mesh = read(&mut remarks).map_err(Failure::input)?;
    for remark in remarks {
        console.warn(format_args!("{}: {remark}", path.display()));
    }
    Ok(mesh)
}
