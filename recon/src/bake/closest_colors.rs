//! The colours of a mesh, for another one near it.

use mesh_core::{ClosestPoint, TriMesh};
use rayon::prelude::*;

/// The colours of the closest points of a mesh, where it has some.
pub(crate) fn closest_colors(mesh: &TriMesh, positions: &[[f32; 3]]) -> Option<Vec<[f32; 3]>> {
    if mesh.colors.is_none() && mesh.texture.is_none() {
        return None;
    }
    let surface = ClosestPoint::new(mesh);
    let color = |p: &[f32; 3]| {
        surface.find(*p).map_or([0.5; 3], |found| match (&mesh.texture, &mesh.colors) {
            (Some(texture), _) => texture.color_at(&found.point),
            (None, Some(colors)) => found.point.interpolate(mesh, colors),
            (None, None) => [0.5; 3],
        })
    };
    Some(positions.par_iter().map(color).collect())
}
