//! Distances between two meshes, and how each changes when a vertex of the first moves.

use losses::autodiff_lite::{Tape, Var};
use losses::mesh_core::primitives::{icosphere, torus};
use losses::mesh_core::{SurfacePoint, TriMesh, sample_surface};
use losses::metrics::{CompareError, Preset, evaluate};

/// Both distances of points on the first mesh to the second: Chamfer's to points, and to the faces.
fn distances<'t>(
    vertices: Var<'t, f64>,
    mesh: (&TriMesh, &[SurfacePoint]),
    goal: (&TriMesh, &[SurfacePoint]),
) -> [Var<'t, f64>; 2] {
    let tape = vertices.tape();
    let truth = tape.constant(goal.0.vertices());
    let points = losses::surface_points(vertices, &mesh.0.faces, mesh.1);
    let chamfer = losses::chamfer(points, losses::surface_points(truth, &goal.0.faces, goal.1));
    [chamfer, losses::point_mesh_face_distance(points, truth, &goal.0.faces)]
}

fn main() -> Result<(), CompareError> {
    let (mesh, goal) = (icosphere(3), torus(1.0, 0.4, 48, 24));
    let (drawn, there) = (sample_surface(&mesh, 3000, 1), sample_surface(&goal, 3000, 2));
    let (first, second) = ((&mesh, drawn.as_slice()), (&goal, there.as_slice()));
    for (k, name) in ["Chamfer", "point to face"].into_iter().enumerate() {
        let tape = Tape::<f64>::train(0);
        let vertices = tape.leaf(mesh.vertices::<f64>());
        let distance = distances(vertices, first, second)[k];
        let gradients = distance.backward();
        let gradient = gradients.wrt(vertices).expect("the distance depends on the vertices");
        let steepest: f64 = gradient.as_slice().iter().map(|g| g * g).sum();

        // A small step against the gradient: the distance falls as the gradient says.
        let step = 1e-5;
        let mut moved = mesh.vertices::<f64>();
        moved.iter_mut().zip(gradient.as_slice()).for_each(|(x, g)| *x -= step * g);
        let after = distances(tape.leaf(moved), first, second)[k].item();
        let fell = (distance.item() - after) / step;
        println!("{name} {:?}, gradient squared {steepest:?}, fell by {fell:.6}", distance.item());
        assert!((fell / steepest - 1.0).abs() < 1e-3, "{name}: not the derivative");
    }
    let report = evaluate(&mesh, &goal, &Preset::MeshRcnn.protocol(0))?;
    println!("Mesh R-CNN's protocol: {:?}", report.chamfer);
    Ok(())
}
