//! Small files that ask for much: memory stays within the limits, and time in proportion.
#![allow(clippy::unwrap_used, reason = "tests")]

mod common;
mod counting;

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;
use std::time::{Duration, Instant};

use common::glb_of;
use counting::{alone, peak};
use mesh_core::io::{ReadMeshError, binvox, glb, obj, off, ply, stl};
use mesh_core::{
    ImageError, Limits, Remark, TriMesh, decode_depth, decode_image, decode_image_with, decode_pfm,
};

const MB: usize = 1_000_000;

/// What a test program holds beside the reader: messages, the harness's own lists.
const SLACK: usize = MB / 4;

fn quickly<T>(run: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let result = run();
    assert!(start.elapsed() < Duration::from_secs(20), "{:?}", start.elapsed());
    result
}

fn is_over_limit<T>(result: &Result<T, ReadMeshError>) -> bool {
    matches!(result, Err(ReadMeshError::OverLimit { .. }))
}

// ---------------------------------------------------------------- files that name files

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\n";

fn read_obj(folder: &Path, limits: &Limits) -> (TriMesh, Vec<Remark>) {
    let mut remarks = Vec::new();
    let mesh = obj::read_with(folder.join("m.obj"), limits, &mut remarks).unwrap();
    (mesh, remarks)
}

#[test]
fn a_library_that_is_named_two_thousand_times_is_read_once() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let mut library = String::new();
    while library.len() < 618_000 {
        write!(library, "newmtl m{}\nmap_Kd none.png\n", library.len()).unwrap();
    }
    std::fs::write(folder.path().join("m.mtl"), library).unwrap();
    // The same file under many names, too.
    let mut text = "mtllib m.mtl\n".repeat(1000);
    (0..1000).for_each(|k| writeln!(text, "mtllib {}m.mtl", "./".repeat(k % 50)).unwrap());
    std::fs::write(folder.path().join("m.obj"), text + TRIANGLE + "usemtl m0\nf 1/1 2/1 3/1\n")
        .unwrap();
    let (held, (mesh, remarks)) = peak(|| quickly(|| read_obj(folder.path(), &Limits::default())));
    assert!(held < 5 * MB, "{held} bytes");
    assert_eq!((mesh.faces.len(), remarks.len()), (1, 1), "{remarks:?}");
}

#[cfg(unix)]
#[test]
fn devices_and_pipes_are_not_opened() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("pipe.mtl");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let text = "mtllib /dev/zero\nmtllib pipe.mtl\nmtllib real.mtl\n";
    let text = format!("{text}{TRIANGLE}usemtl a\nf 1/1 2/1 3/1\n");
    std::fs::write(folder.path().join("m.obj"), text).unwrap();
    std::fs::write(folder.path().join("real.mtl"), "newmtl a\nmap_Kd /dev/zero\n").unwrap();
    for outside in [false, true] {
        let limits = Limits { outside_links: outside, ..Limits::default() };
        let (held, (mesh, remarks)) = peak(|| quickly(|| read_obj(folder.path(), &limits)));
        assert!(held < MB && mesh.texture.is_none(), "{held} bytes");
        let [Remark::NotRead { name, others: 2, .. }] = &remarks[..] else { panic!("{remarks:?}") };
        assert_eq!(name, "/dev/zero");
    }
    let mesh = folder.path().join("pipe.obj");
    assert!(std::process::Command::new("mkfifo").arg(&mesh).status().unwrap().success());
    let error = quickly(|| obj::read(&mesh)).unwrap_err().to_string();
    assert!(error.contains("pipe.obj") && error.contains("not a regular file"), "{error}");
}

