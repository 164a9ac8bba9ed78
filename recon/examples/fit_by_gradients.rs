//! The other way to fit a mesh to views, beside `fit`: steps by gradients through rendered images.
//!
//! PyTorch3D's tutorial on textured meshes, through DIB-R on the tape: an icosphere of 642 vertices, each with a colour, images
//! of 128 pixels, 500 steps of Adam; squared differences of silhouettes and of colours, and the tutorial's three smoothness
//! terms with its weights. Each rate of Adam below is a trial, the best on the views that were fitted is shown. Every fifth view
//! is held out, as `fit` does. The rows:
//!
//! 1. by gradients; 2. `fit` held to as many vertices and pixels; 3. `fit` as it is, on the views as they are.
//!
//! ```text
//! cargo run --release -p unsphere-recon --example fit_by_gradients -- [views]
//! ```
#![allow(clippy::print_stdout, reason = "a program")]

use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use autodiff_lite::optim::Adam;
use autodiff_lite::{Tape, Tensor, Var};
use datasets::{ReadOptions, View, Views, read_views};
use diff_raster::{Faces, Renderer, Settings};
use mesh_core::{Topology, TriMesh, primitives};
use ndarray::{Array2, Array3, Array4};
use recon::evaluate::score_views;
use recon::fit::{FitConfig, bounding_sphere, fit};
use recon::progress::Watch;
use synth::shapes::AlarmClock;
use synth::{Lighting, Orbit, RenderOptions, render_views};

const SIDE: usize = 128;
const LEVEL: u32 = 3;
const STEPS: usize = 500;
/// Views in each step, spread over all and others each time.
const BATCH: usize = 5;
const RATES: [f64; 3] = [0.003, 0.01, 0.03];
/// The tutorial's weights.
const SILHOUETTE: f32 = 1.0;
const COLOR: f32 = 1.0;
const EDGE: f32 = 1.0;
const NORMAL: f32 = 0.01;
const LAPLACIAN: f32 = 1.0;

fn main() -> Result<(), Box<dyn Error>> {
    let views = match std::env::args().nth(1) {
        Some(path) => read_views(Path::new(&path), &ReadOptions::default(), &|_, _| ())?,
        None => clock()?,
    };
    let small: Vec<View> = views.views.iter().map(|v| v.clone().at_most(SIDE)).collect();
    let small = Views::in_memory(small);
    println!(
        "| way | vertices | pixels | mask IoU | PSNR, dB | seconds |\n|---|--:|--:|--:|--:|--:|"
    );

    let mut best: Option<(f64, TriMesh, f64)> = None;
    for rate in RATES {
        let start = Instant::now();
        let mesh = by_gradients(&small, rate)?;
        let seconds = start.elapsed().as_secs_f64();
        let (fitted, _) = parts(&small);
        let own = score_views(&mesh, &fitted, &|_, _| ())?.mask_iou;
        if best.as_ref().is_none_or(|(other, ..)| own > *other) {
            best = Some((own, mesh, seconds));
        }
    }
    let (_, mesh, seconds) = best.ok_or("no rate")?;
    row("gradients through DIB-R", &mesh, &small, &views, seconds)?;

    let same = FitConfig { start_level: LEVEL, level: LEVEL, ..FitConfig::default() };
    for (name, views_of, config) in [
        ("`fit`, as few vertices and pixels", &small, same),
        ("`fit`", &views, FitConfig::default()),
    ] {
        let start = Instant::now();
        let fitted = fit(views_of, &config, &mut Watch::default())?;
        row(name, &fitted.mesh, views_of, &views, start.elapsed().as_secs_f64())?;
    }
    Ok(())
}

/// Views of a procedural clock.
fn clock() -> Result<Views, Box<dyn Error>> {
    let options = RenderOptions { lighting: Lighting::studio(), ..RenderOptions::default() };
    let cameras = Orbit { count: 40, ..Orbit::default() }.cameras();
    Ok(Views::in_memory(render_views(
        &AlarmClock::default().build(),
        &cameras,
        &options,
        &|_, _| (),
    )?))
}

/// Views that are fitted, and views that are held out.
fn parts(views: &Views) -> (Vec<&View>, Vec<&View>) {
    let split = views.split(Some(5));
    let of = |which: &[usize]| which.iter().map(|&i| &views.views[i]).collect();
    (of(&split.fit), of(&split.held_out))
}

/// A line of the table, scored at the views that were held out, as large as they are.
fn row(
    name: &str,
    mesh: &TriMesh,
    fitted: &Views,
    views: &Views,
    seconds: f64,
) -> Result<(), Box<dyn Error>> {
    let (_, held_out) = parts(views);
    let scores = score_views(mesh, &held_out, &|_, _| ())?;
    let psnr = scores.psnr.unwrap_or(f64::NAN);
    let (vertices, side) = (mesh.positions.len(), fitted.views[0].color.width);
    println!(
        "| {name} | {vertices} | {side} | {:.4} | {psnr:.2} | {seconds:.1} |",
        scores.mask_iou
    );
    Ok(())
}

