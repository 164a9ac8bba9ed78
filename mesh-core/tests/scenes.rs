//! GLB as people and their programs write it: transforms, materials, seams.
#![allow(clippy::unwrap_used, reason = "tests")]

mod common;
mod samples;

use common::glb_of;
use mesh_core::io::glb;
use mesh_core::{Limits, TriMesh};
use samples::{close, colored, textured};

#[test]
fn glb_transforms_small_indices_strides_and_normalized_colors() {
    // Three vertices of 12 bytes position and 4 bytes of colour, then indices of one byte.
    let mut bin = Vec::new();
    for (p, c) in [([0.0_f32, 0.0, 0.0], 0_u8), ([1.0, 0.0, 0.0], 255), ([0.0, 1.0, 0.0], 0)] {
        bin.extend(p.iter().flat_map(|v| v.to_le_bytes()));
        bin.extend([c, 0, 255, 255]);
    }
    bin.extend([0, 1, 2, 0]);
    let json = r#"{"asset":{"version":"2.0"},"scenes":[{"nodes":[0]}],
        "nodes":[{"children":[1],"translation":[10,0,0]},
                 {"mesh":0,"scale":[2,2,-2],"rotation":[0,0,0.7071067811865476,0.7071067811865476]}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0,"COLOR_0":1},"indices":2}]}],
        "accessors":[
          {"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"},
          {"bufferView":0,"byteOffset":12,"componentType":5121,"normalized":true,"count":3,"type":"VEC4"},
          {"bufferView":1,"componentType":5121,"count":3,"type":"SCALAR"}],
        "bufferViews":[{"buffer":0,"byteLength":48,"byteStride":16},
                       {"buffer":0,"byteOffset":48,"byteLength":3}],
        "buffers":[{"byteLength":52}]}"#;
    let mesh = glb::decode(&glb_of(json, &bin), "a.glb").unwrap();
    let expected = [[10.0, 0.0, 0.0], [10.0, 2.0, 0.0], [8.0, 0.0, 0.0]];
    close(&mesh.positions, &expected, 1e-6);
    assert_eq!(mesh.faces, [[0, 2, 1]], "a mirror turns the winding round");
    assert_eq!(mesh.colors.unwrap()[1], [1.0, 0.0, 1.0]);

    let cycle = json.replace(r#""scale""#, r#""children":[0],"scale""#);
    assert!(glb::decode(&glb_of(&cycle, &bin), "a.glb").unwrap_err().to_string().contains("twice"));
    let compressed =
        json.replace("{\"asset\"", "{\"extensionsRequired\":[\"KHR_draco\"],\"asset\"");
    let error = glb::decode(&glb_of(&compressed, &bin), "a.glb").unwrap_err().to_string();
    assert!(error.contains("KHR_draco"), "{error}");
    let outside = json.replace("\"byteOffset\":48", "\"byteOffset\":17");
    assert!(glb::decode(&glb_of(&outside, &bin), "a.glb").is_err());
}

