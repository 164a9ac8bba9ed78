//! Marching cubes of scikit-image and views of PyTorch3D; `fixtures/peers/make.py` made them.
#![allow(clippy::unwrap_used, reason = "tests")]

use mesh_core::{SphericalView, Topology, look_at_view_transform, marching_cubes};
use serde_json::Value;

fn peers() -> Value {
    serde_json::from_str(include_str!("fixtures/peers/peers.json")).unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

fn three(value: &Value) -> [f64; 3] {
    numbers(value).try_into().unwrap()
}

/// The same vertices, in whatever order; the triangles between them may differ where a cell has more than three.
#[test]
fn vertices_are_those_of_scikit_image() {
    let peers = peers();
    let values: Vec<f32> = numbers(&peers["values"]).into_iter().map(|x| x as f32).collect();
    let mesh = marching_cubes([10, 8, 9], ([0.0; 3], [9.0, 7.0, 8.0]), &values, 1.5);
    let expected: Vec<[f64; 3]> = peers["vertices"].as_array().unwrap().iter().map(three).collect();
    assert_eq!(mesh.positions.len(), expected.len());
    assert_eq!(mesh.faces.len() as u64, peers["faces"].as_u64().unwrap());
    for position in &mesh.positions {
        let away =
            |p: &[f64; 3]| (0..3).map(|k| (p[k] - f64::from(position[k])).abs()).sum::<f64>();
        let nearest = expected.iter().map(away).fold(f64::INFINITY, f64::min);
        assert!(nearest < 1e-5, "{position:?} is not there");
    }
    let topology = Topology::of(&mesh);
    assert!(topology.is_closed() && topology.euler_number() == 2 && mesh.volume() > 0.0);
}

#[test]
fn views_are_those_of_pytorch3d() {
    for view in peers()["views"].as_array().unwrap() {
        let number = |key: &str| view[key].as_f64().unwrap();
        let (r, t) = look_at_view_transform(&SphericalView {
            at: three(&view["at"]),
            up: three(&view["up"]),
            ..SphericalView::new(number("distance"), number("elevation"), number("azimuth"))
        });
        for (row, expected) in r.iter().zip(view["R"].as_array().unwrap()) {
            for (found, expected) in row.iter().zip(three(expected)) {
                assert!((found - expected).abs() < 1e-12, "R: {found} instead of {expected}");
            }
        }
        for (found, expected) in t.iter().zip(three(&view["T"])) {
            assert!((found - expected).abs() < 1e-12, "T: {found} instead of {expected}");
        }
    }
}
