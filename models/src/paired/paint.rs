//! The colours of points on a painted surface.

use mesh_core::vector::interpolate;
use mesh_core::{SurfacePoint, Texture, TriMesh};

/// sRGB colours at points of a mesh, from its vertices or its texture; empty where it has neither.
pub(super) fn colors_of(mesh: &TriMesh, points: &[SurfacePoint]) -> Vec<[f32; 3]> {
    match (&mesh.colors, &mesh.texture) {
        (Some(colors), _) => points.iter().map(|point| point.interpolate(mesh, colors)).collect(),
        (_, Some(texture)) => points.iter().map(|point| texel(texture, point)).collect(),
        _ => Vec::new(),
    }
}

/// The nearest texel.
fn texel(texture: &Texture, point: &SurfacePoint) -> [f32; 3] {
    let corners = texture.faces[point.face as usize].map(|k| texture.uvs[k as usize]);
    let [u, v] = interpolate(point.barycentric, &corners);
    let image = &texture.image;
    // Coordinates go round, and v goes up.
    let cell = |x: f32, size: usize| ((x.rem_euclid(1.0) * size as f32) as usize).min(size - 1);
    let (row, column) = (cell(1.0 - v, image.height), cell(u, image.width));
    let pixel = image.pixel(row, column);
    std::array::from_fn(|c| pixel[c.min(pixel.len() - 1)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesh_core::{Image, primitives::cuboid};

    #[test]
    fn colors_come_from_vertices_or_from_the_texture() {
        let mut mesh = cuboid([1.0; 3]);
        let point = SurfacePoint { face: 0, barycentric: [0.5, 0.25, 0.25] };
        assert!(colors_of(&mesh, &[point]).is_empty());
        // Two columns, red and blue; two rows, the upper one half as bright.
        let data = vec![0.5, 0.0, 0.0, 0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        let image = Image { height: 2, width: 2, channels: 3, data };
        let uvs = vec![[0.1, 0.2], [1.4, 0.2], [0.1, 0.9]];
        mesh.texture = Some(Texture { uvs, faces: vec![[0, 1, 2]; mesh.faces.len()], image });
        let at = |barycentric| colors_of(&mesh, &[SurfacePoint { face: 0, barycentric }])[0];
        assert_eq!(at([1.0, 0.0, 0.0]), [1.0, 0.0, 0.0]);
        assert_eq!(at([0.0, 0.0, 1.0]), [0.5, 0.0, 0.0]);
        assert_eq!(at([0.5, 0.5, 0.0]), [0.0, 0.0, 1.0]);
        mesh.colors = Some(vec![[0.25, 0.5, 0.75]; mesh.positions.len()]);
        assert_eq!(colors_of(&mesh, &[point]), [[0.25, 0.5, 0.75]]);
    }
}