#[test]
fn materials_by_the_hundred_thousand_are_looked_up_by_name() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let (mut text, mut library) = (format!("mtllib m.mtl\n{TRIANGLE}"), String::new());
    for k in 0..300_000 {
        write!(text, "usemtl a material with number {k}\nf 1 2 3\n").unwrap();
        write!(library, "newmtl a material with number {k}\nKd 1 1 1\n").unwrap();
    }
    std::fs::write(folder.path().join("m.obj"), text).unwrap();
    std::fs::write(folder.path().join("m.mtl"), library).unwrap();
    let (mesh, _) = quickly(|| read_obj(folder.path(), &Limits::default()));
    assert_eq!(mesh.faces.len(), 300_000);
}

// ---------------------------------------------------------------- GLB

fn instances(count: usize, vertices: usize) -> Vec<u8> {
    let nodes = "{\"mesh\":0},".repeat(count);
    let children: Vec<String> = (1..=count).map(|k| k.to_string()).collect();
    let json = format!(
        "{{\"asset\":{{\"version\":\"2.0\"}},\"scenes\":[{{\"nodes\":[0]}}],\"nodes\":[{{\"children\":[{}]}},\
         {}],\"meshes\":[{{\"primitives\":[{{\"attributes\":{{\"POSITION\":0}},\"mode\":5}}]}}],\
         \"accessors\":[{{\"bufferView\":0,\"componentType\":5126,\"count\":{vertices},\"type\":\"VEC3\"}}],\
         \"bufferViews\":[{{\"buffer\":0,\"byteLength\":{}}}],\"buffers\":[{{\"byteLength\":{}}}]}}",
        children.join(","),
        nodes.trim_end_matches(','),
        12 * vertices,
        12 * vertices,
    );
    glb_of(&json, &vec![0; 12 * vertices])
}

#[test]
fn a_mesh_that_is_shown_thousands_of_times_ends_at_the_limit() {
    let _alone = alone();
    let bytes = instances(4190, 12_000);
    assert!(bytes.len() < 230_000);
    let limit = Limits::default().peak(bytes.len() as u64) as usize;
    let (held, result) = peak(|| quickly(|| glb::decode(&bytes, "a.glb")));
    assert!(held <= limit, "{held} of {limit} bytes: {result:?}");
    assert!(is_over_limit(&result));
    let few = glb::decode(&instances(10, 12_000), "a.glb").unwrap();
    assert_eq!(few.positions.len(), 120_000);
}

#[test]
fn parts_that_show_nothing_end_too() {
    let _alone = alone();
    let list = |item: &str| vec![item; 100_000].join(",");
    let json = format!(
        "{{\"nodes\":[{}],\"meshes\":[{{\"primitives\":[{}]}}],\"accessors\":[{{}}]}}",
        list("{\"mesh\":0}"),
        list("{\"attributes\":{\"POSITION\":0},\"mode\":1}")
    );
    assert!(is_over_limit(&quickly(|| glb::decode(&glb_of(&json, &[]), "a.glb"))));
}

/// A million indices, each of which would be looked at for each of 200,000 clouds of points.
#[test]
fn indices_of_points_are_not_looked_at() {
    let _alone = alone();
    let list = |item: &str, count: usize| vec![item; count].join(",");
    let json = format!(
        "{{\"nodes\":[{}],\"meshes\":[{{\"primitives\":[{}]}}],\"accessors\":[\
         {{\"bufferView\":0,\"componentType\":5126,\"count\":0,\"type\":\"VEC3\"}},\
         {{\"bufferView\":1,\"componentType\":5121,\"count\":1000000,\"type\":\"SCALAR\",\"sparse\":\
         {{\"count\":1000000,\"indices\":{{\"bufferView\":0,\"componentType\":5125}},\"values\":{{\"bufferView\":1}}}}}}],\
         \"bufferViews\":[{{\"buffer\":0,\"byteLength\":4000000}},{{\"buffer\":0,\"byteLength\":1000000}}],\
         \"buffers\":[{{\"byteLength\":4000000}}]}}",
        list("{\"mesh\":0}", 2000),
        list("{\"attributes\":{\"POSITION\":0},\"indices\":1,\"mode\":0}", 100)
    );
    let indices: Vec<u8> = (0..1_000_000_u32).flat_map(u32::to_le_bytes).collect();
    let mesh = quickly(|| glb::decode(&glb_of(&json, &indices), "a.glb")).unwrap();
    assert!(mesh.faces.is_empty());
}

