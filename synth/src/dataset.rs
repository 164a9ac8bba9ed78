//! Views that we rendered, on disk as others would deliver them.

use std::path::Path;

use datasets::{View, WriteViewsError, write_kaolin};
use mesh_core::TriMesh;

/// Writes views in kaolin's layout, with depth where they have it, and the true mesh beside them.
///
/// The mesh becomes `mesh.ply`, which readers of the layout ignore.
///
/// # Errors
/// If a file cannot be written.
pub fn write_dataset(views: &[View], mesh: &TriMesh, folder: &Path) -> Result<(), WriteViewsError> {
    write_kaolin(views, folder)?;
    let path = folder.join("mesh.ply");
    mesh_core::io::write_mesh(&path, mesh)
        .map_err(|source| WriteViewsError { path, source: source.into() })
}
