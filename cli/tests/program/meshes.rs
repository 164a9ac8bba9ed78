//! Mesh files as people have them, from the command line.

use crate::common::{unsphere, unsphere_with};
use mesh_core::{Image, Texture, TriMesh, primitives, read_mesh, write_mesh};

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
fn parts_that_overlap_become_one_solid() {
    let place = tempfile::tempdir().unwrap();
    let mut parts = primitives::icosphere(3).colored([0.2, 0.4, 0.8]);
    parts.append(&primitives::cuboid([3.0, 0.5, 0.5]).colored([0.9, 0.1, 0.1])).unwrap();
    write_mesh(place.path().join("parts.ply"), &parts).unwrap();
    unsphere(place.path(), ["convert", "parts.ply", "-o", "part.ply", "--solid"]).ok();
    let part = read_mesh(place.path().join("part.ply")).unwrap();
    let found = part.examined();
    assert!(found.is_solid() && found.health.components == 1, "{found}");
    assert!(part.colors.is_some_and(|colors| colors.iter().any(|c| c[0] > 0.8)));
    let mut open = primitives::icosphere(2);
    open.faces.pop();
    write_mesh(place.path().join("open.ply"), &open).unwrap();
    let run = unsphere(place.path(), ["convert", "open.ply", "-o", "x.ply", "--solid"]);
    run.fails(3, &["open.ply", "--solid", "not closed"]);
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
    run("convert egg.stl -o back.obj --scale 10 --input-up y").ok();
    assert!(close(size(&read_mesh(path("back.obj")).unwrap()), [20.0, 40.0, 60.0]));

    std::fs::write(
        path("open.obj"),
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\nf 1 2 4\nf 1 3 4\nf 1 2 3\n",
    )
    .unwrap();
    run("convert open.obj -o a.stl --faces 4").fails(3, &["open.obj", "--faces"]);
    run("convert egg.ply -o a.dae").fails(2, &[".stl"]);
    // The other format of printers has the colours, and is not read.
    let out = run("convert egg.ply -o egg.3mf --height 8cm --faces 500").ok();
    assert!(out.stdout().contains("80.0000 millimetres, +Z is up"), "{}", out.stdout());
    assert!(std::fs::read(path("egg.3mf")).unwrap().starts_with(b"PK"));
    run("convert egg.3mf -o a.stl").fails(3, &["3mf"]);
    run("convert egg.ply -o a.stl --height 80").fails(2, &["80mm"]);
    run("convert egg.ply -o a.stl --height 1mm --scale 2").fails(2, &["--scale"]);
    for size in ["--scale 1e-60", "--scale 1e39", "--height 1e-60mm", "--height 1e39m"] {
        run(&format!("convert egg.ply -o a.stl {size}")).fails(2, &[&size[..8]]);
    }
    run("convert egg.ply -o a.stl --scale 1e38").fails(2, &["--scale", "single precision"]);
    run("convert egg.ply -o tiny.stl --scale 1e-37").ok();
    run("convert egg.stl -o least.stl --scale 2e-38").ok();
    run("convert least.stl -o b.stl --scale 0.01").fails(2, &["--scale", "single precision"]);
    assert!(!path("b.stl").exists());
    std::fs::write(path("none.ply"), "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\nelement face 0\nproperty list uchar int vertex_indices\nend_header\n").unwrap();
    run("convert none.ply -o a.stl").fails(3, &["none.ply", "no faces"]);
}

fn sides(mesh: &TriMesh) -> [f32; 3] {
    let (low, high) = mesh.bounds().unwrap();
    [0, 1, 2].map(|k| high[k] - low[k])
}

#[test]
fn what_stands_keeps_standing() {
    let place = tempfile::tempdir().unwrap();
    let path = |name: &str| place.path().join(name);
    let run = |line: &str| unsphere_with(place.path(), &line.split(' ').collect::<Vec<_>>());
    // A box that is 4 high, its top away from the origin.
    let tall = primitives::cuboid([1.0, 4.0, 2.0]).translated([0.0, 2.0, 0.0]);
    write_mesh(path("tall.obj"), &tall).unwrap();
    let bounds = |name: &str| read_mesh(path(name)).unwrap().bounds().unwrap();
    let printed = ([-0.5, -1.0, 0.0], [0.5, 1.0, 4.0]);

    let out = run("convert tall.obj -o a.stl --json").ok();
    assert_eq!((out.json()["up"].as_str(), bounds("a.stl")), (Some("z"), printed));
    run("convert a.stl -o b.stl").ok();
    assert_eq!(bounds("b.stl"), printed);
    let out = run("convert b.stl -o c.glb --json").ok();
    assert_eq!(out.json()["up"], "y");
    assert_eq!(bounds("c.glb"), tall.bounds().unwrap());
    // The height is that of what is up.
    let out = run("convert b.stl -o d.stl --height 8cm").ok();
    assert_eq!(bounds("d.stl").1[2], 80.0);
    assert!(out.stdout().contains("+Z is up"), "{}", out.stdout());

    // Files that are otherwise: who says so is believed.
    run("convert tall.obj -o e.stl --up y").ok();
    assert_eq!(bounds("e.stl"), tall.bounds().unwrap());
    run("convert e.stl -o f.glb --input-up y").ok();
    assert_eq!(bounds("f.glb"), tall.bounds().unwrap());
    run("convert e.stl -o g.stl --input-up y").ok();
    assert_eq!(bounds("g.stl"), printed);
    let out = run("convert tall.obj -o h.ply --input-up z --up z --height 4mm --json").ok();
    assert_eq!(out.json()["up"], "z");
    assert_eq!(sides(&read_mesh(path("h.ply")).unwrap()), [2.0, 8.0, 4.0]);
    let flat = TriMesh::new(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2]]);
    write_mesh(path("flat.stl"), &flat).unwrap();
    run("convert flat.stl -o i.stl --height 1mm").fails(3, &["flat.stl", "no height"]);
}