#[test]
fn empty_objects_of_json_are_counted() {
    let _alone = alone();
    let limits = Limits { base_bytes: MB as u64, ..Limits::default() };
    for (list, item) in [
        ("nodes", "{}"),
        ("accessors", "{}"),
        ("meshes", "{}"),
        ("extensionsRequired", "\"\""),
        ("materials", "{}"),
        ("scenes", "{}"),
    ] {
        let items = format!("{item},").repeat(700_000);
        let json = format!("{{\"{list}\":[{}]}}", items.trim_end_matches(','));
        let bytes = glb_of(&json, &[]);
        let limit = limits.peak(bytes.len() as u64) as usize;
        let (held, result) =
            peak(|| quickly(|| glb::decode_with(&bytes, "a.glb", &limits, &mut Vec::new())));
        assert!(held <= limit, "{list}: {held} of {limit} bytes");
        assert!(is_over_limit(&result), "{list}");
    }
}

#[test]
fn a_texture_of_gigabytes_is_refused_by_its_header() {
    let _alone = alone();
    let png = png(16_384, 16_384, [8, 2], &vec![0; 1_000_000], &[]);
    let json = format!(
        "{{\"asset\":{{\"version\":\"2.0\"}},\"scenes\":[{{\"nodes\":[0]}}],\"nodes\":[{{\"mesh\":0}}],\
         \"meshes\":[{{\"primitives\":[{{\"attributes\":{{\"POSITION\":0,\"TEXCOORD_0\":1}},\"material\":0}}]}}],\
         \"materials\":[{{\"pbrMetallicRoughness\":{{\"baseColorTexture\":{{\"index\":0}}}}}}],\
         \"textures\":[{{\"source\":0}}],\"images\":[{{\"bufferView\":1}}],\
         \"accessors\":[{{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}},\
         {{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC2\"}}],\
         \"bufferViews\":[{{\"buffer\":0,\"byteLength\":36}},{{\"buffer\":0,\"byteOffset\":36,\"byteLength\":{}}}],\
         \"buffers\":[{{\"byteLength\":{}}}]}}",
        png.len(),
        png.len() + 36,
    );
    let bytes = glb_of(&json, &[&[0; 36], &png[..]].concat());
    let (held, result) = peak(|| quickly(|| glb::decode(&bytes, "a.glb")));
    let Err(ReadMeshError::Texture { source: ImageError::OverLimit { width, .. }, .. }) = result
    else {
        panic!("{result:?}")
    };
    assert!(width == 16_384 && held < 10 * MB, "{held} bytes");
}

// ---------------------------------------------------------------- images

/// A PNG with these bits and this type of colour, this data, and chunks before it.
fn png(
    width: u32,
    height: u32,
    kind: [u8; 2],
    data: &[u8],
    before: &[(&[u8; 4], &[u8])],
) -> Vec<u8> {
    let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
    let mut chunk = |name: &[u8; 4], data: &[u8]| {
        bytes.extend((data.len() as u32).to_be_bytes());
        let body = [&name[..], data].concat();
        bytes.extend(&body);
        bytes.extend(crc32(&body).to_be_bytes());
    };
    let size = [width.to_be_bytes(), height.to_be_bytes()].concat();
    chunk(b"IHDR", &[&size[..], &kind, &[0, 0, 0]].concat());
    for (name, data) in before {
        chunk(name, data);
    }
    chunk(b"IDAT", data);
    chunk(b"IEND", &[]);
    bytes
}

fn crc32(bytes: &[u8]) -> u32 {
    let mut crc = flate2::Crc::new();
    crc.update(bytes);
    crc.sum()
}

