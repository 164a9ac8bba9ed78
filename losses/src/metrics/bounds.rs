//! Where a surface lies.

use mesh_core::TriMesh;

/// The bounding box of the vertices that faces use (a stray vertex is no part of the surface).
pub(super) fn bounds(mesh: &TriMesh) -> Option<([f64; 3], [f64; 3])> {
    let mut used = mesh.faces.iter().flatten().map(|&v| mesh.positions[v as usize].map(f64::from));
    let first = used.next()?;
    Some(used.fold((first, first), |(lo, hi), p| {
        (std::array::from_fn(|k| lo[k].min(p[k])), std::array::from_fn(|k| hi[k].max(p[k])))
    }))
}
