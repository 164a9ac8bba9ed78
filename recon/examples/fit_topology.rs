//! Shapes with holes, and objects from files: fits each, and scores it on the views that were held out.
//!
//! `cargo run --release -p unsphere-recon --example fit_topology -- [names] [side] [folder] [auto|sphere]`
//!
//! Names are with commas between them: `torus`, `double`, `cup`, `link`, `ring`, `trefoil`, `links`, `all` of these, a family
//! with a seed as in `bicycle:1`, or a file with a mesh. Each is drawn in 40 views of `side` pixels (256) from all around, of
//! which every fifth is held out. The folder gets `NAME.ply` and `sheet.png`, with each fitted mesh above the true one.

mod sheet;

use std::f32::consts::TAU;
use std::io::Write as _;
use std::path::Path;
use std::time::Instant;

use datasets::{View, Views};
use losses::metrics::voxel_iou;
use mesh_core::io::{read_mesh, write_mesh};
use mesh_core::primitives::{TubeEnds, cylinder, torus, tube};
use mesh_core::{TriMesh, write_png};
use recon::evaluate::score_views;
use recon::fit::{FitConfig, TopologyKind, fit};
use recon::progress::Watch;
use synth::generate::Normalize;
use synth::shapes::Family;
use synth::{Lighting, Orbit, RenderOptions, render_views};

use sheet::sheet;

type Failure = Box<dyn std::error::Error>;

/// Side of a tile of the sheet, in pixels.
const TILE: usize = 256;
/// Cells along the side of the grid that volumes are compared on.
const CELLS: usize = 128;
const SHAPES: [&str; 7] = ["torus", "double", "cup", "link", "ring", "trefoil", "links"];

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let argument =
        |k: usize, default: &str| arguments.get(k).cloned().unwrap_or_else(|| default.to_owned());
    let names = argument(0, "all").replace("all", &SHAPES.join(","));
    let side: usize = argument(1, "256").parse()?;
    let folder = argument(2, "fit_topology");
    let topology = match argument(3, "auto").as_str() {
        "sphere" => TopologyKind::Sphere,
        _ => TopologyKind::Auto,
    };
    std::fs::create_dir_all(&folder)?;
    let mut out = std::io::stdout().lock();
    writeln!(
        out,
        "| shape | mask IoU | worst view | 3D IoU | genus | parts | crossings | vertices | seconds |"
    )?;
    writeln!(out, "|---|--:|--:|--:|--:|--:|--:|--:|--:|")?;
    let mut tiles = Vec::new();
    for name in names.split(',') {
        let (line, pair) = measure(name, side, &folder, topology)?;
        out.write_all(line.as_bytes())?;
        tiles.push(pair);
    }
    let tiles: Vec<&[Vec<View>; 2]> = tiles.iter().collect();
    write_png(Path::new(&folder).join("sheet.png"), &sheet(&tiles, 4))?;
    Ok(())
}

