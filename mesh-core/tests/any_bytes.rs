//! Whatever the bytes: a mesh or an error, no panic, no hang, no memory that is not in the file.
#![allow(clippy::unwrap_used, reason = "tests")]

mod damage;
mod samples;

use damage::{change, damaged};
use mesh_core::io::{ReadMeshError, glb, obj, off, ply, stl, write_mesh};
use mesh_core::{Limits, TriMesh, read_mesh_with_uvs};
use proptest::prelude::*;

/// What the formats trip over.
const WORDS: &[&str] =
    &[" ", "\n", "-1", "99999999999", "nan", "1e39", "/", "list", "\\\n", "null", "[", "\0\0\0\0"];

/// What is read is a sound mesh that can be written again.
fn holds(result: Result<TriMesh, ReadMeshError>) {
    if let Ok(mesh) = result {
        mesh.validate().unwrap();
        glb::encode(&mesh).unwrap();
        ply::encode(&mesh, ply::Encoding::Ascii).unwrap();
    }
}

fn obj_bytes() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.obj");
    write_mesh(&path, &samples::textured()).unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    bytes.extend(b"v 1 2 3 0.5 0.25 1\nf -1 -2/-1 -3//4 1/2/3\nvn 0 0 1\n");
    bytes
}

const STRIPS: &[u8] =
    b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
    property float z\nelement tristrips 1\nproperty list int int vertex_indices\nend_header\n\
    0 0 0\n1 0 0\n0 1 0\n1 1 0\n9 0 1 2 3 -1 3 2 1 1\n";

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1500))]

    #[test]
    fn obj(changes in prop::collection::vec(change(WORDS), 0..5)) {
        holds(obj::decode(&damaged(obj_bytes(), &changes), "fuzz.obj"));
    }

    #[test]
    fn ply_ascii(changes in prop::collection::vec(change(WORDS), 0..5)) {
        let bytes = ply::encode(&samples::colored(), ply::Encoding::Ascii).unwrap();
        holds(ply::decode(&damaged(bytes, &changes), "fuzz.ply"));
    }

    #[test]
    fn ply_strips(changes in prop::collection::vec(change(WORDS), 0..5)) {
        holds(ply::decode(&damaged(STRIPS.to_vec(), &changes), "fuzz.ply"));
    }

    #[test]
    fn off(changes in prop::collection::vec(change(WORDS), 0..5)) {
        let text = b"COFF\n4 2 0\n0 0 0 1\n1 0 0 1\n1 1 0 0\n0 1 0 0\n4 0 1 2 3\n3 0 2 1\n";
        holds(off::decode(&damaged(text.to_vec(), &changes), "fuzz.off"));
    }

    #[test]
    fn stl(text: bool, changes in prop::collection::vec(change(WORDS), 0..5)) {
        let facet = b"solid a\nfacet\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";
        let bytes = if text { facet.to_vec() } else { stl::encode(&samples::colored()).unwrap() };
        holds(stl::decode(&damaged(bytes, &changes), "fuzz.stl"));
    }

    #[test]
    fn ply_binary(changes in prop::collection::vec(change(WORDS), 0..5)) {
        let bytes = ply::encode(&samples::colored(), ply::Encoding::Binary).unwrap();
        holds(ply::decode(&damaged(bytes, &changes), "fuzz.ply"));
    }

    #[test]
    fn glb(textured in any::<bool>(), changes in prop::collection::vec(change(WORDS), 0..5)) {
        let mesh = if textured { samples::textured() } else { samples::colored() };
        holds(glb::decode(&damaged(glb::encode(&mesh).unwrap(), &changes), "fuzz.glb"));
    }

    #[test]
    fn uvs_alone(format in 0..2_usize, changes in prop::collection::vec(change(WORDS), 0..5)) {
        let (name, bytes) = match format {
            0 => ("m.obj", obj_bytes()),
            _ => ("m.glb", glb::encode(&samples::textured()).unwrap()),
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, damaged(bytes, &changes)).unwrap();
        holds(read_mesh_with_uvs(&path, &Limits::default(), &mut Vec::new()));
    }

    #[test]
    fn noise(bytes in prop::collection::vec(any::<u8>(), 0..200), start in 0..4_usize) {
        let mut all = [&b""[..], b"ply\nformat ascii 1.0\n", b"glTF\x02\0\0\0", b"v 1 2 3\nf "][start].to_vec();
        all.extend(bytes);
        holds(obj::decode(&all, "fuzz"));
        holds(ply::decode(&all, "fuzz"));
        holds(glb::decode(&all, "fuzz"));
    }
}