/// A ball whose image is red on one side and blue on the other.
fn textured_ball() -> TriMesh {
    let ball = primitives::icosphere(4);
    let image = Image { height: 1, width: 2, channels: 3, data: vec![1., 0., 0., 0., 0., 1.] };
    let uvs = ball.positions.iter().map(|p| [0.5 + 0.5 * p[0], 0.5]).collect();
    let texture = Texture { uvs, faces: ball.faces.clone(), image };
    TriMesh { texture: Some(texture), ..ball }
}

#[test]
fn what_stands_beside_an_obj_file_stays() {
    let place = tempfile::tempdir().unwrap();
    let path = |name: &str| place.path().join(name);
    let run = |line: &str| unsphere_with(place.path(), &line.split(' ').collect::<Vec<_>>());
    write_mesh(path("ball.glb"), &textured_ball()).unwrap();
    for (file, name) in [("x.png", "x.obj"), ("y.mtl", "y.obj")] {
        std::fs::write(path(file), b"a photograph").unwrap();
        run(&format!("convert ball.glb -o {name}")).fails(1, &[file, "exists already", "--force"]);
        assert_eq!(std::fs::read(path(file)).unwrap(), b"a photograph");
        assert!(!path(name).exists());
    }
    // No other format has such files, nor has a mesh without a texture.
    run("convert ball.glb -o x.ply").ok();
    run("convert ball.glb -o x.obj --faces 500").ok();
    assert_eq!(std::fs::read(path("x.png")).unwrap(), b"a photograph");
    run("convert ball.glb -o x.obj --force").ok();
    assert!(read_mesh(path("x.obj")).unwrap().texture.is_some());
}

/// The sides of a thin dish come through each other when its triangles get long: what cannot be mended is said.
#[test]
fn fewer_triangles_run_through_nothing_without_a_word() {
    let place = tempfile::tempdir().unwrap();
    let bent = |[x, y, z]: [f32; 3]| [x, 0.02 * y + 0.9 * (x * x + z * z), z];
    let dish = primitives::icosphere(4).map_positions(bent);
    write_mesh(place.path().join("dish.ply"), &dish).unwrap();
    for faces in [1000, 200] {
        let line = format!("convert dish.ply -o small.ply --force --faces {faces}");
        let out = unsphere_with(place.path(), &line.split(' ').collect::<Vec<_>>()).ok();
        let small = read_mesh(place.path().join("small.ply")).unwrap();
        let is_said = out.stderr().contains("run through each other");
        assert_eq!(is_said, !small.self_intersections().is_empty(), "{faces}: {}", out.stderr());
        assert!(faces == 200 || !is_said, "{}", out.stderr());
    }
}

#[test]
fn textured_meshes_get_fewer_triangles() {
    let place = tempfile::tempdir().unwrap();
    let path = |name: &str| place.path().join(name);
    let run = |line: &str| unsphere_with(place.path(), &line.split(' ').collect::<Vec<_>>());
    write_mesh(path("ball.glb"), &textured_ball()).unwrap();
    let out = run("convert ball.glb -o ball.stl --faces 500").ok();
    assert!(out.stderr().contains("no colours") && !out.stderr().contains("texture"));
    assert_eq!(read_mesh(path("ball.stl")).unwrap().faces.len(), 500);

    let out = run("convert ball.glb -o small.ply --faces 500").ok();
    assert!(out.stderr().contains("colours are those of the vertices"), "{}", out.stderr());
    let small = read_mesh(path("small.ply")).unwrap();
    assert_eq!((small.faces.len(), small.texture.is_some()), (500, false));
    for (p, [r, _, b]) in small.positions.iter().zip(small.colors.unwrap()) {
        let blue = (0.5 + p[0]).clamp(0.0, 1.0);
        assert!((b - blue).abs() < 0.05 && (r + b - 1.0).abs() < 0.01, "{p:?} {r} {b}");
    }
    // One that has no more triangles keeps its texture.
    run("convert ball.glb -o same.obj --faces 100000").ok();
    assert!(read_mesh(path("same.obj")).unwrap().texture.is_some());
}
