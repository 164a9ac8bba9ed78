//! Hollows that no outline shows: fits a bowl, a mug, a dial and a face, with their photographs' colours and without.
//!
//! `cargo run --release -p unsphere-recon --example fit_hollows -- [names] [side] [folder]`
//!
//! Names are with commas between them: `bowl`, `mug`, `dial`, `mask`, `ball`, `all` of these, or a family with a seed as in `alarm-clock:1`. Each is painted, and drawn in 40 views of
//! `side` pixels (256) from all around, of which every fifth is held out; once with light from everywhere and once with a lamp that stands
//! still while the object turns. The error is that of the depth in the held-out views, where the fit by outlines alone is more than 2 %
//! of the object's diagonal off, in thousandths of the diagonal. The folder gets `NAME-LIGHT.ply` and `sheet.png`: truth, outlines alone,
//! with photographs.

mod sheet;

use std::error::Error;
use std::f32::consts::PI;
use std::io::Write;
use std::path::Path;
use std::time::Instant;

use datasets::{View, Views};
use mesh_core::primitives::{icosphere, lathe};
use mesh_core::{Camera, TriMesh, write_mesh, write_png};
use recon::evaluate::score_views;
use recon::fit::{FitConfig, Fitted, fit};
use synth::generate::Normalize;
use synth::shapes::Family;
use synth::{Lamp, Lighting, Orbit, RenderOptions, marbled, render_views};
use train::progress::Watch;

use sheet::sheet;

type Failure = Box<dyn Error>;

const TILE: usize = 192;
/// Share of the diagonal by which outlines alone are off in a hollow.
const HOLLOW: f32 = 0.02;
const SHAPES: [&str; 5] = ["bowl", "mug", "dial", "mask", "ball"];

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let argument =
        |k: usize, default: &str| arguments.get(k).cloned().unwrap_or_else(|| default.to_owned());
    let names = argument(0, "bowl").replace("all", &SHAPES.join(","));
    let side: usize = argument(1, "256").parse()?;
    let folder = argument(2, "fit_hollows");
    std::fs::create_dir_all(&folder)?;
    let mut out = std::io::stdout().lock();
    writeln!(
        out,
        "| shape | light | depth off in the hollow: outlines | with photographs | elsewhere | | mask IoU | | PSNR | | crossings | seconds | |"
    )?;
    writeln!(out, "|---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|")?;
    let mut tiles = Vec::new();
    for name in names.split(',') {
        let plain = shape(name)?;
        let painted = |mesh| marbled(&mesh, [[0.85, 0.75, 0.6], [0.25, 0.15, 0.3]], 4.0, 7);
        let truth = Normalize::UnitDiagonal.apply(if plain.colors.is_some() {
            plain
        } else {
            painted(plain)
        });
        for light in ["even", "still"] {
            let views = Views::in_memory(photographs(&truth, side, light == "still")?);
            let begun = Instant::now();
            let plain = fit(&views, &FitConfig::default(), &mut Watch::default())?;
            let between = Instant::now();
            let config = FitConfig { photometric: true, ..FitConfig::default() };
            let moved = fit(&views, &config, &mut Watch::default())?;
            let seconds = [(between - begun).as_secs_f64(), between.elapsed().as_secs_f64()];
            writeln!(out, "{}", line(name, light, &views, &truth, [&plain, &moved], seconds)?)?;
            write_mesh(Path::new(&folder).join(format!("{name}-{light}.ply")), &moved.mesh)?;
            tiles.push([[look(&truth)?, look(&plain.mesh)?, look(&moved.mesh)?]
                .into_iter()
                .flatten()
                .collect()]);
        }
    }
    let tiles: Vec<&[Vec<View>; 1]> = tiles.iter().collect();
    write_png(Path::new(&folder).join("sheet.png"), &sheet(&tiles, 1))?;
    Ok(())
}

/// Scores of the fit by outlines alone and of that with photographs, as a line of the table.
fn line(
    name: &str,
    light: &str,
    views: &Views,
    truth: &TriMesh,
    fits: [&Fitted; 2],
    seconds: [f64; 2],
) -> Result<String, Failure> {
    let held_out: Vec<&View> = fits[0].held_out_views.iter().map(|&i| &views.views[i]).collect();
    let (mut inside, mut outside, mut counts) = ([0.0f64; 2], [0.0f64; 2], [0usize; 2]);
    for view in &held_out {
        let [truth, plain, moved] =
            [truth, &fits[0].mesh, &fits[1].mesh].map(|m| depth(m, &view.camera));
        for ((t, p), m) in truth.iter().zip(&plain).zip(&moved) {
            if !(t.is_finite() && p.is_finite() && m.is_finite()) {
                continue;
            }
            let off = [(t - p).abs(), (t - m).abs()].map(f64::from);
            let hollow = usize::from(off[0] > f64::from(HOLLOW));
            let sums = if hollow == 1 { &mut inside } else { &mut outside };
            counts[hollow] += 1;
            for k in 0..2 {
                sums[k] += 1e3 * off[k];
            }
        }
    }
    let mean = |sums: [f64; 2], count: usize| sums.map(|s| s / count.max(1) as f64);
    let ([a, b], [c, d]) = (mean(inside, counts[1]), mean(outside, counts[0]));
    let scores = [
        score_views(&fits[0].mesh, &held_out, &|_, _| {})?,
        score_views(&fits[1].mesh, &held_out, &|_, _| {})?,
    ];
    let [e, f] = scores.each_ref().map(|s| s.mask_iou);
    let [g, h] = scores.each_ref().map(|s| s.psnr.unwrap_or(f64::NAN));
    Ok(format!(
        "| {name} | {light} | {a:.1} | {b:.1} | {c:.2} | {d:.2} | {e:.4} | {f:.4} | {g:.1} | {h:.1} | {} | {:.1} | {:.1} |",
        fits[1].self_intersections, seconds[0], seconds[1],
    ))
}

