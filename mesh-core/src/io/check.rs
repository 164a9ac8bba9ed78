//! What a mesh must be before a file is made of it.

use super::EncodeError;
use crate::TriMesh;

/// Refuses meshes that no reader would take: a writer must not make a damaged file.
pub(super) fn writable(mesh: &TriMesh) -> Result<(), EncodeError> {
    match fault(mesh) {
        None => Ok(()),
        Some(what) => Err(EncodeError::Mesh(what)),
    }
}

/// The first thing that is wrong with a mesh, in words.
fn fault(mesh: &TriMesh) -> Option<String> {
    let finite = |p: &[f32; 3]| p.iter().all(|v| v.is_finite());
    if let Some(v) = mesh.positions.iter().position(|p| !finite(p)) {
        return Some(format!("vertex {v} is at {:?}", mesh.positions[v]));
    }
    let outside = |faces: &[[u32; 3]], count: usize, of: &str| {
        let f = faces.iter().position(|f| f.iter().any(|&i| i as usize >= count))?;
        Some(format!("face {f} has indices {:?} of {count} {of}", faces[f]))
    };
    if let Some(what) = outside(&mesh.faces, mesh.positions.len(), "vertices") {
        return Some(what);
    }
    if let Some(colors) = &mesh.colors {
        if colors.len() != mesh.positions.len() {
            return Some(format!("{} colours, {} vertices", colors.len(), mesh.positions.len()));
        }
        if let Some(v) = colors.iter().position(|c| !finite(c)) {
            return Some(format!("vertex {v} has colour {:?}", colors[v]));
        }
    }
    let texture = mesh.texture.as_ref()?;
    if texture.faces.len() != mesh.faces.len() {
        return Some(format!(
            "{} faces in the texture, {} in the mesh",
            texture.faces.len(),
            mesh.faces.len()
        ));
    }
    if let Some(i) = texture.uvs.iter().position(|uv| !uv.iter().all(|v| v.is_finite())) {
        return Some(format!("texture coordinate {i} is {:?}", texture.uvs[i]));
    }
    let image = &texture.image;
    let sound = match image.height.checked_mul(image.width) {
        Some(pixels) if pixels > 0 && (1..=4).contains(&image.channels) => {
            pixels.checked_mul(image.channels) == Some(image.data.len())
        }
        _ => false,
    };
    if !sound {
        return Some(format!(
            "texture of {} x {} pixels, {} channels and {} values",
            image.width,
            image.height,
            image.channels,
            image.data.len()
        ));
    }
    outside(&texture.faces, texture.uvs.len(), "texture coordinates")
}
