//! The other way to fit a mesh to views, beside `fit`: steps by gradients through rendered images.
//!
//! On the tape, 500 steps of five views each from an icosphere whose vertices have a colour each. Of three rates, trials each, the best on the
//! views that were fitted is shown, and the time of that one. Every fifth view is held out, as `fit` does. The rows:
//!
//! 1. PyTorch3D's tutorial on textured meshes: DIB-R's soft silhouette, plain Adam, the tutorial's three smoothness terms with its
//!    weights; 642 vertices, images of 128 pixels.
//! 2. As the tutorial of this repository does it: soft and antialiased silhouettes together, steps that are smoothed over the surface
//!    (Nicolet et al. 2021); as many vertices and pixels. 3. The same with 10,242 vertices, on the views as they are.
//! 4. `fit` held to as many vertices and pixels as 1 and 2; 5. `fit` as it is.
//!
//! ```text
//! cargo run --release -p unsphere-recon --example fit_by_gradients -- [views]
//! ```
#![allow(clippy::print_stdout, reason = "a program")]

use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use autodiff_lite::optim::{Adam, AdamUniform};
use autodiff_lite::{Tape, Tensor, Var};
use datasets::{ReadOptions, View, Views, read_views};
use diff_raster::{Faces, Renderer, Settings};
use mesh_core::{DiffusionSolver, Topology, TriMesh, primitives};
use ndarray::{Array2, Array3, Array4};
use recon::evaluate::score_views;
use recon::fit::{FitConfig, bounding_sphere, fit};
use recon::progress::Watch;
use synth::shapes::AlarmClock;
use synth::{Lighting, Orbit, RenderOptions, render_views};

const SIDE: usize = 128;
/// Of the icosphere, where images are small and where they are not.
const LEVELS: [u32; 2] = [3, 5];
const STEPS: usize = 500;
/// Views in each step, spread over all and others each time.
const BATCH: usize = 5;
const RATES: [f64; 3] = [0.003, 0.01, 0.03];
/// Of steps that are smoothed, and how far they are.
const SMOOTH_RATES: [f64; 3] = [0.003, 0.01, 0.03];
const SMOOTHNESS: f32 = 5.0;
/// Adam's rate for colours beside them.
const PAINT: f64 = 0.01;
/// PyTorch3D's weights.
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

    let [low, high] = LEVELS;
    for (name, views_of, level, is_smooth) in [
        ("soft silhouette, plain Adam", &small, low, false),
        ("both silhouettes, smoothed steps", &small, low, true),
        ("both silhouettes, smoothed steps", &views, high, true),
    ] {
        let mut best: Option<(f64, TriMesh, f64)> = None;
        for rate in if is_smooth { SMOOTH_RATES } else { RATES } {
            let start = Instant::now();
            let mesh = by_gradients(views_of, level, rate, is_smooth)?;
            let seconds = start.elapsed().as_secs_f64();
            let (fitted, _) = parts(views_of);
            let own = score_views(&mesh, &fitted, &|_, _| ())?.mask_iou;
            if best.as_ref().is_none_or(|(other, ..)| own > *other) {
                best = Some((own, mesh, seconds));
            }
        }
        let (_, mesh, seconds) = best.ok_or("no rate")?;
        row(name, &mesh, views_of, &views, seconds)?;
    }

    let same = FitConfig { start_level: low, level: low, ..FitConfig::default() };
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

/// How the gradient of positions becomes a step.
enum Steps {
    Plain(Adam),
    /// Positions are `(I + λ L)⁻¹ u`, and `u` is what moves.
    Smoothed {
        adam: AdamUniform,
        solver: Box<DiffusionSolver>,
        u: Vec<[f32; 3]>,
        pull: Vec<[f32; 3]>,
    },
}

impl Steps {
    fn new(mesh: &TriMesh, topology: &Topology, rate: f64, is_smooth: bool) -> Self {
        if !is_smooth {
            return Self::Plain(Adam::new(rate));
        }
        let solver = DiffusionSolver::factored(topology, SMOOTHNESS);
        let mut u = mesh.positions.clone();
        solver.apply(&mesh.positions, &mut u);
        let pull = vec![[0.0; 3]; u.len()];
        Self::Smoothed { adam: AdamUniform::new(rate), solver: Box::new(solver), u, pull }
    }

    fn step(&mut self, positions: &mut [[f32; 3]], gradient: &[f32]) {
        match self {
            Self::Plain(adam) => adam.update("positions", positions.as_flattened_mut(), gradient),
            Self::Smoothed { adam, solver, u, pull } => {
                solver.solve(gradient.as_chunks::<3>().0, pull, 1e-4, 50);
                adam.update("u", u.as_flattened_mut(), pull.as_flattened());
                solver.solve(u, positions, 1e-5, 50);
            }
        }
    }
}

fn by_gradients(
    views: &Views,
    level: u32,
    rate: f64,
    is_smooth: bool,
) -> Result<TriMesh, Box<dyn Error>> {
    let (fitted, _) = parts(views);
    let (center, radius) = bounding_sphere(&fitted)?;
    let targets: Vec<Target> = fitted.iter().map(|view| target(view, center, radius)).collect();
    let [height, width] = [fitted[0].color.height, fitted[0].color.width];

    let mut mesh = primitives::icosphere(level).scaled([0.5; 3]);
    let topology = Topology::new(mesh.positions.len(), &mesh.faces);
    let settings =
        if is_smooth { Settings::new(height, width) } else { Settings::published(height, width) };
    let settings = Settings { cull_back_faces: true, ..settings };
    let renderer = Renderer::new(Arc::new(Faces::of(&mesh)?), settings);
    let mut colors = vec![[0.5_f32; 3]; mesh.positions.len()];
    let mut steps = Steps::new(&mesh, &topology, rate, is_smooth);
    let mut painter = Adam::new(if is_smooth { PAINT } else { rate });
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
        let loss = silhouette.scale(SILHOUETTE) + color.scale(COLOR);
        let loss = if is_smooth {
            loss + (frame.antialiased_silhouette() - masks).square().mean().scale(SILHOUETTE)
        } else {
            loss + losses::edge_length(positions, &topology, 0.0).scale(EDGE)
                + losses::normal_consistency(positions, &topology).scale(NORMAL)
                + losses::laplacian_norm(positions, &topology).scale(LAPLACIAN)
        };
        let gradients = loss.backward();
        let of = |leaf: Var<'_>| gradients.wrt(leaf).map(|g| g.as_slice().to_vec());
        let moves = of(positions).ok_or("the loss does not see the mesh")?;
        let paint = of(painted).ok_or("the loss does not see the colours")?;
        drop(gradients);
        tape.reset();
        steps.step(&mut mesh.positions, &moves);
        painter.update("colors", colors.as_flattened_mut(), &paint);
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