/// In glTF a texture is multiplied by its material's colour and by its vertices'; parts without it have colours of their own.
#[test]
fn glb_textures_are_multiplied_by_their_material() {
    let image = mesh_core::encode_png(&mesh_core::ByteImage {
        height: 1,
        width: 1,
        channels: 3,
        data: vec![200, 100, 255],
    });
    let mut bin = Vec::new();
    for p in [[0.0_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] {
        bin.extend(p.iter().flat_map(|v| v.to_le_bytes()));
    }
    for uv in [[0.0_f32, 0.0], [3.0, 0.0], [0.0, 1.0]] {
        bin.extend(uv.iter().flat_map(|v| v.to_le_bytes()));
    }
    let length = image.len();
    bin.extend(&image);
    bin.resize(bin.len().next_multiple_of(4), 0);
    let json = |primitives: &str| {
        let surface = r#"{"pbrMetallicRoughness":{"baseColorFactor":[0.5,1,0,1],"baseColorTexture":{"index":0}}}"#;
        let plain = r#"{"pbrMetallicRoughness":{"baseColorFactor":[1,0,0,1]}}"#;
        format!(
            r#"{{"asset":{{"version":"2.0"}},"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
            "meshes":[{{"primitives":[{primitives}]}}],"materials":[{surface},{plain}],
            "textures":[{{"source":0}}],"images":[{{"bufferView":2,"mimeType":"image/png"}}],
            "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}},
              {{"bufferView":1,"componentType":5126,"count":3,"type":"VEC2"}}],
            "bufferViews":[{{"buffer":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":24}},
              {{"buffer":0,"byteOffset":60,"byteLength":{length}}}],
            "buffers":[{{"byteLength":{}}}]}}"#,
            bin.len()
        )
    };
    let textured = r#"{"attributes":{"POSITION":0,"TEXCOORD_0":1},"material":0}"#;
    let read = |primitives: &str| {
        let bytes = glb_of(&json(primitives), &bin);
        let mut remarks = Vec::new();
        let mesh = glb::decode_with(&bytes, "a.glb", &Limits::default(), &mut remarks).unwrap();
        (mesh, remarks.iter().map(ToString::to_string).collect::<Vec<_>>())
    };
    let (mesh, remarks) = read(textured);
    assert!(remarks.is_empty() && mesh.colors.is_none(), "{remarks:?}");
    let texture = mesh.texture.as_ref().unwrap();
    // Half of the light of 200 is 146.
    close(&[texture.color([0.5, 0.5])], &[[146.0 / 255.0, 100.0 / 255.0, 0.0]], 0.5 / 255.0);
    let written = glb::encode(&mesh).unwrap();
    assert!(written.windows(13).any(|w| w == b"\"wrapS\":10497"), "tiled, and not repeated");
    let plain = r#"{"attributes":{"POSITION":0},"material":1}"#;
    let (mesh, remarks) = read(&format!("{textured},{plain}"));
    assert!(mesh.colors.is_none() && remarks.len() == 1, "{remarks:?}");
    assert!(remarks[0].contains("3 corners take (0, 0)"), "{remarks:?}");
    let tinted = textured.replace("\"POSITION\":0,", "\"POSITION\":0,\"COLOR_0\":0,");
    let (mesh, remarks) = read(&format!("{textured},{tinted}"));
    assert!(mesh.colors.is_none() && remarks[0].starts_with("1 part: colours"), "{remarks:?}");
}

#[test]
fn vertices_at_one_place_stay_apart_in_what_we_write_and_are_joined_in_what_others_do() {
    // Two triangles that touch in two places, each with its own vertices there.
    let positions = vec![
        [0.0; 3],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [1.0, 1.0, 1.0],
    ];
    let mesh = TriMesh::new(positions, vec![[0, 1, 2], [3, 5, 4]]);
    let bytes = glb::encode(&mesh).unwrap();
    assert_eq!(glb::decode(&bytes, "a.glb").unwrap(), mesh);
    let at = bytes.windows(9).position(|w| w == b"mesh-core").unwrap();
    let other = [&bytes[..at], b"some tool", &bytes[at + 9..]].concat();
    let joined = glb::decode(&other, "a.glb").unwrap();
    assert_eq!((joined.positions.len(), &joined.faces[..]), (4, &[[0, 1, 2], [1, 3, 2]][..]));
}

#[test]
fn seams_are_joined_so_that_a_closed_mesh_stays_closed() {
    let mut mesh = colored();
    let uvs: Vec<[f32; 2]> = (0..12).map(|i| [i as f32 / 16.0, 0.5]).collect();
    let faces = (0..4).map(|f| [3 * f, 3 * f + 1, 3 * f + 2]).collect();
    let image = textured().texture.unwrap().image;
    mesh.texture = Some(mesh_core::Texture { uvs, faces, image });
    let back = glb::decode(&glb::encode(&mesh).unwrap(), "a.glb").unwrap();
    assert_eq!(back.positions, mesh.positions);
    assert_eq!(back.faces, mesh.faces);
    assert_eq!(back.health().boundary_edges, 0);
}

/// A triangle with texture coordinates, and an image of four pixels in one row: black, red, green, blue.
struct Strip {
    bin: Vec<u8>,
    image: usize,
}

