//! Mesh files: what is written comes back, and other readers see the same.
#![allow(clippy::unwrap_used, reason = "tests")]

mod samples;

use std::path::Path;

use mesh_core::io::{glb, ply};
use mesh_core::{Limits, TriMesh, read_mesh, read_mesh_with_uvs, write_mesh};
use samples::{close, colored, corner_uvs, textured};

#[test]
fn colors_come_back_from_every_format() {
    let folder = tempfile::tempdir().unwrap();
    for (name, tolerance) in [("m.obj", 0.0), ("m.ply", 0.5 / 255.0), ("M.GLB", 1e-6)] {
        let path = folder.path().join(name);
        write_mesh(&path, &colored()).unwrap();
        let back = read_mesh(&path).unwrap();
        assert_eq!(back.positions, colored().positions, "{name}");
        assert_eq!(back.faces, colored().faces, "{name}");
        close(back.colors.as_ref().unwrap(), colored().colors.as_ref().unwrap(), tolerance);
    }
}

#[test]
fn a_texture_comes_back_from_both_formats_that_have_one() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["my mesh.obj", "m.glb"] {
        let path = folder.path().join(name);
        write_mesh(&path, &textured()).unwrap();
        let back = read_mesh(&path).unwrap();
        assert_eq!(back.positions, textured().positions, "{name}");
        assert_eq!(back.faces, textured().faces, "{name}");
        assert_eq!(corner_uvs(&back), corner_uvs(&textured()), "{name}");
        assert_eq!(back.texture.unwrap().image, textured().texture.unwrap().image, "{name}");
        assert_eq!(back.colors, None);
    }
    assert!(folder.path().join("my_mesh.png").is_file());
}

#[test]
fn texture_coordinates_come_without_an_image() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let mut remarks = Vec::new();
    let mut uvs = |name: &str| read_mesh_with_uvs(path(name), &Limits::default(), &mut remarks);
    for name in ["m.obj", "m.glb"] {
        write_mesh(path(name), &textured()).unwrap();
        // Neither library nor image is looked at.
        for file in ["m.mtl", "m.png"].map(path).iter().filter(|file| file.exists()) {
            std::fs::write(file, "damaged").unwrap();
        }
        let mesh = uvs(name).unwrap();
        assert_eq!((&mesh.positions, &mesh.faces), (&textured().positions, &textured().faces));
        assert_eq!(corner_uvs(&mesh), corner_uvs(&textured()), "{name}");
        assert_eq!(mesh.texture.unwrap().image.data, [1.0; 3]);
    }
    let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nproperty float s\nproperty float t\nelement face 1\n\
        property list uchar int vertex_indices\nend_header\n0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n";
    std::fs::write(path("m.ply"), text).unwrap();
    let mesh = uvs("m.ply").unwrap();
    assert_eq!(corner_uvs(&mesh), [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]);
    assert!(read_mesh(path("m.ply")).unwrap().texture.is_none());
    // None in the file, or in no format.
    for name in ["c.obj", "c.glb", "c.ply", "c.stl"] {
        write_mesh(path(name), &colored()).unwrap();
        assert!(uvs(name).unwrap().texture.is_none(), "{name}");
    }
    assert!(remarks.is_empty(), "{remarks:?}");
}

#[test]
fn ply_turns_a_texture_into_vertex_colors() {
    let mut mesh = textured();
    // One colour on the left half of the image, another on the right.
    let image = &mut mesh.texture.as_mut().unwrap().image;
    for pixel in image.data.chunks_exact_mut(3) {
        pixel.copy_from_slice(&[0.2, 0.4, 1.0]);
    }
    let back = ply::decode(&ply::encode(&mesh, ply::Encoding::Ascii).unwrap(), "a.ply").unwrap();
    let colors = back.colors.unwrap();
    close(&colors[..4], &[[0.2, 0.4, 1.0]; 4], 0.5 / 255.0);
    assert_eq!(colors[4], [1.0; 3]);
}

#[test]
fn ply_ascii_and_binary_say_the_same() {
    let of = |encoding| ply::decode(&ply::encode(&colored(), encoding).unwrap(), "a.ply").unwrap();
    assert_eq!(of(ply::Encoding::Ascii), of(ply::Encoding::Binary));
}

#[test]
fn meshes_without_faces_or_vertices_are_files_too() {
    let folder = tempfile::tempdir().unwrap();
    let points = TriMesh::new(vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], vec![]);
    for mesh in [TriMesh::default(), points] {
        for name in ["m.obj", "m.ply", "m.glb"] {
            let path = folder.path().join(name);
            write_mesh(&path, &mesh).unwrap();
            assert_eq!(read_mesh(&path).unwrap(), mesh, "{name}");
        }
    }
}

#[test]
fn the_same_mesh_is_the_same_bytes() {
    assert_eq!(glb::encode(&textured()).unwrap(), glb::encode(&textured()).unwrap());
    assert_eq!(
        ply::encode(&colored(), ply::Encoding::Binary).unwrap(),
        ply::encode(&colored(), ply::Encoding::Binary).unwrap()
    );
}

