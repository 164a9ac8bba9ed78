//! What a mesh must be before a file is made of it.

use super::EncodeError;
use crate::{Image, TriMesh};

/// Refuses meshes that no reader would take: a writer must not make a damaged file.
pub(super) fn writable(mesh: &TriMesh) -> Result<(), EncodeError> {
    mesh.sound().map_err(|fault| EncodeError::Mesh(fault.to_string()))?;
    match mesh.texture.as_ref().map(|texture| &texture.image) {
        Some(&Image { height, width, channels, .. })
            if height.min(width) == 0 || !(1..=4).contains(&channels) =>
        {
            let what = format!("texture of {width} x {height} pixels, {channels} channels");
            Err(EncodeError::Mesh(what))
        }
        _ => Ok(()),
    }
}