/// `count` zeros, deflated a thousandfold.
fn zeros(count: usize) -> Vec<u8> {
    let mut packer = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    let block = vec![0; 1 << 16];
    let mut left = count;
    while left > 0 {
        let part = left.min(block.len());
        packer.write_all(&block[..part]).unwrap();
        left -= part;
    }
    packer.finish().unwrap()
}

#[test]
fn a_profile_that_unpacks_to_hundreds_of_megabytes_is_passed_over() {
    let _alone = alone();
    let profile = [b"bomb\0\0", &zeros(300_000_000)[..]].concat();
    let bytes = png(1, 1, [8, 0], &zeros(2), &[(b"iCCP", &profile)]);
    assert!(bytes.len() < 400_000);
    let (held, image) = peak(|| quickly(|| decode_image(&bytes, "a.png")));
    assert!(held < 40 * MB, "{held} bytes");
    assert_eq!(image.unwrap().data, [0]);
}

#[test]
fn pictures_are_refused_by_their_header() {
    let _alone = alone();
    let data = vec![0; 1_100_000];
    for (width, height, kind) in [
        (16_384, 16_384, [8, 6]),  // a gigabyte
        (12_000, 11_000, [1, 0]),  // 132 million pixels, of a bit each
        (11_000, 11_000, [16, 6]), // 121 million, of 8 bytes each
        (1 << 30, 1, [8, 0]),
    ] {
        let bytes = png(width, height, kind, &data, &[]);
        let (held, result) = peak(|| quickly(|| decode_image(&bytes, "a.png")));
        let Err(ImageError::OverLimit { max_pixels: 128_000_000, .. }) = result else {
            panic!("{width} x {height}: {:?}", result.map(|image| image.data.len()))
        };
        assert!(held < 40 * MB, "{held} bytes");
    }
    // The caller's own limits hold as well, and what is within them is read.
    let bytes = png(2000, 1000, [16, 2], &zeros(1000 * 12_001), &[]);
    let limits = Limits { max_pixels: 1_999_999, ..Limits::default() };
    assert!(matches!(decode_image_with(&bytes, "a", &limits), Err(ImageError::OverLimit { .. })));
    let limits = Limits { max_pixels: 3_000_000, ..limits };
    let (held, image) = peak(|| decode_image_with(&bytes, "a", &limits).unwrap());
    assert_eq!(image.data.len(), 6_000_000);
    // The 12 MB that are unpacked, the 6 MB that stay of them, and the decoder's own.
    assert!(held < 26 * MB, "{held} bytes");
}

#[test]
fn a_jpeg_with_a_thousand_scans_is_refused() {
    let _alone = alone();
    let mut bytes = b"\xff\xd8\xff\xe0\0\x10JFIF\0\x01\x01\0\0\x01\0\x01\0\0".to_vec();
    bytes.extend(b"\xff\xc2\0\x0b\x08\x10\x00\x10\x00\x01\x01\x11\0");
    (0..1000).for_each(|_| bytes.extend(b"\xff\xda\0\x08\x01\x01\0\0\0\0"));
    let error = quickly(|| decode_image(&bytes, "a.jpg")).unwrap_err().to_string();
    assert!(error.contains("more than 256 scans"), "{error}");
}

#[test]
fn depth_maps_are_refused_by_their_header() {
    let _alone = alone();
    let map = mesh_core::DepthMap { height: 2, width: 2, data: vec![1.0; 4] };
    let mut bytes = mesh_core::encode_depth(&map);
    for name in [&b"dataWindow\0box2i\0"[..], b"displayWindow\0box2i\0"] {
        let at = bytes.windows(name.len()).position(|w| w == name).unwrap() + name.len() + 12;
        bytes[at..at + 8].copy_from_slice(&[0xff, 0x7f, 0, 0, 0xff, 0x7f, 0, 0]);
    }
    let (held, result) = peak(|| quickly(|| decode_depth(&bytes, "a.exr").map(|m| m.data.len())));
    assert!(result.is_err() && held < 10 * MB, "{result:?} {held}");
    let pfm = b"Pf\n30000 30000\n-1\n....";
    assert!(decode_pfm(pfm, "a.pfm").is_err());
}