impl Strip {
    fn new(image: &[u8]) -> Self {
        let mut bin = Vec::new();
        for p in [[0.0_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] {
            bin.extend(p.iter().flat_map(|v| v.to_le_bytes()));
        }
        for uv in [[0.0_f32, 0.5], [0.5, 0.5], [0.0, 1.0]] {
            bin.extend(uv.iter().flat_map(|v| v.to_le_bytes()));
        }
        bin.extend(image);
        Self { bin, image: image.len() }
    }

    fn png() -> Vec<u8> {
        let data = vec![0, 0, 0, 255, 0, 0, 0, 255, 0, 0, 0, 255];
        mesh_core::encode_png(&mesh_core::ByteImage { height: 1, width: 4, channels: 3, data })
    }

    fn glb(&self, material: &str, image: &str, more: &str) -> Vec<u8> {
        let json = format!(
            r#"{{"asset":{{"version":"2.0"}}{more},"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":1}},"material":0}}]}}],
            "materials":[{material}],"textures":[{{"source":0}}],"images":[{image}],
            "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}},
              {{"bufferView":1,"componentType":5126,"count":3,"type":"VEC2"}}],
            "bufferViews":[{{"buffer":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":24}},
              {{"buffer":0,"byteOffset":60,"byteLength":{}}}],
            "buffers":[{{"byteLength":{}}}]}}"#,
            self.image,
            self.bin.len()
        );
        glb_of(&json, &self.bin)
    }
}

fn read_all(bytes: &[u8]) -> (TriMesh, Vec<String>) {
    let mut remarks = Vec::new();
    let mesh = glb::decode_with(bytes, "a.glb", &Limits::default(), &mut remarks).unwrap();
    mesh.validate().unwrap();
    (mesh, remarks.iter().map(ToString::to_string).collect())
}