/// What a step compares of one view.
struct Target {
    /// From the mesh's frame to the image plane.
    matrix: [f32; 12],
    mask: Vec<f32>,
    color: Vec<f32>,
}

fn by_gradients(views: &Views, rate: f64) -> Result<TriMesh, Box<dyn Error>> {
    let (fitted, _) = parts(views);
    let (center, radius) = bounding_sphere(&fitted)?;
    let targets: Vec<Target> = fitted.iter().map(|view| target(view, center, radius)).collect();
    let [height, width] = [fitted[0].color.height, fitted[0].color.width];

    let mut mesh = primitives::icosphere(LEVEL).scaled([0.5; 3]);
    let topology = Topology::new(mesh.positions.len(), &mesh.faces);
    let settings = Settings { cull_back_faces: true, ..Settings::published(height, width) };
    let renderer = Renderer::new(Arc::new(Faces::of(&mesh)?), settings);
    let mut colors = vec![[0.5_f32; 3]; mesh.positions.len()];
    let mut adam = Adam::new(rate);
    let mut tape = Tape::<f32>::train(0);
    for step in 0..STEPS {
        // Spread over the views, and others in each step.
        let chosen: Vec<&Target> = (0..BATCH)
            .map(|k| &targets[(step + k * targets.len() / BATCH) % targets.len()])
            .collect();
        let positions = tape.leaf(flat(&mesh.positions));
        let painted = tape.leaf(flat(&colors));
        let n = chosen.len();
        let matrices = stacked(&tape, chosen.iter().map(|t| &t.matrix[..]), [n, 3, 4]);
        let frame = renderer.frame(positions.project(matrices));
        let masks = stacked(&tape, chosen.iter().map(|t| &t.mask[..]), [n, height, width]);
        let images: Vec<f32> = chosen.iter().flat_map(|t| t.color.iter().copied()).collect();
        let images = Array4::from_shape_vec((n, height, width, 3), images)?;
        let silhouette = (frame.soft_silhouette() - masks).square().mean();
        let color = (frame.interpolate(painted) - tape.constant(images)).square().mean();
        let smooth = losses::edge_length(positions, &topology, 0.0).scale(EDGE)
            + losses::normal_consistency(positions, &topology).scale(NORMAL)
            + losses::laplacian_norm(positions, &topology).scale(LAPLACIAN);
        let loss = silhouette.scale(SILHOUETTE) + color.scale(COLOR) + smooth;
        let gradients = loss.backward();
        let of = |leaf: Var<'_>| gradients.wrt(leaf).map(|g| g.as_slice().to_vec());
        let moves = of(positions).ok_or("the loss does not see the mesh")?;
        let paint = of(painted).ok_or("the loss does not see the colours")?;
        drop(gradients);
        tape.reset();
        adam.update("positions", mesh.positions.as_flattened_mut(), &moves);
        adam.update("colors", colors.as_flattened_mut(), &paint);
    }
    let place = |p: [f32; 3]| std::array::from_fn(|k| center[k] as f32 + radius as f32 * p[k]);
    let mut mesh = mesh.map_positions(place);
    mesh.colors = Some(colors.into_iter().map(|c| c.map(|x| x.clamp(0.0, 1.0))).collect());
    Ok(mesh)
}

fn target(view: &View, center: [f64; 3], radius: f64) -> Target {
    // M (c + r q) = r (M q): depth counts in the frame of the mesh.
    let row = |m: [f64; 4]| {
        let at = m[0] * center[0] + m[1] * center[1] + m[2] * center[2] + m[3];
        [m[0], m[1], m[2], at / radius]
    };
    let rows = view.camera.projection().map(row);
    let floats = |bytes: &[u8]| bytes.iter().map(|&b| f32::from(b) / 255.0).collect();
    Target {
        matrix: std::array::from_fn(|k| rows[k / 4][k % 4] as f32),
        mask: floats(&view.mask.data),
        color: floats(&view.over([0; 3]).data),
    }
}

fn flat(rows: &[[f32; 3]]) -> Array2<f32> {
    Array2::from_shape_vec((rows.len(), 3), rows.as_flattened().to_vec()).expect("three each")
}

fn stacked<'t, 'a>(
    tape: &'t Tape,
    rows: impl Iterator<Item = &'a [f32]>,
    [n, a, b]: [usize; 3],
) -> Var<'t> {
    let numbers: Vec<f32> = rows.flatten().copied().collect();
    let array = Array3::from_shape_vec((n, a, b), numbers).expect("as many numbers");
    tape.constant(Tensor::from(array))
}
