//! What outlines touch at its edges alone: the sides of a box.

use datasets::{View, Views};
use mesh_core::primitives::{cuboid, icosphere};
use mesh_core::{TriMesh, face_normals};
use recon::fit::{FitConfig, fit};
use synth::{Orbit, RenderOptions, render_views};
use train::progress::Watch;

const HALF: [f32; 3] = [0.4, 0.3, 0.25];

fn fitted(object: &TriMesh, filter_normals: bool) -> TriMesh {
    let orbit = Orbit {
        count: 32,
        target: [0.0; 3],
        distance: [1.6, 1.8],
        width: 144,
        height: 144,
        ..Orbit::default()
    };
    let views = render_views(object, &orbit.cameras(), &RenderOptions::default(), &|_, _| ());
    let views: Vec<View> = views.expect("an object that can be drawn");
    let config = FitConfig { level: 4, filter_normals, ..FitConfig::default() };
    let found = fit(&Views::in_memory(views), &config, &mut Watch::default());
    let found = found.expect("an object that can be fitted");
    assert!(found.health.is_watertight());
    assert_eq!(found.self_intersections, 0);
    found.mesh
}

/// Mean angle between faces and the side of the box that they are on, away from its edges; in degrees.
fn unevenness(mesh: &TriMesh) -> f32 {
    let normals = face_normals(&mesh.positions, &mesh.faces);
    let angles: Vec<f32> = mesh
        .faces
        .iter()
        .zip(&normals)
        .filter_map(|(face, normal)| {
            let middle: [f32; 3] = std::array::from_fn(|k| {
                face.iter().map(|&v| mesh.positions[v as usize][k]).sum::<f32>() / 3.0 / HALF[k]
            });
            let side = (0..3).fold(0, |a, b| if middle[a].abs() > middle[b].abs() { a } else { b });
            let inside = (0..3).all(|k| k == side || middle[k].abs() < 0.8);
            inside.then(|| (normal[side] * middle[side].signum()).clamp(-1.0, 1.0).acos())
        })
        .collect();
    (angles.iter().sum::<f32>() / angles.len() as f32).to_degrees()
}

#[test]
fn sides_of_a_box_become_flat() {
    let truth = cuboid(HALF.map(|half| 2.0 * half));
    let [plain, even] = [false, true].map(|filter| unevenness(&fitted(&truth, filter)));
    assert!(plain > 3.0 && even < 1.0, "{plain} and {even} degrees");
}

#[test]
fn a_ball_stays_round() {
    let radius = 0.4;
    let ball = icosphere(5).map_positions(|p: [f32; 3]| p.map(|x| radius * x));
    let off = |mesh: TriMesh| {
        let normals = face_normals(&mesh.positions, &mesh.faces);
        let angle = |(face, normal): (&[u32; 3], &[f32; 3])| {
            let middle: [f32; 3] =
                std::array::from_fn(|k| face.iter().map(|&v| mesh.positions[v as usize][k]).sum());
            let length = middle.iter().map(|x| x * x).sum::<f32>().sqrt();
            let cos = (0..3).map(|k| middle[k] * normal[k]).sum::<f32>() / length;
            cos.clamp(-1.0, 1.0).acos().to_degrees()
        };
        mesh.faces.iter().zip(&normals).map(angle).sum::<f32>() / normals.len() as f32
    };
    let [plain, even] = [false, true].map(|filter| off(fitted(&ball, filter)));
    assert!(even < plain && even < 2.5, "{plain} and {even} degrees");
}