/// By hand: scaled by (2, 1), turned by 90 degrees counter-clockwise where v goes down, moved by (0.25, 1).
#[test]
fn glb_texture_coordinates_are_transformed() {
    let strip = Strip::new(&Strip::png());
    let material = |transform: &str| {
        format!(
            r#"{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0,
            "extensions":{{"KHR_texture_transform":{transform}}}}}}}}}"#
        )
    };
    let transform = r#"{"offset":[0.25,1],"rotation":1.5707963267948966,"scale":[2,1]}"#;
    let needed = r#","extensionsRequired":["KHR_texture_transform"]"#;
    let image = r#"{"bufferView":2}"#;
    let (mesh, remarks) = read_all(&strip.glb(&material(transform), image, needed));
    let uvs = mesh.texture.unwrap().uvs;
    // (u, v) becomes (v + 0.25, 1 - 2 u) with v down, which is 2 u with v up.
    let flat = |uvs: &[[f32; 2]]| uvs.iter().map(|&[u, v]| [u, v, 0.0]).collect::<Vec<_>>();
    close(&flat(&uvs), &flat(&[[0.75, 0.0], [0.75, 1.0], [1.25, 0.0]]), 1e-6);
    assert!(remarks.is_empty(), "{remarks:?}");
    let (mesh, _) = read_all(&strip.glb(&material("{}"), image, ""));
    assert_eq!(mesh.texture.unwrap().uvs, [[0.0, 0.5], [0.5, 0.5], [0.0, 0.0]]);
    let (mesh, remarks) = read_all(&strip.glb(&material(r#"{"texCoord":1}"#), image, ""));
    assert!(mesh.texture.is_none() && remarks.len() == 1, "{remarks:?}");
    let huge = strip.glb(&material(r#"{"scale":[3e38,1],"offset":[3e38,0]}"#), image, "");
    assert!(glb::decode(&huge, "a.glb").unwrap_err().to_string().contains("texture_transform"));
}

#[test]
fn glb_images_of_other_kinds_are_left_out() {
    let material =
        r#"{"pbrMetallicRoughness":{"baseColorFactor":[1,0,0,1],"baseColorTexture":{"index":0}}}"#;
    let strip = Strip::new(b"RIFF\0\0\0\0WEBPVP8 ");
    let needed = r#","extensionsRequired":["EXT_texture_webp"]"#;
    let (mesh, remarks) = read_all(&strip.glb(material, r#"{"bufferView":2}"#, needed));
    assert_eq!(mesh.colors, Some(vec![[1.0, 0.0, 0.0]; 3]), "the material's colour is left");
    assert_eq!(remarks, ["\"image 0\" not read: neither PNG nor JPEG"]);
    for (uri, why) in [
        ("data:image/png;base64,AAAA", "\"image 0\" not read: neither PNG nor JPEG"),
        ("t.png", "\"t.png\" not read: no such file"),
    ] {
        let image = format!("{{\"uri\":\"{uri}\"}}");
        let (mesh, remarks) = read_all(&strip.glb(material, &image, ""));
        assert!(mesh.texture.is_none() && remarks == [why], "{remarks:?}");
    }
    // One beside the file is read, and one that is damaged is an error.
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("t.png"), Strip::png()).unwrap();
    let file = folder.path().join("a.glb");
    std::fs::write(&file, strip.glb(material, r#"{"uri":"t.png"}"#, "")).unwrap();
    assert_eq!(glb::read(&file).unwrap().texture.unwrap().image.width, 4);
    // So is one whose name is written as URIs are, and one that stands in the URI itself.
    std::fs::write(folder.path().join("t 1.png"), Strip::png()).unwrap();
    std::fs::write(&file, strip.glb(material, r#"{"uri":"t%201.png"}"#, "")).unwrap();
    assert!(glb::read(&file).unwrap().texture.is_some());
    let pixel = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg==";
    let image = format!("{{\"uri\":\"data:image/png;base64,{pixel}\"}}");
    let (mesh, remarks) = read_all(&strip.glb(material, &image, ""));
    assert!(mesh.texture.is_some() && remarks.is_empty(), "{remarks:?}");
    std::fs::write(&file, strip.glb(material, r#"{"uri":"%2e%2e/t.png"}"#, "")).unwrap();
    assert!(glb::read(&file).unwrap().texture.is_none(), "not outside the folder");
    let strip = Strip::new(&Strip::png()[..40]);
    assert!(glb::decode(&strip.glb(material, r#"{"bufferView":2}"#, ""), "a.glb").is_err());
}

#[test]
fn glb_diffuse_textures_of_older_programs_are_read() {
    let strip = Strip::new(&Strip::png());
    let old = |surface: &str| {
        format!(
            r#"{{{surface}"extensions":{{"KHR_materials_pbrSpecularGlossiness":
            {{"diffuseFactor":[1,0,1,1],"diffuseTexture":{{"index":0}}}}}}}}"#
        )
    };
    let image = r#"{"bufferView":2}"#;
    let (mesh, _) = read_all(&strip.glb(&old(""), image, ""));
    let texture = mesh.texture.unwrap();
    assert_eq!(texture.color([0.375, 0.5]), [1.0, 0.0, 0.0]);
    assert_eq!(texture.color([0.625, 0.5]), [0.0; 3], "green under a factor without");
    let both = old(r#""pbrMetallicRoughness":{"baseColorFactor":[0,1,0,1]},"#);
    let (mesh, _) = read_all(&strip.glb(&both, image, ""));
    assert_eq!(mesh.colors, Some(vec![[0.0, 1.0, 0.0]; 3]));
}

/// The second of three vertices stands elsewhere; without a bufferView the others are at the origin.
#[test]
fn glb_sparse_accessors_are_read() {
    let floats = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let mut bin = floats(&[0.0, 0.0, 1.0, 1.0, 0.0, 1.0, 0.0, 1.0, 1.0]);
    bin.extend(floats(&[5.0, 6.0, 7.0]));
    bin.extend([1, 0, 0, 0]);
    let json = |base: &str, count: u64, indices: &str| {
        format!(
            r#"{{"asset":{{"version":"2.0"}},"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],
            "accessors":[{{{base}"componentType":5126,"count":{count},"type":"VEC3",
              "sparse":{{"count":1,"indices":{indices},"values":{{"bufferView":1}}}}}}],
            "bufferViews":[{{"buffer":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":12}},
              {{"buffer":0,"byteOffset":48,"byteLength":4}}],
            "buffers":[{{"byteLength":52}}]}}"#
        )
    };
    let read = |base: &str, count: u64, indices: &str| {
        glb::decode(&glb_of(&json(base, count, indices), &bin), "a.glb")
    };
    let view = r#""bufferView":0,"#;
    let second = r#"{"bufferView":2,"componentType":5121}"#;
    let mesh = read(view, 3, second).unwrap();
    assert_eq!(mesh.positions, [[0.0, 0.0, 1.0], [5.0, 6.0, 7.0], [0.0, 1.0, 1.0]]);
    let mesh = read("", 3, second).unwrap();
    assert_eq!(mesh.positions, [[0.0; 3], [5.0, 6.0, 7.0], [0.0; 3]]);
    for (base, count, indices) in [
        (view, 1, second),
        ("", 4_000_000_000, second),
        (view, 3, r#"{"bufferView":2,"componentType":5126}"#),
        (view, 3, r#"{"bufferView":2,"componentType":5125,"byteOffset":1}"#),
        (view, 3, r#"{"bufferView":9,"componentType":5121}"#),
    ] {
        assert!(read(base, count, indices).is_err(), "{base} {count} {indices}");
    }
}