/// The depth of each pixel, infinite at the background.
fn depth(mesh: &TriMesh, camera: &Camera) -> Vec<f32> {
    let options = RenderOptions { depth: true, ..RenderOptions::default() };
    let views = render_views(mesh, std::slice::from_ref(camera), &options, &|_, _| {});
    let view = views.into_iter().flatten().next();
    view.and_then(|view| view.depth).map_or_else(Vec::new, |depth| depth.data)
}

fn photographs(truth: &TriMesh, side: usize, still: bool) -> Result<Vec<View>, Failure> {
    let orbit = Orbit {
        count: 40,
        target: [0.0; 3],
        distance: [1.6, 1.8],
        width: side,
        height: side,
        ..Orbit::default()
    };
    let mut views = Vec::new();
    for camera in orbit.cameras() {
        let lighting = if still { lamp_of(&camera) } else { Lighting::flat() };
        let options = RenderOptions { lighting, ..RenderOptions::default() };
        views.extend(render_views(truth, std::slice::from_ref(&camera), &options, &|_, _| {})?);
    }
    for (k, view) in views.iter_mut().enumerate() {
        view.name = k.to_string();
    }
    Ok(views)
}

/// A lamp above the camera's left shoulder: to the camera, the light stands still.
fn lamp_of(camera: &Camera) -> Lighting {
    let [x, y, z] = [-0.5, -0.8, -0.9];
    let r = &camera.rotation;
    let direction = std::array::from_fn(|k| (r[(0, k)] * x + r[(1, k)] * y + r[(2, k)] * z) as f32);
    Lighting { ambient: 0.45, lamps: vec![Lamp { direction, strength: 0.55 }], crease: 40.0 }
}

/// Vertices near enough to each other that colours on them show details of a pixel.
fn shape(name: &str) -> Result<TriMesh, Failure> {
    Ok(match name {
        // Half a ball, and half a smaller one taken out of it.
        "bowl" => turned(
            &[arc([0.0, 0.0], 1.0, -0.5 * PI, 0.0), arc([0.0, 0.0], 0.85, 0.0, -0.5 * PI)].concat(),
        ),
        "mug" => {
            turned(&[[0.0, -0.9], [0.7, -0.9], [0.7, 0.9], [0.6, 0.9], [0.6, -0.75], [0.0, -0.75]])
        }
        // A clock's: a tenth of its width deep.
        "dial" => turned(&[
            [0.0, -0.35],
            [1.0, -0.35],
            [1.0, 0.35],
            [0.85, 0.35],
            [0.85, 0.15],
            [0.0, 0.15],
        ]),
        "mask" => {
            let sockets = [[0.36, 0.2, 0.91], [-0.36, 0.2, 0.91]];
            icosphere(7).map_positions(|p: [f32; 3]| {
                let near = |at: &[f32; 3], width: f32| {
                    let away: f32 = p.iter().zip(at).map(|(a, b)| (a - b).powi(2)).sum();
                    (-away / (width * width)).exp()
                };
                let sunk: f32 = sockets.iter().map(|at| 0.25 * near(at, 0.22)).sum();
                let nose = 0.12 * near(&[0.0, -0.05, 1.0], 0.18);
                let grown = 1.0 - sunk + nose;
                [0.8 * grown * p[0], grown * p[1], 0.85 * grown * p[2]]
            })
        }
        "ball" => icosphere(7),
        _ => {
            let (family, seed) =
                name.split_once(':').ok_or("expected a shape, or a family:seed")?;
            return Ok(family.parse::<Family>()?.draw(seed.parse()?).mesh());
        }
    })
}

fn arc(center: [f32; 2], radius: f32, from: f32, to: f32) -> Vec<[f32; 2]> {
    let at = |k: usize| from + (to - from) * k as f32 / 60.0;
    let point = |angle: f32| {
        [(center[0] + radius * angle.cos()).max(0.0), center[1] + radius * angle.sin()]
    };
    (0..=60).map(|k| point(at(k))).collect()
}

/// The profile turned around its axis, in steps of a hundredth.
fn turned(profile: &[[f32; 2]]) -> TriMesh {
    let mut fine: Vec<[f32; 2]> = Vec::new();
    for pair in profile.windows(2) {
        let length = (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]);
        let parts = (length / 0.012).ceil().max(1.0);
        for k in 0..parts as usize {
            let share = k as f32 / parts;
            fine.push(std::array::from_fn(|c| pair[0][c] + share * (pair[1][c] - pair[0][c])));
        }
    }
    fine.extend(profile.last());
    let last = fine.len() - 1;
    for (k, point) in fine.iter_mut().enumerate() {
        point[0] = if k == 0 || k == last { 0.0 } else { point[0].max(1e-4) };
    }
    lathe(&fine, 400)
}

/// Gray, from above and from the front.
fn look(mesh: &TriMesh) -> Result<Vec<View>, Failure> {
    let gray = TriMesh { texture: None, ..mesh.clone() }.colored([0.7; 3]);
    let from = Orbit {
        count: 2,
        target: [0.0; 3],
        distance: [1.7, 1.7],
        elevation: [25.0, 60.0],
        width: TILE,
        height: TILE,
        ..Orbit::default()
    };
    let options = RenderOptions { lighting: Lighting::studio(), ..RenderOptions::default() };
    Ok(render_views(&gray, &from.cameras(), &options, &|_, _| {})?)
}
