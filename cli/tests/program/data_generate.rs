//! `unsphere data generate`, as a user runs it.

use crate::common::{self, files_in, unsphere};

/// A small dataset, with what the last argument adds.
const SMALL: [&str; 9] =
    ["data", "generate", "--objects", "1", "--views", "2", "--size", "40x32", "-o"];

#[test]
fn a_dataset_is_made_once_and_others_are_refused() {
    let place = tempfile::tempdir().unwrap();
    let [a, b, c, d, e, f, g, h, i] = SMALL;
    let families = ["--families", "clock,table", "--json"];
    let [x, y, z] = families;
    let run = |seed: &str| {
        unsphere(place.path(), [a, b, c, d, e, f, g, h, i, "set", x, y, z, "--seed", seed])
    };
    let first = run("3").ok().json();
    assert_eq!((first["made"].as_u64(), first["views"].as_u64()), (Some(2), Some(4)));
    let files = files_in(&place.path().join("set"));
    let names = ["contact_sheet.png", "dataset.toml", "objects.json", "splits.json"];
    assert!(names.iter().all(|name| files.contains(&place.path().join("set").join(name))));
    let again = run("3").ok().json();
    assert_eq!((again["made"].as_u64(), again["skipped"].as_u64()), (Some(0), Some(2)));
    run("4").fails(2, &["dataset.toml", "seed = 3", "seed = 4"]);
    std::fs::create_dir(place.path().join("mine")).unwrap();
    std::fs::write(place.path().join("mine/note"), "x").unwrap();
    unsphere(place.path(), [a, b, c, d, e, f, g, h, i, "mine"]).fails(1, &["mine", "dataset.toml"]);
    unsphere(place.path(), [a, b, c, d, e, f, g, h, i, "new", "--set", "principal=[0.1,0]"])
        .fails(2, &["principal", "transforms"]);
    assert!(!place.path().join("new").exists());
}

#[test]
fn a_mesh_of_the_users_is_seen_and_can_be_fitted() {
    let place = tempfile::tempdir().unwrap();
    let mesh = mesh_core::primitives::cuboid([1.0, 2.0, 3.0]);
    mesh_core::write_mesh(place.path().join("block.ply"), &mesh).unwrap();
    let make = ["data", "generate", "--from", "block.ply", "--cameras", "sphere", "--views", "8"];
    let [a, b, c, d, e, f, g, h] = make;
    unsphere(place.path(), [a, b, c, d, e, f, g, h, "--size", "40", "-o", "set", "--quiet"]).ok();
    let [i, j, k, l] = common::TINY;
    unsphere(place.path(), ["fit", "set/block/0000", "-o", "fit", "--quiet", i, j, k, l]).ok();
    unsphere(place.path(), ["data", "generate", "--from", "none.obj", "-o", "x"])
        .fails(3, &["none.obj"]);
    assert!(!place.path().join("x").exists());
    // A cloud of points would be forty images of nothing.
    let cloud = mesh_core::TriMesh::new(mesh.positions, Vec::new());
    mesh_core::write_mesh(place.path().join("cloud.ply"), &cloud).unwrap();
    unsphere(place.path(), ["data", "generate", "--from", "cloud.ply", "-o", "x"])
        .fails(3, &["cloud.ply", "faces", "found none"]);
    assert!(!place.path().join("x").exists());
}

/// A folder of meshes becomes a dataset that is trained on: its kinds, what they are for, and what is left out is said.
#[test]
fn a_folder_of_meshes_becomes_a_dataset() {
    let place = tempfile::tempdir().unwrap();
    let mesh = mesh_core::primitives::cuboid([1.0, 2.0, 3.0]);
    for (kind, name) in [("chair", "a"), ("chair", "b"), ("dog", "rex"), ("dog", "sold")] {
        std::fs::create_dir_all(place.path().join("toys").join(kind)).unwrap();
        let file = place.path().join("toys").join(kind).join(format!("{name}.ply"));
        mesh_core::write_mesh(file, &mesh).unwrap();
    }
    std::fs::write(place.path().join("toys/chair/damaged.glb"), "none").unwrap();
    let list = "file,split\nchair/a.ply,train\nchair/b.ply,test\ndog/rex.ply,val\nchair/damaged.glb,train\nchairs/c.ply,val\n";
    std::fs::write(place.path().join("list.csv"), list).unwrap();
    let run = |line: &str| {
        let line = format!("data generate --from toys --views 2 --size 40 {line}");
        common::unsphere_with(place.path(), &line.split(' ').collect::<Vec<_>>())
    };
    let run = run("--splits list.csv --layout r2n2 --points 50 --voxels 0 -o set --json");
    let said = run.ok();
    assert_eq!(said.json()["objects"], 3);
    let told = said.stderr();
    assert!(told.contains("damaged.glb") && told.contains("1 mesh is left out"), "{told}");
    assert!(told.contains("1 row without a mesh") && told.contains("chairs/c.ply"), "{told}");
    let text = std::fs::read_to_string(place.path().join("set/splits.json")).unwrap();
    let splits: serde_json::Value = serde_json::from_str(&text).unwrap();
    let chair = synth::shapes::Family::Chair.synset();
    assert!(splits["train"][chair]["a"].is_array() && splits["test"][chair]["b"].is_array());
    assert_eq!(splits["val"].as_object().unwrap().len(), 1);
    let options = datasets::ReadOptions::default();
    let found = datasets::open_with(&place.path().join("set"), &options).unwrap();
    assert_eq!(found.entries().len(), 3);
    unsphere(
        place.path(),
        ["data", "generate", "--from", "list.csv", "--splits", "list.csv", "-o", "x"],
    )
    .fails(2, &["--splits"]);
    std::fs::create_dir(place.path().join("none")).unwrap();
    unsphere(place.path(), ["data", "generate", "--from", "none", "-o", "x"])
        .fails(3, &["none: meshes: found none"]);
}
