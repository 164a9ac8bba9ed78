//! A hollow that no outline shows, found by what photographs agree about: a ball with a dish in it, from a ball, on the tape.
//!
//! Writes `start.obj`, `found.obj` and `truth.obj` and a picture of the three, `hollow.png`, into the folder given as argument, by
//! default `target/photo_consistency`.
//!
//! ```text
//! cargo run --release -p unsphere-diff-raster --example photo_consistency
//! ```
#![allow(clippy::print_stdout, reason = "a program")]

mod photographs;
mod surface;

use std::error::Error;
use std::path::PathBuf;
use std::sync::Arc;

use autodiff_lite::{Tape, Tensor};
use diff_raster::{Faces, Renderer, Settings};
use mesh_core::{ByteImage, Camera, TriMesh, primitives, vertex_normals, write_mesh, write_png};

use photographs::{Pairs, tensor};

const SIZE: usize = 128;
const VIEWS: usize = 12;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(
        std::env::args().nth(1).unwrap_or_else(|| "target/photo_consistency".to_owned()),
    );
    std::fs::create_dir_all(&folder)?;
    let truth = object(6, 0.35);
    let matrices: Tensor<f32> = Camera::matrices(&cameras()).into();
    let colors = painted(&truth);
    let [images, masks] = drawn(&truth, colors, &matrices)?;
    // Each with the next and the one after it.
    let pairs: Vec<[usize; 2]> =
        (0..VIEWS).flat_map(|k| [1, 2].map(|next| [k, (k + next) % VIEWS])).collect();
    let fine = Pairs::of(&images, &masks, &matrices, &pairs);
    let middle = fine.halved();
    let coarse = middle.halved();

    let mut mesh = object(4, 0.0);
    write_mesh(folder.join("start.obj"), &mesh)?;
    let start = mesh.clone();
    println!("the dish is {:.3} deep", depth(&truth));
    for (pairs, steps, length) in [(&coarse, 150, 0.02), (&middle, 60, 0.02), (&fine, 20, 0.01)] {
        let history = surface::follow(&mut mesh, pairs, steps, length)?;
        println!(
            "{} pixels: colours differ by {:.4}, then {:.4}; {:.3} deep",
            pairs.size()[0],
            history[0],
            history[steps - 1],
            depth(&mesh)
        );
    }
    println!("{}", mesh.health());
    write_mesh(folder.join("found.obj"), &mesh)?;
    write_mesh(folder.join("truth.obj"), &truth)?;
    let shaded = [&start, &mesh, &truth].map(|mesh| drawn(mesh, lit(mesh), &matrices));
    let mut picture = ByteImage::new(SIZE, 3 * SIZE, 3);
    for (k, images) in shaded.into_iter().enumerate() {
        let [image, _] = images?;
        for (i, row) in image.as_slice()[..SIZE * SIZE * 3].chunks_exact(SIZE * 3).enumerate() {
            let place = &mut picture.data[(i * 3 + k) * SIZE * 3..][..SIZE * 3];
            place.iter_mut().zip(row).for_each(|(to, from)| *to = (255.0 * from) as u8);
        }
    }
    write_png(folder.join("hollow.png"), &picture)?;
    println!("{}", folder.join("hollow.png").display());
    Ok(())
}

/// A ball of radius 1 with a dish of this depth, as a share of the radius, towards z.
fn object(level: u32, depth: f32) -> TriMesh {
    primitives::icosphere(level).map_positions(|p: [f32; 3]| {
        let away = p[0] * p[0] + p[1] * p[1] + (p[2] - 1.0).powi(2);
        p.map(|v| (1.0 - depth * (-away / 0.16).exp()) * v)
    })
}

/// Cameras that look into the dish, in a ring. `VIEWS`
fn cameras() -> Vec<Camera> {
    let one = |k: usize| {
        let (sin, cos) = (k as f64 * std::f64::consts::TAU / VIEWS as f64).sin_cos();
        let eye = [1.6 * sin, 1.6 * cos, 3.6];
        Camera::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 0.65, SIZE, SIZE)
    };
    (0..VIEWS).map(one).collect()
}

/// Waves of colour, the same at the same place. `[V, 3]`
fn painted(mesh: &TriMesh) -> Vec<[f32; 3]> {
    let wave = |p: &[f32; 3], c: usize| {
        let [x, y, z] = [0, 1, 2].map(|a| p[(a + c) % 3]);
        let slow = (5.0 * x + 3.0 * (2.5 * y).sin() + c as f32).sin();
        0.5 + 0.3 * slow + 0.2 * (11.0 * y + 7.0 * z * x).sin()
    };
    mesh.positions.iter().map(|p| std::array::from_fn(|c| wave(p, c))).collect()
}

/// Colours of a surface that a lamp lights from the left. `[V, 3]`
fn lit(mesh: &TriMesh) -> Vec<[f32; 3]> {
    let light = |n: [f32; 3]| (0.45 - 0.5 * n[0] + 0.3 * n[2]).clamp(0.05, 1.0);
    vertex_normals(&mesh.positions, &mesh.faces).into_iter().map(|n| [light(n); 3]).collect()
}

/// What all cameras see, and where. `[N, H, W, 3]`, `[N, H, W]`
fn drawn(
    mesh: &TriMesh,
    colors: Vec<[f32; 3]>,
    matrices: &Tensor<f32>,
) -> Result<[Tensor<f32>; 2], Box<dyn Error>> {
    let tape = Tape::<f32>::train(0);
    let settings = Settings { perspective: true, ..Settings::new(SIZE, SIZE) };
    let renderer = Renderer::new(Arc::new(Faces::of(mesh)?), settings);
    let frame =
        renderer.frame(tape.constant(mesh.vertices()).project(tape.constant(matrices.clone())));
    let count = colors.len();
    let colors = tensor(colors.into_flattened(), &[count, 3]);
    let image = frame.interpolate(tape.constant(colors)).value();
    Ok([image, frame.antialiased_silhouette().value()])
}

/// How deep the dish is.
fn depth(mesh: &TriMesh) -> f32 {
    let middle = mesh.positions.iter().filter(|p| p[0].hypot(p[1]) < 0.12 && p[2] > 0.0);
    let (sum, count) = middle.fold((0.0, 0), |(sum, count), p| (sum + p[2], count + 1));
    1.0 - sum / count as f32
}
