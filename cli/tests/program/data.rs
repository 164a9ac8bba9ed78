//! `unsphere data`: inspect, validate, convert, from the command line.

use std::path::Path;

use crate::common::{TINY, clock_views, copied, files_in, unsphere};

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

    // A view may be left out by its name.
    let inspect = |except: &str| {
        unsphere(place.path(), ["data", "inspect", "e", "--except", except, "--json"])
    };
    assert_eq!(inspect("3,7").ok().json()["looked_at"][0]["views"], 8);
    inspect("3,77").fails(3, &["none called 77", "left out"]);

    // Nothing is written unless it is asked for.
    let before = files_in(place.path());
    let found = unsphere(place.path(), ["data", "inspect", "a", "--json"]).ok().json();
    assert!(found["output"].is_null() && found["looked_at"].is_array(), "{found}");
    unsphere(place.path(), ["data", "inspect", "a", "--force"]).fails(2, &["--force", "-o"]);
    assert_eq!(files_in(place.path()), before);
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

/// What is kept for tests stays so where the layout can say it, and is told where it cannot.
#[test]
fn views_that_are_kept_for_tests_are_not_lost_without_a_word() {
    let place = tempfile::tempdir().unwrap();
    as_transforms(place.path(), "nerf", |pose| pose);
    let path = place.path().join("nerf/transforms.json");
    let mut json: serde_json::Value =
        serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    json["test_filenames"] = serde_json::json!(["images/0002.png", "images/0007.png"]);
    std::fs::write(&path, json.to_string()).unwrap();
    let run = |to: &str, layout: &str| {
        let line = ["data", "convert", "nerf", to, "--layout", layout, "--json"];
        unsphere(place.path(), line).ok().json()["lost"].to_string()
    };
    assert_eq!(run("same", "transforms"), "[]");
    let options = datasets::ReadOptions::default();
    let views = datasets::read_views(&place.path().join("same"), &options, &|_, _| ()).unwrap();
    assert_eq!(views.test, [2, 7]);
    let lost = run("photos", "photos");
    assert!(lost.contains("kept for tests (2 views)"), "{lost}");
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
    run(["data", "inspect", "empty", "-o", "x"]).fails(3, &["no known layout", "empty folder"]);
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

/// The clock in NeRF's layout, whose poses are changed by `change`.
fn as_transforms(place: &Path, name: &str, change: impl Fn([[f64; 4]; 4]) -> [[f64; 4]; 4]) {
    clock_views(place);
    let arguments = ["data", "convert", "made/views", name, "--layout", "transforms"];
    unsphere(place, arguments).ok();
    let path = place.join(name).join("transforms.json");
    let mut json: serde_json::Value =
        serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    for frame in json["frames"].as_array_mut().unwrap() {
        let rows: [[f64; 4]; 4] =
            serde_json::from_value(frame["transform_matrix"].clone()).unwrap();
        frame["transform_matrix"] = serde_json::json!(change(rows));
    }
    std::fs::write(path, json.to_string()).unwrap();
}

fn extents(path: &Path) -> [f32; 3] {
    let (low, high) = mesh_core::read_mesh(path).unwrap().bounds().unwrap();
    std::array::from_fn(|k| high[k] - low[k])
}

#[test]
fn a_world_whose_z_is_up_stands_where_it_is_shown() {
    let place = tempfile::tempdir().unwrap();
    // What was up, y, becomes z.
    as_transforms(place.path(), "nerf", |[x, y, z, last]| [x, z.map(|v| -v), y, last]);
    let [a, b, c, d] = TINY;
    let run = unsphere(place.path(), ["fit", "nerf", "-o", "out", "--json", a, b, c, d]).ok();
    assert_eq!(run.json()["metrics"]["up"], "z");
    let [plain, upright] =
        ["mesh.ply", "mesh.glb"].map(|name| extents(&place.path().join("out").join(name)));
    for (k, from) in [0, 2, 1].into_iter().enumerate() {
        assert!((upright[k] - plain[from]).abs() < 1e-6, "{upright:?} of {plain:?}");
    }
    assert!((plain[1] - plain[2]).abs() > 0.05, "the clock is not as deep as it is high");
    let run = unsphere(place.path(), ["fit", "nerf", "-o", "y", "--up", "y", "--json", a, b, c, d]);
    assert_eq!(run.ok().json()["metrics"]["up"], "y");
    assert_eq!(
        extents(&place.path().join("y/mesh.glb")),
        extents(&place.path().join("y/mesh.ply"))
    );
    let wrong = ["fit", "nerf", "-o", "no", "--up", "-w"];
    unsphere(place.path(), wrong).fails(2, &["--up", "-z"]);
}

#[test]
fn poses_of_another_tool_are_explained_and_read() {
    let place = tempfile::tempdir().unwrap();
    let opencv = |row: [f64; 4]| [row[0], -row[1], -row[2], row[3]];
    as_transforms(place.path(), "cv", |[x, y, z, last]| [opencv(x), opencv(y), opencv(z), last]);
    let [a, b, c, d] = TINY;
    unsphere(place.path(), ["fit", "cv", "-o", "no", a, b, c, d]).fails(3, &["--axes opencv"]);
    // What was given and is wrong is not advised again.
    let wrong = ["fit", "made/views", "-o", "no", "--axes", "opencv", a, b, c, d];
    unsphere(place.path(), wrong).fails(3, &["--axes opengl", "leave --axes away"]);
    let told = ["fit", "cv", "-o", "out", "--axes", "opencv", "--json", a, b, c, d];
    let told = unsphere(place.path(), told).ok().json();
    let plain = unsphere(place.path(), ["fit", "made/views", "-o", "plain", "--json", a, b, c, d]);
    let iou = |json: &serde_json::Value| json["metrics"]["views"]["mask_iou"].as_f64().unwrap();
    assert!((iou(&told) - iou(&plain.ok().json())).abs() < 1e-3);
}

#[test]
fn other_views_score_a_fit_to_all() {
    let place = tempfile::tempdir().unwrap();
    clock_views(place.path());
    let [a, b, c, d] = TINY;
    let views = "made/views";
    let fit = |fitted: &str, out: &str| {
        unsphere(place.path(), ["fit", fitted, "--score", views, "-o", out, "--json", a, b, c, d])
    };
    // Where the mesh is made to agree, it is not scored.
    fit(views, "all").fails(3, &["made/views: the cameras of all its views are fitted"]);
    let few = copied(&place.path().join(views), &place.path().join("few"));
    for (view, part) in (6..10)
        .flat_map(|view| ["rgb.png", "metadata.json", "semantic.npy"].map(|part| (view, part)))
    {
        std::fs::remove_file(few.join(format!("{view}_{part}"))).unwrap();
    }
    let run = fit("few", "out").ok();
    assert!(run.stderr().contains("6 of 10 views have cameras that are fitted: left out"));
    let metrics = &run.json()["metrics"];
    assert_eq!(metrics["scored_on"], "held-out");
    assert_eq!(metrics["views"]["views"].as_array().unwrap().len(), 4);
    assert_eq!(metrics["evidence"]["fitted_views"], 6);
    assert_eq!(run.json()["peak_memory"].is_u64(), cfg!(target_os = "linux"));
    let none = ["fit", views, "--score", views, "-o", "no", "--set", "hold-out=none"];
    unsphere(place.path(), none).fails(2, &["--score", "hold-out"]);
}
