//! Meshes that the user names.

use std::path::Path;

use mesh_core::{Limits, TriMesh, read_mesh_with};

use crate::console::Console;
use crate::failure::Failure;

/// Reads a mesh, and says in a line each what of the file it does not hold.
pub(crate) fn read_mesh(console: Console, path: &Path) -> Result<TriMesh, Failure> {
    let mut remarks = Vec::new();
    let mesh = read_mesh_with(path, &Limits::default(), &mut remarks).map_err(Failure::input)?;
    for remark in remarks {
        console.warn(format_args!("{}: {remark}", path.display()));
    }
    Ok(mesh)
}
