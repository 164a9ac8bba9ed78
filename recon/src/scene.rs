//! A mesh as the report's viewer takes it.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use mesh_core::{Texture, TriMesh, bounds, encode_png, vertex_normals};
use train::report::Scene;

/// The mesh with its colours or its texture, and normals to shade it by.
pub fn scene_of(mesh: &TriMesh) -> Scene {
    let around = mesh.bounds().unwrap_or(([0.0; 3], [1.0; 3]));
    let normals = vertex_normals(&mesh.positions, &mesh.faces);
    let mut scene = Scene {
        center: bounds::center(around),
        radius: (0.5 * bounds::diagonal::<f32>(around)).max(f32::MIN_POSITIVE),
        positions: floats(&mesh.positions),
        normals: floats(&normals),
        faces: BASE64.encode(bytemuck::cast_slice::<_, u8>(&mesh.faces)),
        colors: mesh.colors.as_ref().map(|c| BASE64.encode(color_bytes(c))),
        uvs: None,
        texture: None,
    };
    if let Some(texture) = &mesh.texture {
        spread(mesh, texture, &normals, &mut scene);
    }
    scene
}

/// One vertex per corner, since a vertex on a seam has more than one texture coordinate.
fn spread(mesh: &TriMesh, texture: &Texture, normals: &[[f32; 3]], scene: &mut Scene) {
    let corners: Vec<(usize, usize)> = mesh
        .faces
        .iter()
        .zip(&texture.faces)
        .flat_map(|(f, t)| (0..3).map(|k| (f[k] as usize, t[k] as usize)))
        .collect();
    let positions: Vec<_> = corners.iter().map(|c| mesh.positions[c.0]).collect();
    let normals: Vec<_> = corners.iter().map(|c| normals[c.0]).collect();
    let uvs: Vec<_> = corners.iter().map(|c| texture.uvs[c.1]).collect();
    let faces: Vec<u32> = (0..corners.len() as u32).collect();
    scene.positions = floats(&positions);
    scene.normals = floats(&normals);
    scene.uvs = Some(BASE64.encode(bytemuck::cast_slice::<_, u8>(&uvs)));
    scene.faces = BASE64.encode(bytemuck::cast_slice::<_, u8>(&faces));
    scene.colors = None;
    let png = encode_png(&texture.image.to_bytes());
    scene.texture = Some(format!("data:image/png;base64,{}", BASE64.encode(png)));
}

fn floats(values: &[[f32; 3]]) -> String {
    BASE64.encode(bytemuck::cast_slice::<_, u8>(values))
}

fn color_bytes(colors: &[[f32; 3]]) -> Vec<u8> {
    colors.iter().flatten().map(|c| (c.clamp(0.0, 1.0) * 255.0).round() as u8).collect()
}
