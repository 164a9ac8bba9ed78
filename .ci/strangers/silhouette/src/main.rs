//! A sphere becomes what six silhouettes show, by an optimiser of our own: momentum along smoothed gradients.

use std::sync::Arc;

use diff_raster::autodiff_lite::{Tape, Tensor};
use diff_raster::mesh_core::{Camera, DiffusionSolver, Topology, primitives};
use diff_raster::{Faces, FacesError, Renderer, Settings};

const SIZE: usize = 64;

/// How much of the union of both masks is in both.
fn iou(a: &Tensor, b: &Tensor) -> f64 {
    let both = a.as_slice().iter().zip(b.as_slice()).map(|(a, b)| (*a > 0.5, *b > 0.5));
    let (all, shared) =
        both.fold((0, 0), |(u, i), (a, b)| (u + i32::from(a | b), i + i32::from(a & b)));
    f64::from(shared) / f64::from(all)
}

fn main() -> Result<(), FacesError> {
    let eyes =
        [[3., 0., 0.], [0., 3., 0.], [0., 0., 3.], [-2., 1., 2.], [2., 1., -2.], [1., -2., 2.]];
    let look = |eye| Camera::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 0.8, SIZE, SIZE);
    let cameras: Tensor = Camera::matrices(&eyes.map(look)).into();
    let mut tape = Tape::train(0);

    let vase = primitives::lathe(&[[0.3, -0.8], [0.7, -0.2], [0.3, 0.3], [0.5, 0.8]], 32);
    let projected = tape.constant(vase.vertices()).project(tape.constant(cameras.clone()));
    let renderer = Renderer::new(Arc::new(Faces::of(&vase)?), Settings::new(SIZE, SIZE));
    let target = renderer.frame(projected).antialiased_silhouette().value();
    tape.reset();

    let mut mesh = primitives::icosphere(3);
    let renderer = Renderer::new(Arc::new(Faces::of(&mesh)?), Settings::new(SIZE, SIZE));
    let mut smoother = DiffusionSolver::factored(&Topology::of(&mesh), 8.0);
    let mut velocity = vec![[0.0; 3]; mesh.positions.len()];
    let (mut once, mut twice) = (velocity.clone(), velocity.clone());
    let mut overlaps = Vec::new();
    for _ in 0..120 {
        let vertices = tape.leaf(mesh.vertices());
        let frame = renderer.frame(vertices.project(tape.constant(cameras.clone())));
        let (mask, wanted) = (frame.soft_silhouette(), tape.constant(target.clone()));
        overlaps.push(iou(&mask.value(), &target));
        let gradients = (mask - wanted).square().mean().backward();
        let gradient = gradients.wrt(vertices).expect("masks depend on the vertices");
        smoother.solve(gradient.as_slice().as_chunks().0, &mut once, 1e-5, 50);
        smoother.solve(&once, &mut twice, 1e-5, 50);
        drop(gradients);
        tape.reset();
        let most = twice.as_flattened().iter().fold(1e-9_f32, |most, g| most.max(g.abs()));
        let moved = mesh.positions.as_flattened_mut().iter_mut().zip(velocity.as_flattened_mut());
        for ((x, v), g) in moved.zip(twice.as_flattened()) {
            *v = 0.7 * *v - 0.006 * g / most;
            *x += *v;
        }
    }
    println!("mask IoU {:?} -> {:?}, within {:?}", overlaps[0], overlaps[119], mesh.bounds());
    assert!(overlaps[119] > 0.93 && overlaps[0] < 0.8, "the mesh does not follow the silhouettes");
    Ok(())
}
