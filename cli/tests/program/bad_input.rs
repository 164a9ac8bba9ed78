//! Every kind of bad input: exit code 3, the file and the field named, nothing half-written.

use std::path::Path;

use crate::common::{clock_views, copied, files_in, unsphere};

/// The views, spoilt, are refused by `fit` and by `check --views`, which leave nothing behind.
fn refused(views: &Path, spoil: impl FnOnce(&Path), words: &[&str]) {
    let place = tempfile::tempdir().unwrap();
    let spoilt = copied(views, &place.path().join("spoilt"));
    spoil(&spoilt);
    let before = files_in(place.path());
    unsphere(place.path(), ["fit", "spoilt", "-o", "out"]).fails(3, words);
    unsphere(place.path(), ["check", "--views", "spoilt"]).fails(3, words);
    assert_eq!(files_in(place.path()), before);
    assert!(!place.path().join("out").exists());
}

fn edit(path: &Path, from: &str, to: &str) {
    let text = std::fs::read_to_string(path).unwrap();
    assert!(text.contains(from), "{from:?} is not in {text}");
    std::fs::write(path, text.replacen(from, to, 1)).unwrap();
}

fn npy(descr: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend_from_slice(&(header.len() as u16).to_le_bytes());
    bytes.extend_from_slice(header.as_bytes());
    bytes.extend_from_slice(data);
    bytes
}

#[test]
fn views_that_cannot_be_right_are_refused() {
    let place = tempfile::tempdir().unwrap();
    let views = clock_views(place.path());
    let remove = |name: &'static str| move |f: &Path| std::fs::remove_file(f.join(name)).unwrap();
    refused(&views, remove("3_rgb.png"), &["3_rgb.png", "missing", "--allow-missing"]);
    refused(&views, remove("3_metadata.json"), &["3_metadata.json", "missing"]);
    refused(&views, remove("3_semantic.npy"), &["3_semantic.npy", "missing"]);
    refused(
        &views,
        |f| std::fs::write(f.join("3_semantic.npy"), npy("|u1", "(8, 9)", &[1; 72])).unwrap(),
        &["3_semantic.npy", "mask shape", "(8, 9)", "[48, 48]"],
    );
    refused(
        &views,
        |f| {
            let path = f.join("3_rgb.png");
            let bytes = std::fs::read(&path).unwrap();
            std::fs::write(path, &bytes[..bytes.len() / 2]).unwrap();
        },
        &["3_rgb.png"],
    );
    refused(
        &views,
        |f| {
            let complex = npy("<c8", "(48, 48)", &vec![0; 18432]);
            std::fs::write(f.join("3_semantic.npy"), complex).unwrap();
        },
        &["3_semantic.npy", "mask descr", "<c8"],
    );
    refused(
        &views,
        |f| {
            let claim = npy("<i8", "(1048576, 1048576, 1)", &[0; 64]);
            std::fs::write(f.join("3_semantic.npy"), claim).unwrap();
        },
        &["3_semantic.npy", "mask shape", "1048576"],
    );
    refused(
        &views,
        |f| {
            let path = f.join("3_rgb.png");
            let mut bytes = std::fs::read(&path).unwrap();
            bytes[16..24].copy_from_slice(&[0x3f, 0xff, 0xff, 0xff, 0x3f, 0xff, 0xff, 0xff]);
            std::fs::write(path, bytes).unwrap();
        },
        &["3_rgb.png"],
    );
    refused(
        &views,
        |f| edit(&f.join("3_metadata.json"), "\"focal_length\":", "\"focal_length\":NaN,\"was\":"),
        &["3_metadata.json", "camera_properties.focal_length", "NaN"],
    );
    refused(
        &views,
        |f| {
            let singular = "\"tf_mat\":[[1,0,0,0],[1,0,0,0],[0,0,1,0],[0,0,-5,1]],\"was\":";
            edit(&f.join("3_metadata.json"), "\"tf_mat\":", singular);
        },
        &["3_metadata.json", "tf_mat", "singular"],
    );
    refused(
        &views,
        |f| {
            for i in 0..10 {
                let empty = npy("|u1", "(48, 48)", &vec![0; 48 * 48]);
                std::fs::write(f.join(format!("{i}_semantic.npy")), empty).unwrap();
            }
        },
        &["masks of all 10 views are empty", "--invert-masks"],
    );
    refused(
        &views,
        |f| {
            for i in 0..10 {
                // The translation's sign puts the object behind every camera.
                let path = f.join(format!("{i}_metadata.json"));
                let mut value: serde_json::Value =
                    serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
                let matrix = &mut value["camera_properties"]["tf_mat"];
                let depth = matrix[3][2].as_f64().unwrap();
                matrix[3][2] = serde_json::json!(-depth);
                std::fs::write(path, value.to_string()).unwrap();
            }
        },
        &["tf_mat", "cameras do not see"],
    );
}

#[test]
fn meshes_that_cannot_be_right_are_refused() {
    let place = tempfile::tempdir().unwrap();
    let put = |name: &str, text: &str| std::fs::write(place.path().join(name), text).unwrap();
    put("good.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n");
    put("range.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n");
    put("nan.obj", "v 0 0 0\nv 1 nan 0\nv 0 1 0\nf 1 2 3\n");
    let huge = "ply\nformat binary_little_endian 1.0\nelement vertex 900000000000\n\
                property float x\nproperty float y\nproperty float z\n\
                element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    put("huge.ply", huge);
    put("empty.obj", "");
    unsphere(place.path(), ["check", "good.obj"]).ok();
    for (name, word) in [("range.obj", "9"), ("nan.obj", "nan"), ("huge.ply", "vertex")] {
        unsphere(place.path(), ["check", name]).fails(3, &[name, word]);
        unsphere(place.path(), ["metrics", name, "good.obj"]).fails(3, &[name]);
        unsphere(place.path(), ["metrics", "good.obj", name]).fails(3, &[name]);
        unsphere(place.path(), ["render", name, "-o", "out.png"]).fails(3, &[name]);
    }
    unsphere(place.path(), ["metrics", "good.obj", "empty.obj"]).fails(3, &["empty.obj"]);
    unsphere(place.path(), ["render", "nowhere.glb", "-o", "x.gif"]).fails(3, &["nowhere.glb"]);
    unsphere(place.path(), ["check", "good.txt"]).fails(3, &["good.txt", ".obj"]);
    assert!(!place.path().join("out.png").exists());
}

#[test]
fn wrong_settings_are_refused() {
    let place = tempfile::tempdir().unwrap();
    let run = |arguments| unsphere::<5>(place.path(), arguments);
    std::fs::write(place.path().join("bad.toml"), "levle = 4\n").unwrap();
    std::fs::write(place.path().join("range.toml"), "level = 40\n").unwrap();
    run(["demo", "-o", "out", "--set", "levle=4"]).fails(2, &["levle"]);
    run(["demo", "-o", "out", "--set", "level=40"]).fails(2, &["level", "40"]);
    run(["demo", "-o", "out", "--config", "bad.toml"]).fails(3, &["bad.toml", "levle"]);
    run(["demo", "-o", "out", "--config", "range.toml"]).fails(3, &["range.toml", "level", "40"]);
    run(["demo", "-o", "out", "--config", "none.toml"]).fails(3, &["none.toml"]);
    run(["fit", "x", "--mask", "green", "-q"]).fails(2, &["--mask", "backdrop"]);
    assert!(!place.path().join("out").exists());
}