#[test]
fn a_damaged_mesh_is_not_written() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["m.obj", "m.ply", "m.glb", "m.stl"] {
        let path = folder.path().join(name);
        let mut mesh = colored();
        mesh.faces[1][2] = 4;
        let error = write_mesh(&path, &mesh).unwrap_err().to_string();
        assert!(error.contains("face 1") && error.contains(name), "{error}");
        let mut mesh = colored();
        mesh.positions[2][1] = f32::NAN;
        assert!(write_mesh(&path, &mesh).unwrap_err().to_string().contains("vertex 2"));
        assert!(!path.exists());
    }
    assert!(write_mesh(folder.path().join("m.dae"), &colored()).is_err());
    assert!(read_mesh(folder.path().join("m.3mf")).is_err());
}

#[test]
fn vertex_colors_stand_where_other_programs_look() {
    // As Blender and trimesh find them: by these names and of these types, and in no other place.
    let header = ply::encode(&colored(), ply::Encoding::Binary).unwrap();
    let header = String::from_utf8_lossy(&header);
    let colors = "property uchar red\nproperty uchar green\nproperty uchar blue\nelement face";
    assert!(header.contains(&format!("property float z\n{colors}")), "{header}");
    let folder = tempfile::tempdir().unwrap();
    write_mesh(folder.path().join("m.obj"), &colored()).unwrap();
    let text = std::fs::read_to_string(folder.path().join("m.obj")).unwrap();
    let vertices: Vec<usize> =
        text.lines().filter(|l| l.starts_with("v ")).map(|l| l.split(' ').count()).collect();
    assert_eq!(vertices, vec![1 + 6; colored().positions.len()]);
    let glb = gltf::Gltf::from_slice(&glb::encode(&colored()).unwrap()).unwrap();
    let primitive = glb.meshes().next().unwrap().primitives().next().unwrap();
    let accessor = primitive.get(&gltf::Semantic::Colors(0)).unwrap();
    assert_eq!(accessor.count(), colored().positions.len());
    assert_eq!(
        (accessor.data_type(), accessor.dimensions()),
        (gltf::accessor::DataType::F32, gltf::accessor::Dimensions::Vec3)
    );
    // They would be multiplied with a texture's.
    let glb = gltf::Gltf::from_slice(&glb::encode(&textured()).unwrap()).unwrap();
    let primitive = glb.meshes().next().unwrap().primitives().next().unwrap();
    assert!(primitive.get(&gltf::Semantic::Colors(0)).is_none());
    let sampler = glb.textures().next().unwrap().sampler();
    assert_eq!(sampler.min_filter(), Some(gltf::texture::MinFilter::LinearMipmapLinear));
}

// ---------------------------------------------------------------- independent readers

#[test]
fn tobj_reads_the_same_obj() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.obj");
    write_mesh(&path, &colored()).unwrap();
    let (models, _) = tobj::load_obj(&path, &tobj::LoadOptions::default()).unwrap();
    let mesh = &models[0].mesh;
    // tobj lists vertices as faces come to them; these faces come to 0, 1, 2, 3.
    assert_eq!(mesh.positions, colored().positions.concat());
    assert_eq!(mesh.vertex_color, colored().colors.unwrap().concat());
    assert_eq!(mesh.indices, colored().faces.concat());

    write_mesh(&path, &textured()).unwrap();
    let (models, materials) = tobj::load_obj(&path, &tobj::LoadOptions::default()).unwrap();
    let (mesh, material) = (&models[0].mesh, &materials.unwrap()[0]);
    assert_eq!(material.diffuse_texture.as_deref(), Some("m.png"));
    assert_eq!(mesh.material_id, Some(0));
    let uvs: Vec<f32> = mesh
        .texcoord_indices
        .iter()
        .flat_map(|&i| [mesh.texcoords[2 * i as usize], mesh.texcoords[2 * i as usize + 1]])
        .collect();
    assert_eq!(uvs, corner_uvs(&textured()).concat());
}

