//! Files that nobody here made.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "tests, whose list is to be looked at"
)]

mod samples;

use std::path::PathBuf;

use mesh_core::io::{obj, ply};
use mesh_core::{Camera, Limits, TriMesh, read_image, read_mesh, write_mesh};
use samples::corner_uvs;

fn data() -> PathBuf {
    std::env::var_os("UNSPHERE_DATA").expect("UNSPHERE_DATA names the folder of the data").into()
}

#[test]
#[ignore = "needs UNSPHERE_DATA"]
fn known_meshes_survive_every_format() {
    for (name, vertices, faces, textured) in [
        ("meshes/spot.obj", 2930, 5856, false),
        ("meshes/cow/cow.obj", 2930, 5856, true),
        ("meshes/avocado.obj", 406, 682, false),
        ("rendered_clock/sphere.obj", 642, 1280, false),
        ("p2m_ellipsoid/face3.obj", 0, 4928, false),
    ] {
        let mut notes = Vec::new();
        let path = data().join(name);
        if name.contains("face3") {
            // Faces alone: indices of vertices that are in another file.
            assert!(obj::read(&path).unwrap_err().to_string().contains("expected 1 to 0"));
            continue;
        }
        let mesh = obj::read_with(&path, &Limits::default(), &mut notes).unwrap();
        assert_eq!((mesh.positions.len(), mesh.faces.len()), (vertices, faces), "{name}");
        assert_eq!(mesh.texture.is_some(), textured, "{name} {notes:?}");
        assert_eq!(notes.is_empty(), !name.contains("avocado"), "{name} {notes:?}");
        survives(&mesh);
    }
}

fn files_below(folder: &std::path::Path, list: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files_below(&path, list);
        } else if path
            .extension()
            .is_some_and(|e| ["obj", "ply", "glb", "off"].iter().any(|f| e == *f))
        {
            list.push(path);
        }
    }
}

#[test]
#[ignore = "needs UNSPHERE_DATA"]
fn every_mesh_that_people_made_is_read() {
    let mut list = Vec::new();
    files_below(&data(), &mut list);
    list.sort();
    assert!(list.len() > 150, "{}", list.len());
    for path in list.iter().filter(|path| !path.starts_with(data().join("p2m_ellipsoid"))) {
        let mut remarks = Vec::new();
        let mesh = mesh_core::read_mesh_with(path, &Limits::default(), &mut remarks).unwrap();
        mesh.validate().unwrap();
        mesh.require_faces().unwrap();
        let said: Vec<String> = remarks.iter().map(ToString::to_string).collect();
        println!(
            "{} {} {} {}",
            path.display(),
            mesh.positions.len(),
            mesh.faces.len(),
            said.join("; ")
        );
        if path.extension().is_some_and(|e| e == "obj") {
            let options = tobj::LoadOptions {
                triangulate: true,
                ignore_lines: true,
                ignore_points: true,
                ..Default::default()
            };
            let (models, _) = tobj::load_obj(path, &options).unwrap();
            let faces: usize = models.iter().map(|m| m.mesh.indices.len() / 3).sum();
            assert_eq!(mesh.faces.len(), faces, "{}", path.display());
        }
    }
}

fn survives(mesh: &TriMesh) {
    let folder = tempfile::tempdir().unwrap();
    for name in ["m.obj", "m.ply", "m.glb"] {
        let path = folder.path().join(name);
        write_mesh(&path, mesh).unwrap();
        let back = read_mesh(&path).unwrap();
        assert_eq!(back.positions, mesh.positions, "{name}");
        assert_eq!(back.faces, mesh.faces, "{name}");
        if let (Some(texture), true) = (&mesh.texture, name != "m.ply") {
            assert_eq!(back.texture.as_ref().unwrap().image, texture.image, "{name}");
            for (a, b) in corner_uvs(&back).iter().zip(corner_uvs(mesh)) {
                assert!((a[0] - b[0]).abs() < 1e-6 && (a[1] - b[1]).abs() < 1e-6, "{name}");
            }
        }
    }
    let ascii = ply::encode(mesh, ply::Encoding::Ascii).unwrap();
    assert_eq!(ply::decode(&ascii, "ascii").unwrap().positions, mesh.positions);
}

#[test]
#[ignore = "needs UNSPHERE_DATA"]
fn r2n2_cameras_put_the_car_inside_its_masks() {
    let folder = data().join("r2n2_car");
    let numbers = |text: String| -> Vec<Vec<f64>> {
        text.lines()
            .map(|line| line.split_whitespace().map(|w| w.parse().unwrap()).collect())
            .collect()
    };
    let points = numbers(std::fs::read_to_string(folder.join("model_normal.xyz")).unwrap());
    let views = folder.join("rendering");
    let metadata = numbers(std::fs::read_to_string(views.join("rendering_metadata.txt")).unwrap());
    assert_eq!(metadata.len(), 24);
    for (i, view) in metadata.iter().enumerate() {
        let image = read_image(views.join(format!("{i:02}.png"))).unwrap();
        let alpha = image.alpha().unwrap();
        let camera = Camera::from_r2n2(view[0], view[1], view[3], image.width, image.height);
        camera.validate().unwrap();
        let inside = points
            .iter()
            .filter(|p| {
                let q = camera.project([p[0], p[1], p[2]]);
                assert!(q.depth > 0.0);
                let (row, column) = (q.row.floor(), q.column.floor());
                (0.0..alpha.height as f64).contains(&row)
                    && (0.0..alpha.width as f64).contains(&column)
                    && alpha.pixel(row as usize, column as usize)[0] > 0
            })
            .count();
        let share = inside as f64 / points.len() as f64;
        assert!(share > 0.995, "view {i}: {share}");
    }
}
