//! A surface that moves along its normals until photographs agree about it.

use std::sync::Arc;

use autodiff_lite::Tape;
use autodiff_lite::optim::AdamUniform;
use diff_raster::{Faces, Renderer, Settings};
use mesh_core::{DiffusionSolver, Topology, TriMesh, vertex_normals};

use crate::photographs::Pairs;

/// How far a vertex is taken along with its neighbours.
const SMOOTHNESS: f32 = 8.0;
/// What outlines count beside colours.
const OUTLINES: f32 = 4.0;

/// Moves the surface in `steps` steps of at most `length` each at the beginning, a tenth of it at the end; the mean difference of colour
/// before each.
///
/// Steps are taken in `u`, with positions x = (I + λL)⁻¹ u, so that a vertex takes its neighbours along (Nicolet et al. 2021, "Large
/// Steps in Inverse Rendering of Geometry").
pub(crate) fn follow(
    mesh: &mut TriMesh,
    pairs: &Pairs,
    steps: usize,
    length: f64,
) -> Result<Vec<f32>, Box<dyn std::error::Error>> {
    let [height, width] = pairs.size();
    let settings = Settings { perspective: true, ..Settings::new(height, width) };
    let renderer = Renderer::new(Arc::new(Faces::of(mesh)?), settings);
    let mut solver = DiffusionSolver::factored(&Topology::of(mesh), SMOOTHNESS);
    let mut u = mesh.positions.clone();
    solver.apply(&mesh.positions, &mut u);
    let mut smooth = vec![[0.0; 3]; u.len()];
    let (mut tape, mut adam) = (Tape::<f32>::train(0), AdamUniform::new(length));
    let mut history = Vec::new();
    for step in 0..steps {
        let positions = tape.leaf(mesh.vertices());
        let [colors, outlines] = pairs.losses(&tape, &renderer, positions);
        history.push(colors.item());
        let gradients = (colors + outlines.scale(OUTLINES)).backward();
        let gradient = gradients.wrt(positions).ok_or("no photograph sees the mesh")?;
        let normals = vertex_normals(&mesh.positions, &mesh.faces);
        let along: Vec<[f32; 3]> = gradient
            .as_slice()
            .as_chunks::<3>()
            .0
            .iter()
            .zip(normals)
            .map(|(g, n)| {
                let share: f32 = (0..3).map(|a| g[a] * n[a]).sum();
                n.map(|n| share * n)
            })
            .collect();
        solver.solve(&along, &mut smooth, 1e-4, 50);
        drop(gradients);
        tape.reset();
        adam.set_lr(length * 0.1f64.powf(step as f64 / steps as f64));
        adam.update("u", u.as_flattened_mut(), smooth.as_flattened());
        solver.solve(&u, &mut mesh.positions, 1e-5, 50);
    }
    Ok(history)
}
