//! Meshes that the tests of files share.
#![allow(dead_code, unreachable_pub, reason = "each test binary uses its own part")]

use mesh_core::{Image, Texture, TriMesh};

/// A tetrahedron with a colour at each corner, and coordinates that decimals do not hold.
pub fn colored() -> TriMesh {
    let positions =
        vec![[0.1, 0.2, 1.0 / 3.0], [1e-7, -2.5e9, 0.0], [3.0, -0.0, 1.0], [0.5, 7.25, -1.0e-20]];
    let faces = vec![[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]];
    let colors = vec![[1.0, 0.0, 0.0], [0.0, 128.0 / 255.0, 1.0], [0.2, 0.4, 0.6], [0.0; 3]];
    TriMesh { positions, faces, colors: Some(colors), texture: None }
}

/// Two triangles that share an edge in space but not on the image, and a vertex of no face.
pub fn textured() -> TriMesh {
    let positions =
        vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.5], [9.0, 9.0, 9.0]];
    let faces = vec![[0, 1, 2], [0, 2, 3]];
    let mut image = Image::new(3, 5, 3);
    for (i, v) in image.data.iter_mut().enumerate() {
        *v = (i * 29 % 256) as f32 / 255.0;
    }
    let uvs = vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.25, 0.125], [0.5, 0.75], [0.125, 0.875]];
    let texture = Texture { uvs, faces: vec![[0, 1, 2], [3, 4, 5]], image };
    TriMesh { positions, faces, colors: None, texture: Some(texture) }
}

/// Texture coordinates of every corner, in order.
pub fn corner_uvs(mesh: &TriMesh) -> Vec<[f32; 2]> {
    let texture = mesh.texture.as_ref().expect("a texture");
    texture.faces.iter().flatten().map(|&i| texture.uvs[i as usize]).collect()
}

/// Whether numbers agree.
pub fn close(a: &[[f32; 3]], b: &[[f32; 3]], tolerance: f32) {
    assert_eq!(a.len(), b.len());
    for (x, y) in a.iter().flatten().zip(b.iter().flatten()) {
        assert!((x - y).abs() <= tolerance, "{x} {y}");
    }
}
