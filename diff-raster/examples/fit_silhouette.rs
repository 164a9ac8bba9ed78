//! Fits a sphere to the silhouettes of a vase from eight sides, with nothing but this crate's
//! gradients, the tape's optimiser and a diffusion step against folds.
//!
//! Writes `frame_*.png` (the eight views; red is still to be filled, blue still to be cut) and
//! `vase.obj` into the folder given as argument, by default `target/fit_silhouette`.
//!
//! ```text
//! cargo run --release -p unsphere-diff-raster --example fit_silhouette
//! ```
#![allow(clippy::print_stdout, reason = "a program")]

use std::error::Error;
use std::path::PathBuf;
use std::sync::Arc;

use autodiff_lite::optim::AdamUniform;
use autodiff_lite::{Tape, Tensor};
use diff_raster::{Faces, Renderer, Settings};
use mesh_core::{
    ByteImage, Camera, DiffusionSolver, Topology, TriMesh, primitives, write_mesh, write_png,
};

const SIZE: usize = 128;
const VIEWS: usize = 8;
const STEPS: usize = 500;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(
        std::env::args().nth(1).unwrap_or_else(|| "target/fit_silhouette".to_owned()),
    );
    std::fs::create_dir_all(&folder)?;

    let cameras = cameras();
    let mut tape = Tape::<f32>::train(0);
    let settings = Settings::new(SIZE, SIZE);

    // What is to be seen.
    let vase = primitives::lathe(
        &[[0.4, -0.8], [0.65, -0.4], [0.6, 0.0], [0.3, 0.4], [0.28, 0.6], [0.45, 0.8]],
        64,
    );
    let target = {
        let projected = tape.constant(vase.vertices()).project(tape.constant(cameras.clone()));
        let renderer = Renderer::new(Arc::new(Faces::of(&vase)?), settings.clone());
        renderer.frame(projected).antialiased_silhouette().value()
    };
    tape.reset();

    // What we begin with. Steps are taken in `u`, with positions x = (I + λL)⁻¹ u: large and
    // smooth ones (Nicolet et al. 2021, "Large Steps in Inverse Rendering of Geometry").
    let mut mesh = primitives::icosphere(4);
    mesh.positions.iter_mut().flatten().for_each(|x| *x *= 0.5);
    let faces = Arc::new(Faces::of(&mesh)?);
    let mut solver = DiffusionSolver::factored(&Topology::of(&mesh), 25.0);
    let renderer = Renderer::new(faces, settings);
    let mut u = mesh.positions.clone();
    solver.apply(&mesh.positions, &mut u);
    let mut smooth = vec![[0.0; 3]; u.len()];
    let mut adam = AdamUniform::new(0.02);

    for step in 0..=STEPS {
        let positions = tape.leaf(mesh.vertices());
        let frame = renderer.frame(positions.project(tape.constant(cameras.clone())));
        // The soft silhouette sees from afar, the antialiased one is exact.
        let wanted = tape.constant(target.clone());
        let sharp = frame.antialiased_silhouette();
        let soft = frame.soft_silhouette();
        let error = (sharp - wanted).square().mean();
        let loss = error + (soft - wanted).square().mean();
        if step % 50 == 0 {
            println!("step {step:3}: mean squared error {:.5}", error.item());
            let views = side_by_side(&target, &sharp.value());
            write_png(folder.join(format!("frame_{step:03}.png")), &views)?;
        }
        let gradients = loss.backward();
        let gradient = gradients.wrt(positions).ok_or("the loss does not see the mesh")?;
        let gradient = gradient.as_slice().as_chunks::<3>().0;
        solver.solve(gradient, &mut smooth, 1e-4, 50);
        drop(gradients);
        tape.reset();
        adam.update("u", u.as_flattened_mut(), smooth.as_flattened());
        solver.solve(&u, &mut mesh.positions, 1e-5, 50);
    }

    let fitted = TriMesh::new(mesh.positions, mesh.faces);
    println!("{}", fitted.health());
    write_mesh(folder.join("vase.obj"), &fitted)?;
    println!("{}", folder.join("vase.obj").display());
    Ok(())
}

/// Projection matrices of cameras all around, from a little above and below. `[N, 3, 4]`
fn cameras() -> Tensor<f32> {
    let all: Vec<Camera> = (0..VIEWS)
        .map(|k| {
            let (sin, cos) = (k as f64 * std::f64::consts::TAU / VIEWS as f64).sin_cos();
            let eye = [3.0 * sin, if k % 2 == 0 { 1.0 } else { -0.4 }, 3.0 * cos];
            Camera::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 0.65, SIZE, SIZE)
        })
        .collect();
    Camera::matrices(&all).into()
}

/// The views side by side, in two rows.
fn side_by_side(target: &Tensor<f32>, current: &Tensor<f32>) -> ByteImage {
    let mut image = ByteImage::new(2 * SIZE, VIEWS / 2 * SIZE, 3);
    for (at, pixel) in image.data.chunks_exact_mut(3).enumerate() {
        let (i, j) = (at / (VIEWS / 2 * SIZE), at % (VIEWS / 2 * SIZE));
        let view = i / SIZE * (VIEWS / 2) + j / SIZE;
        let [t, c] = [target, current].map(|x| 255.0 * x[[view, i % SIZE, j % SIZE]]);
        pixel.copy_from_slice(&[t as u8, t.min(c) as u8, c as u8]);
    }
    image
}
