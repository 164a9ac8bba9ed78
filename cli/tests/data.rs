//! `unsphere data`: inspect, validate, convert, from the command line.
#![allow(clippy::unwrap_used, reason = "tests")]

mod common;

use common::{clock_views, copied, files_in, unsphere};

#[test]
fn datasets_are_converted_inspected_and_validated() {
    let place = tempfile::tempdir().unwrap();
    clock_views(place.path());
    let run = |arguments| unsphere::<7>(place.path(), arguments);
    // Around through every layout that can say these cameras.
    let views = "made/views";
    run(["data", "convert", views, "a", "--layout", "colmap", "--json"]).ok();
    run(["data", "convert", "a", "b", "--layout", "photos", "--json"]).ok();
    run(["data", "convert", "b", "c", "--layout", "colmap-text", "--json"]).ok();
    run(["data", "convert", "c", "d", "--layout", "transforms", "--json"]).ok();
    let last = run(["data", "convert", "d", "e", "--layout", "kaolin", "--json"]).ok().json();
    assert_eq!((&last["objects"], &last["views"]), (&1.into(), &10.into()));
    for i in 0..10 {
        for end in ["rgb.png", "semantic.npy"] {
            let file = |folder: &str| place.path().join(format!("{folder}/{i}_{end}"));
            assert_eq!(std::fs::read(file("e")).unwrap(), std::fs::read(file(views)).unwrap());
        }
    }
    run(["data", "convert", "d", "e", "--layout", "kaolin", "-q"]).fails(1, &["e exists already"]);

    let found =
        unsphere(place.path(), ["data", "inspect", "a", "-o", "look", "--json"]).ok().json();
    assert_eq!(found["layout"], "COLMAP model");
    assert_eq!(found["looked_at"][0]["problems"], serde_json::json!([]), "{found}");
    assert!(found["looked_at"][0]["agreement"]["hull_iou"].as_f64().unwrap() > 0.9);
    for name in ["report.html", "inspection.json", "a_views.png", "a_cameras.svg"] {
        assert!(place.path().join("look").join(name).exists(), "{name}");
    }

    unsphere(place.path(), ["data", "validate", "e"]).ok();
    // Three faults in three files: each is listed.
    let spoilt = copied(&place.path().join("e"), &place.path().join("spoilt"));
    std::fs::write(spoilt.join("2_rgb.png"), "no picture").unwrap();
    std::fs::remove_file(spoilt.join("5_metadata.json")).unwrap();
    let path = spoilt.join("7_metadata.json");
    let text = std::fs::read_to_string(&path).unwrap().replace("\"focal_length\":", "\"focal\":");
    std::fs::write(path, text).unwrap();
    let before = files_in(place.path());
    let run = unsphere(place.path(), ["data", "validate", "spoilt", "--json"]);
    assert_eq!(run.code(), Some(3), "{}", run.stderr());
    let found = run.json();
    let text = found["faults"].to_string();
    for word in ["2_rgb.png", "5_metadata.json", "camera_properties.focal_length"] {
        assert!(text.contains(word), "{text}");
    }
    assert_eq!((&found["views"], found["faults"].as_array().unwrap().len()), (&7.into(), 3));
    assert_eq!(files_in(place.path()), before);
}

/// World-to-camera matrices given for camera-to-world ones: on an orbit all cameras then stand at one point.
#[test]
fn cameras_at_one_point_are_an_error_that_says_why() {
    let place = tempfile::tempdir().unwrap();
    let orbit = synth::Orbit {
        count: 10,
        width: 32,
        height: 32,
        distance: [3.0, 3.0],
        target: [0.0; 3],
        ..Default::default()
    };
    let mesh = mesh_core::primitives::icosphere(2);
    let mut views =
        synth::render_views(&mesh, &orbit.cameras(), &synth::RenderOptions::default(), &|_, _| ())
            .unwrap();
    for view in &mut views {
        let turned = view.camera.rotation.transpose();
        view.camera.translation = -(turned * view.camera.translation);
        view.camera.rotation = turned;
    }
    datasets::write_transforms(&views, &place.path().join("scan")).unwrap();
    let words = ["scan", "stand at one point", "the poses look inverted"];
    unsphere(place.path(), ["data", "inspect", "scan", "-o", "look"]).fails(3, &words);
    assert!(!place.path().join("look").exists());
}

#[test]
fn what_cannot_be_is_refused() {
    let place = tempfile::tempdir().unwrap();
    std::fs::create_dir(place.path().join("empty")).unwrap();
    let run = |arguments| unsphere::<5>(place.path(), arguments);
    run(["data", "inspect", "empty", "-o", "x"]).fails(3, &["no known layout", "COLMAP", "BOP"]);
    run(["data", "convert", "nowhere", "x", "--layout=photos"]).fails(3, &["nowhere"]);
    run(["data", "convert", "empty", "x", "--layout=blender"]).fails(2, &["--layout", "colmap"]);
    run(["data", "inspect", "empty", "--turntable", "9"]).fails(2, &["--fov"]);
    assert!(!place.path().join("x").exists());
}

/// Without the feature the verb is there, and says what is missing; with it the model is at fault.
#[test]
fn depth_needs_a_model_and_the_feature() {
    let place = tempfile::tempdir().unwrap();
    std::fs::write(place.path().join("no.onnx"), "no model").unwrap();
    let run =
        unsphere(place.path(), ["data", "depth", "a.png", "--model", "no.onnx", "-o", "out", "-q"]);
    if cfg!(feature = "onnx") {
        run.fails(3, &["no.onnx", "is not an ONNX model"]);
    } else {
        run.fails(2, &["no.onnx", "--features onnx"]);
    }
    assert!(!place.path().join("out").exists());
}