// ---------------------------------------------------------------- every format

/// Files of about 2 MB that become as much as their format allows.
fn dense() -> Vec<(&'static str, Vec<u8>)> {
    let repeated = |head: &str, part: &str, tail: &str| {
        format!("{head}{}{tail}", part.repeat(2_000_000 / part.len())).into_bytes()
    };
    let ply = |format: &str, element: &str| {
        format!(
            "ply\nformat {format} 1.0\nelement vertex 3\nproperty char x\nproperty char y\n\
            property char z\n{element}end_header\n"
        )
    };
    let with = |head: String, data: Vec<u8>| {
        [head.as_bytes(), &[0, 0, 0, 1, 0, 0, 0, 1, 0], &data].concat()
    };
    let polygons: Vec<u8> = [&[255_u8][..], &[0, 1, 2].repeat(85)].concat().repeat(8000);
    let one = [&2_000_000_u32.to_le_bytes()[..], &[0, 1, 2].repeat(666_667)[..2_000_000]].concat();
    let binary = "binary_little_endian";
    let vertices = format!(
        "ply\nformat {binary} 1.0\nelement vertex 333333\nproperty uchar x\nproperty uchar y\n\
        property uchar z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
    );
    vec![
        ("obj", repeated("", "v 0 0 0\n", "")),
        ("obj", repeated("v 0 0 0\n", "v 0 0 0 1 1 1\n", "")),
        ("obj", repeated("", "vt 0\n", "")),
        ("obj", repeated("v 0 0 0\nv 1 0 0\nv 0 1 0\n", "f 1 2 3\n", "")),
        ("obj", repeated("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1", " 2 3", "\n")),
        ("obj", repeated("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1", " 2 3", "\n")),
        ("obj", repeated("", "f 1 2 3\n", "v 0 0 0\nv 1 0 0\nv 0 1 0\n")),
        ("obj", repeated("", "usemtl\n", "")),
        ("obj", (0..150_000).flat_map(|k| format!("usemtl {k}\n").into_bytes()).collect()),
        ("obj", (0..150_000).flat_map(|k| format!("mtllib {k}\n").into_bytes()).collect()),
        ("obj", repeated("", "v 0 \\\n", "")),
        ("obj", b"usemtl \xff".iter().copied().chain(vec![0xff; 2_000_000]).collect()),
        ("off", repeated("OFF 250000 0\n", "0 0 0 1\n", "")),
        ("off", repeated("OFF 3 1\n0 0 0\n1 0 0\n0 1 0\n1000000", " 1 2", "")),
        ("stl", repeated("solid\n", "vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n", "")),
        ("stl", repeated("solid\n", "\u{fffd}\n", "")),
        ("stl", b"solid\n".iter().copied().chain(vec![0xff; 2_000_000]).collect()),
        ("stl", distinct_triangles(40_000)),
        (
            "ply",
            with(
                ply(binary, "element face 8000\nproperty list uchar uchar vertex_index\n"),
                polygons,
            ),
        ),
        (
            "ply",
            with(
                ply(binary, "element face 1\nproperty list uint uchar vertex_index\n"),
                one.clone(),
            ),
        ),
        (
            "ply",
            with(
                ply(binary, "element tristrips 1\nproperty list uint char vertex_index\n"),
                one.clone(),
            ),
        ),
        ("ply", with(ply(binary, "element other 1\nproperty list uint uchar w\n"), one)),
        ("ply", [vertices.as_bytes(), &vec![7; 2_000_000]].concat()),
        ("ply", repeated("ply\nformat ascii 1.0\n", "element a 0\nproperty int a\n", "")),
        (
            "ply",
            (0..80_000)
                .flat_map(|k| {
                    format!(
                        "{}element e{k} 1\nproperty int x\n",
                        if k == 0 { "ply\nformat ascii 1.0\n" } else { "" }
                    )
                    .into_bytes()
                })
                .collect(),
        ),
        ("ply", repeated("ply\nformat ascii 1.0\nproperty", " a", "")),
        ("ply", repeated("ply\nformat ascii 1.0\ncomment", " \u{fffd}", "")),
        ("glb", instances(150_000, 3)),
        ("glb", instances(2, 80_000)),
        (
            "binvox",
            [&b"#binvox 1\ndim 512 512 512\ndata\n"[..], &[0, 255].repeat(526_345)].concat(),
        ),
        ("binvox", repeated("#binvox 1\n", "a ", "")),
    ]
}

