//! Mesh files as people have them, from the command line.
#![allow(clippy::unwrap_used, reason = "tests")]

mod common;

use common::{unsphere, unsphere_with};
use mesh_core::{TriMesh, primitives, read_mesh, write_mesh};

#[test]
fn what_a_mesh_does_not_hold_of_its_file_is_said_in_a_line() {
    let place = tempfile::tempdir().unwrap();
    let solid = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";
    std::fs::write(place.path().join("desk.obj"), format!("{solid}f 1 2\nf 2 3\n")).unwrap();
    let run = unsphere(place.path(), ["check", "desk.obj"]).ok();
    let said = run.stderr();
    let expected = "desk.obj: 2 faces of fewer than three corners left out (the first in line 9)";
    assert_eq!(said.matches(expected).count(), 1, "{said}");
    let run = unsphere(place.path(), ["check", "desk.obj", "--quiet"]).ok();
    assert!(!run.stderr().contains("left out"));
}

#[test]
fn meshes_are_converted() {
    let place = tempfile::tempdir().unwrap();
    let path = |name: &str| place.path().join(name);
    let ball = primitives::icosphere(4).scaled([1.0, 2.0, 3.0]);
    let colors = ball.positions.iter().map(|p| p.map(|x| 0.5 + 0.1 * x)).collect();
    write_mesh(path("egg.ply"), &TriMesh { colors: Some(colors), ..ball.clone() }).unwrap();
    let run = |line: &str| unsphere_with(place.path(), &line.split(' ').collect::<Vec<_>>());
    let size = |mesh: &TriMesh| {
        let (low, high) = mesh.bounds().unwrap();
        [0, 1, 2].map(|k| high[k] - low[k])
    };
    let close = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-3 * b);

    // For a printer: up is +Z, and what was 4 high is 80 millimetres.
    let out = run("convert egg.ply -o egg.stl --height 8cm").ok();
    assert!(out.stderr().contains("no colours") && out.stdout().contains("millimetres, +Z is up"));
    let printed = read_mesh(path("egg.stl")).unwrap();
    assert!(close(size(&printed), [40.0, 120.0, 80.0]), "{:?}", size(&printed));
    assert!(printed.health().is_watertight());
    assert_eq!(printed.faces.len(), ball.faces.len());
    run("convert egg.ply -o egg.stl").fails(1, &["exists already", "--force"]);
    run("convert egg.ply -o egg.stl --up y --force").ok();
    assert!(close(size(&read_mesh(path("egg.stl")).unwrap()), [2.0, 4.0, 6.0]));

    // Fewer triangles, metres, and the colours.
    let out = run("convert egg.ply -o egg.glb --faces 500 --height 100mm --json").ok();
    assert_eq!(
        (out.json()["faces"].as_u64(), out.json()["unit"].as_str()),
        (Some(500), Some("metres"))
    );
    let small = read_mesh(path("egg.glb")).unwrap();
    assert!((size(&small)[1] - 0.1).abs() < 0.002 && small.health().is_watertight());
    assert!(small.colors.is_some());
    run("convert egg.stl -o back.obj --scale 10").ok();
    assert!(close(size(&read_mesh(path("back.obj")).unwrap()), [20.0, 40.0, 60.0]));

    std::fs::write(
        path("open.obj"),
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\nf 1 2 4\nf 1 3 4\nf 1 2 3\n",
    )
    .unwrap();
    run("convert open.obj -o a.stl --faces 4").fails(3, &["open.obj", "--faces"]);
    run("convert egg.ply -o a.3mf").fails(2, &[".stl"]);
    run("convert egg.ply -o a.stl --height 80").fails(2, &["80mm"]);
    run("convert egg.ply -o a.stl --height 1mm --scale 2").fails(2, &["--scale"]);
    std::fs::write(path("none.ply"), "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\nelement face 0\nproperty list uchar int vertex_indices\nend_header\n").unwrap();
    run("convert none.ply -o a.stl").fails(3, &["none.ply", "no faces"]);
}