/// Fits one object; its line of the table, and the fitted mesh and the true one from two sides.
fn measure(
    name: &str,
    side: usize,
    folder: &str,
    topology: TopologyKind,
) -> Result<(String, [Vec<View>; 2]), Failure> {
    let truth = Normalize::UnitDiagonal.apply(colored(shape(name)?));
    let look = RenderOptions { lighting: Lighting::studio(), ..RenderOptions::default() };
    let orbit = |count: usize, side: usize| Orbit {
        count,
        target: [0.0; 3],
        distance: [1.6, 1.8],
        width: side,
        height: side,
        ..Orbit::default()
    };
    let views = render_views(&truth, &orbit(40, side).cameras(), &look, &|_, _| {})?;
    let views = Views::in_memory(views);
    let config = FitConfig { topology, ..FitConfig::default() };
    let start = Instant::now();
    let fitted = fit(&views, &config, &mut Watch::default())?;
    let seconds = start.elapsed().as_secs_f64();
    let held_out: Vec<&View> = fitted.held_out_views.iter().map(|&i| &views.views[i]).collect();
    let scores = score_views(&fitted.mesh, &held_out, &|_, _| {})?;
    let worst = scores.views.iter().map(|v| v.mask_iou).fold(1.0, f64::min);
    let stem = Path::new(name).file_stem().map_or_else(|| name.into(), |s| s.to_string_lossy());
    write_mesh(Path::new(folder).join(format!("{}.ply", stem.replace(':', "-"))), &fitted.mesh)?;
    let line = format!(
        "| {stem} | {:.4} | {worst:.4} | {:.4} | {} | {} | {} | {} | {seconds:.1} |\n",
        scores.mask_iou,
        voxel_iou(&fitted.mesh, &truth, CELLS),
        fitted.health.genus().map_or_else(|| "none".into(), |g| g.to_string()),
        fitted.health.components,
        fitted.self_intersections,
        fitted.health.vertices,
    );
    let from = Orbit { elevation: [20.0, 35.0], ..orbit(2, TILE) };
    let render = |mesh: &TriMesh| render_views(mesh, &from.cameras(), &look, &|_, _| {});
    let gray = |mesh: &TriMesh| TriMesh { texture: None, ..mesh.clone() }.colored([0.7; 3]);
    Ok((line, [render(&gray(&fitted.mesh))?, render(&gray(&truth))?]))
}

fn shape(name: &str) -> Result<TriMesh, Failure> {
    let loop_of = |at: &dyn Fn(f32) -> [f32; 3], radius: f32| {
        let path: Vec<[f32; 3]> = (0..240).map(|i| at(TAU * i as f32 / 240.0)).collect();
        tube(&path, &[radius], 32, TubeEnds::Loop)
    };
    Ok(match name {
        "torus" => torus(1.0, 0.35, 96, 48),
        "double" => {
            both(torus(0.6, 0.22, 96, 48), &torus(0.6, 0.22, 96, 48).translated([1.2, 0.0, 0.0]))?
        }
        "cup" => {
            let handle = loop_of(&|t| [0.75 + 0.5 * t.cos(), 0.5 * t.sin(), 0.0], 0.12);
            both(cylinder(0.7, 1.8, 96), &handle)?
        }
        "link" => loop_of(
            &|t| [t.cos() + 0.8 * t.cos().signum() * t.cos().abs().sqrt(), t.sin(), 0.0],
            0.3,
        ),
        "ring" => {
            // A short pipe with rounded edges.
            let square = |[x, y, z]: [f32; 3]| {
                let (away, out) = (x.hypot(z), x.hypot(z) - 0.6);
                let round = (out.powi(6) + y.powi(6)).powf(1.0 / 6.0) / out.hypot(y);
                let share = (0.6 + out / round) / away;
                [share * x, 1.6 * y / round, share * z]
            };
            torus(0.6, 0.3, 96, 64).map_positions(square)
        }
        "trefoil" => loop_of(
            &|t| {
                [t.sin() + 2.0 * (2.0 * t).sin(), t.cos() - 2.0 * (2.0 * t).cos(), -(3.0 * t).sin()]
            },
            0.45,
        ),
        "links" => {
            let ring = |t: f32| [t.cos(), t.sin(), 0.0];
            both(loop_of(&ring, 0.2), &loop_of(&|t| [t.cos() + 1.0, 0.0, t.sin()], 0.2))?
        }
        _ => match name.split_once(':') {
            Some((family, seed)) => family.parse::<Family>()?.draw(seed.parse()?).mesh(),
            None => read_mesh(name)?,
        },
    })
}

fn both(mut first: TriMesh, second: &TriMesh) -> Result<TriMesh, Failure> {
    first.append(second)?;
    Ok(first)
}

/// Plain shapes are coloured by place, so that a colour is seen where it belongs.
fn colored(mesh: TriMesh) -> TriMesh {
    if mesh.colors.is_some() || mesh.texture.is_some() {
        return mesh;
    }
    let color = |p: &[f32; 3]| p.map(|x| (0.5 + 0.4 * (3.0 * x).sin()).clamp(0.0, 1.0));
    let colors = mesh.positions.iter().map(color).collect();
    TriMesh { colors: Some(colors), ..mesh }
}