#[test]
fn the_gltf_crate_reads_the_same_glb() {
    let positions = |mesh: &TriMesh, bytes: &[u8]| {
        let file = gltf::Gltf::from_slice(bytes).unwrap(); // validates as it reads
        let blob = file.blob.as_ref().unwrap();
        let primitive = file.meshes().next().unwrap().primitives().next().unwrap();
        let reader = primitive.reader(|_| Some(blob));
        let positions: Vec<[f32; 3]> = reader.read_positions().unwrap().collect();
        let indices: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
        let corners: Vec<[f32; 3]> = indices.iter().map(|&i| positions[i as usize]).collect();
        let expected: Vec<[f32; 3]> =
            mesh.faces.iter().flatten().map(|&i| mesh.positions[i as usize]).collect();
        assert_eq!(corners, expected);
        let bounds = primitive.bounding_box();
        for k in 0..3 {
            let of = |p: &&[f32; 3]| p[k];
            let all = mesh.positions.iter();
            assert_eq!(bounds.min[k], all.clone().map(|p| of(&p)).fold(f32::INFINITY, f32::min));
            assert_eq!(bounds.max[k], all.map(|p| of(&p)).fold(f32::NEG_INFINITY, f32::max));
        }
        // Smooth normals, of length 1, the same on both sides of a seam.
        let normals: Vec<[f32; 3]> = reader.read_normals().unwrap().collect();
        assert_eq!(normals.len(), positions.len());
        let smooth = mesh_core::vertex_normals(&mesh.positions, &mesh.faces);
        for (&i, &v) in indices.iter().zip(mesh.faces.iter().flatten()) {
            assert_eq!(normals[i as usize], smooth[v as usize]);
        }
        assert!(normals.iter().all(|n| (n.iter().map(|x| x * x).sum::<f32>() - 1.0).abs() < 1e-5));
        let material = primitive.material();
        assert_eq!(material.unlit(), mesh.colors.is_some() || mesh.texture.is_some());
        assert_eq!(material.pbr_metallic_roughness().metallic_factor(), 0.0);
    };
    // Without colours a viewer has to light the shape.
    let bare = TriMesh { colors: None, ..colored() };
    let bytes = glb::encode(&bare).unwrap();
    positions(&bare, &bytes);
    assert_eq!(gltf::Gltf::from_slice(&bytes).unwrap().extensions_used().count(), 0);
    assert_eq!(glb::decode(&bytes, "a.glb").unwrap(), bare);

    let bytes = glb::encode(&colored()).unwrap();
    positions(&colored(), &bytes);
    let file = gltf::Gltf::from_slice(&bytes).unwrap();
    let blob = file.blob.as_ref().unwrap();
    let primitive = file.meshes().next().unwrap().primitives().next().unwrap();
    assert!(!primitive.material().double_sided(), "a tetrahedron is closed");
    let colors: Vec<[f32; 3]> =
        primitive.reader(|_| Some(blob)).read_colors(0).unwrap().into_rgb_f32().collect();
    // Linear: 128/255 of sRGB is 21.6 % of the light.
    assert!((colors[1][1] - 0.215_861).abs() < 1e-5);
    assert_eq!(colors[0], [1.0, 0.0, 0.0]);

    let bytes = glb::encode(&textured()).unwrap();
    positions(&textured(), &bytes);
    let file = gltf::Gltf::from_slice(&bytes).unwrap();
    let blob = file.blob.as_ref().unwrap();
    let primitive = file.meshes().next().unwrap().primitives().next().unwrap();
    assert!(primitive.material().double_sided());
    let reader = primitive.reader(|_| Some(blob));
    let uvs: Vec<[f32; 2]> = reader.read_tex_coords(0).unwrap().into_f32().collect();
    let corners: Vec<[f32; 2]> = reader
        .read_indices()
        .unwrap()
        .into_u32()
        .map(|i| [uvs[i as usize][0], 1.0 - uvs[i as usize][1]])
        .collect();
    assert_eq!(corners, corner_uvs(&textured()));
    let info = primitive.material().pbr_metallic_roughness().base_color_texture().unwrap();
    let gltf::image::Source::View { view, mime_type } = info.texture().source().source() else {
        panic!("an image in the file")
    };
    assert_eq!(mime_type, "image/png");
    let png = &blob[view.offset()..view.offset() + view.length()];
    let image = mesh_core::decode_image(png, "inside").unwrap();
    assert_eq!(image, textured().texture.unwrap().image.to_bytes());
}

#[test]
fn ply_rs_reads_the_same_ply() {
    use ply_rs_bw::ply::{DefaultElement, Property};
    for encoding in [ply::Encoding::Ascii, ply::Encoding::Binary] {
        let bytes = ply::encode(&colored(), encoding).unwrap();
        let parser = ply_rs_bw::parser::Parser::<DefaultElement>::new();
        let file = parser.read_ply(&mut bytes.as_slice()).unwrap();
        let (vertices, faces) = (&file.payload["vertex"], &file.payload["face"]);
        for (v, vertex) in vertices.iter().enumerate() {
            for (k, name) in ["x", "y", "z"].iter().enumerate() {
                assert_eq!(vertex[*name], Property::Float(colored().positions[v][k]));
            }
        }
        let green: Vec<_> = vertices.iter().map(|v| v["green"].clone()).collect();
        assert_eq!(green, [0, 128, 102, 0].map(Property::UChar));
        for (f, face) in faces.iter().enumerate() {
            let expected = colored().faces[f].map(|i| i as i32).to_vec();
            assert_eq!(face["vertex_indices"], Property::ListInt(expected));
        }
    }
}

#[test]
fn missing_files_name_themselves() {
    for name in ["none.obj", "none.ply", "none.glb"] {
        let error = read_mesh(Path::new("no/such").join(name)).unwrap_err().to_string();
        assert!(error.contains(name), "{error}");
    }
}