/// A binary STL file of which no two corners are at the same place.
fn distinct_triangles(count: u32) -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend_from_slice(&count.to_le_bytes());
    for triangle in 0..count {
        bytes.extend_from_slice(&[0; 12]);
        (0..9).for_each(|k| {
            bytes.extend_from_slice(&(9.0 * triangle as f32 + k as f32).to_le_bytes());
        });
        bytes.extend_from_slice(&[0; 2]);
    }
    bytes
}

fn decode(format: &str, bytes: &[u8], limits: &Limits) -> Result<usize, ReadMeshError> {
    let mut remarks = Vec::new();
    let faces = |mesh: TriMesh| mesh.faces.len();
    match format {
        "obj" => obj::decode_with(bytes, "a", limits, &mut remarks).map(faces),
        "off" => off::decode_with(bytes, "a", limits, &mut remarks).map(faces),
        "ply" => ply::decode_with(bytes, "a", limits, &mut remarks).map(faces),
        "glb" => glb::decode_with(bytes, "a", limits, &mut remarks).map(faces),
        "stl" => stl::decode_with(bytes, "a", limits, &mut remarks).map(faces),
        _ => binvox::decode_with(bytes, "a", limits).map(|grid| grid.count()),
    }
}

#[test]
fn every_reader_of_meshes_stays_within_any_limits() {
    let _alone = alone();
    for (k, (format, bytes)) in dense().into_iter().enumerate() {
        for (base, per_byte) in [(256 * MB, 20), (MB, 20), (0, 20), (0, 5), (0, 0)] {
            let limits =
                Limits { base_bytes: base as u64, bytes_per_byte: per_byte, ..Limits::default() };
            let limit = limits.peak(bytes.len() as u64) as usize;
            let (held, result) = peak(|| quickly(|| decode(format, &bytes, &limits)));
            let what = format!("file {k} ({format}, {} bytes): {result:?}", bytes.len());
            assert!(held <= limit + SLACK, "{what}: {held} of {limit} bytes");
        }
    }
}

#[test]
fn a_table_that_has_just_grown_is_counted() {
    let _alone = alone();
    // 114,690 vertices are two more than seven eighths of 2^17.
    let bytes = distinct_triangles(38_230);
    for base in (6 * MB..12 * MB).step_by(MB / 4) {
        let limits = Limits { base_bytes: base as u64, bytes_per_byte: 0, ..Limits::default() };
        let (held, result) = peak(|| decode("stl", &bytes, &limits));
        assert!(held <= base + SLACK, "{held} of {base} bytes: {result:?}");
    }
}

#[test]
fn a_face_of_nine_million_corners_is_a_fan() {
    let _alone = alone();
    let head = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1";
    let text = format!("{head}{}\n", " 2 3 4".repeat(3_000_000));
    let limit = Limits::default().peak(text.len() as u64) as usize;
    let (held, mesh) = peak(|| quickly(|| obj::decode(text.as_bytes(), "a.obj").unwrap()));
    assert_eq!(mesh.faces.len(), 8_999_999);
    assert!(held < limit, "{held} of {limit} bytes");
}
