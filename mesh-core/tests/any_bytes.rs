//! Whatever the bytes: a mesh or an error, no panic, no hang, no memory that is not in the file.
#![allow(clippy::unwrap_used, reason = "tests")]

mod samples;

use mesh_core::TriMesh;
use mesh_core::io::{ReadMeshError, glb, obj, off, ply, write_mesh};
use proptest::prelude::*;
use proptest::sample::Index;

#[derive(Clone, Debug)]
enum Change {
    Set(Index, u8),
    Insert(Index, Vec<u8>),
    Remove(Index, usize),
    Cut(Index),
    /// Replaces a decimal digit: counts, indices and offsets of text headers.
    Digit(Index, u8),
}

fn change() -> impl Strategy<Value = Change> {
    let at = any::<Index>;
    let words: Vec<Vec<u8>> = [
        " ",
        "\n",
        "-1",
        "99999999999",
        "nan",
        "1e39",
        "/",
        "list",
        "\\\n",
        "null",
        "[",
        "\0\0\0\0",
    ]
    .map(|s| s.as_bytes().to_vec())
    .to_vec();
    prop_oneof![
        (at(), any::<u8>()).prop_map(|(i, v)| Change::Set(i, v)),
        (at(), prop::sample::select(words)).prop_map(|(i, v)| Change::Insert(i, v)),
        (at(), 1..9_usize).prop_map(|(i, n)| Change::Remove(i, n)),
        at().prop_map(Change::Cut),
        (at(), b'0'..=b'9').prop_map(|(i, v)| Change::Digit(i, v)),
        (at(), b'0'..=b'9').prop_map(|(i, v)| Change::Digit(i, v)),
    ]
}

fn damaged(mut bytes: Vec<u8>, changes: &[Change]) -> Vec<u8> {
    for change in changes {
        if bytes.is_empty() {
            break;
        }
        let n = bytes.len();
        match change {
            Change::Set(i, v) => bytes[i.index(n)] = *v,
            Change::Insert(i, v) => {
                let i = i.index(n);
                bytes.splice(i..i, v.iter().copied());
            }
            Change::Remove(i, k) => {
                let i = i.index(n);
                bytes.drain(i..(i + k).min(n));
            }
            Change::Cut(i) => bytes.truncate(i.index(n)),
            Change::Digit(i, v) => {
                let digits: Vec<usize> = (0..n).filter(|&k| bytes[k].is_ascii_digit()).collect();
                if !digits.is_empty() {
                    bytes[digits[i.index(digits.len())]] = *v;
                }
            }
        }
    }
    bytes
}

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
    fn obj(changes in prop::collection::vec(change(), 0..5)) {
        holds(obj::decode(&damaged(obj_bytes(), &changes), "fuzz.obj"));
    }

    #[test]
    fn ply_ascii(changes in prop::collection::vec(change(), 0..5)) {
        let bytes = ply::encode(&samples::colored(), ply::Encoding::Ascii).unwrap();
        holds(ply::decode(&damaged(bytes, &changes), "fuzz.ply"));
    }

    #[test]
    fn ply_strips(changes in prop::collection::vec(change(), 0..5)) {
        holds(ply::decode(&damaged(STRIPS.to_vec(), &changes), "fuzz.ply"));
    }

    #[test]
    fn off(changes in prop::collection::vec(change(), 0..5)) {
        let text = b"COFF\n4 2 0\n0 0 0 1\n1 0 0 1\n1 1 0 0\n0 1 0 0\n4 0 1 2 3\n3 0 2 1\n";
        holds(off::decode(&damaged(text.to_vec(), &changes), "fuzz.off"));
    }

    #[test]
    fn ply_binary(changes in prop::collection::vec(change(), 0..5)) {
        let bytes = ply::encode(&samples::colored(), ply::Encoding::Binary).unwrap();
        holds(ply::decode(&damaged(bytes, &changes), "fuzz.ply"));
    }

    #[test]
    fn glb(textured in any::<bool>(), changes in prop::collection::vec(change(), 0..5)) {
        let mesh = if textured { samples::textured() } else { samples::colored() };
        holds(glb::decode(&damaged(glb::encode(&mesh).unwrap(), &changes), "fuzz.glb"));
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
