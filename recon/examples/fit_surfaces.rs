//! Round surfaces and flat ones: how far the normals of fitted meshes are from the true ones.
//!
//! `cargo run --release -p unsphere-recon --example fit_surfaces -- [names] [side] [folder] [settings]`
//!
//! Names are with commas between them: `sphere`, `torus`, `blob`, `box`, `part`, or `all` of these. Each is drawn in 40 views of `side` pixels
//! (256) from all around, of which every fifth is held out. Normals are those of the fitted faces at points all over the surface,
//! each beside that of the nearest point of the true one; of flat sides only what is farther than two pixels from an edge. Settings,
//! as in `bending=1 level=6`, are those of a configuration file. The folder gets `NAME.ply` and `sheet.png`, fitted and true.

mod sheet;

use std::io::Write as _;
use std::path::Path;
use std::time::Instant;

use datasets::{View, Views};
use mesh_core::primitives::{cuboid, icosphere, torus};
use mesh_core::vector::dot;
use mesh_core::{Topology, TriMesh, face_normals, nearest, sample_surface, write_mesh, write_png};
use recon::evaluate::score_views;
use recon::fit::{FitConfig, fit};
use recon::progress::Watch;
use synth::generate::Normalize;
use synth::{Lighting, Orbit, RenderOptions, render_views};

use sheet::sheet;

type Failure = Box<dyn std::error::Error>;

const TILE: usize = 256;
const SHAPES: [&str; 5] = ["sphere", "torus", "blob", "box", "part"];
/// Points of the fitted surface, and of the true one.
const POINTS: [usize; 2] = [20_000, 400_000];
/// A pixel's share of an edge that flat sides are not judged at.
const AWAY: f32 = 2.0;
/// Neighbouring faces that differ by more, in degrees, meet in an edge.
const EDGE: f32 = 20.0;

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let argument =
        |k: usize, default: &str| arguments.get(k).cloned().unwrap_or_else(|| default.to_owned());
    let names = argument(0, "all").replace("all", &SHAPES.join(","));
    let side: usize = argument(1, "256").parse()?;
    let folder = argument(2, "fit_surfaces");
    let config: FitConfig = toml::from_str(&argument(3, "").replace(' ', "\n"))?;
    std::fs::create_dir_all(&folder)?;
    let mut out = std::io::stdout().lock();
    writeln!(
        out,
        "| shape | normals off, mean | 95 % within | beyond 3 | mask IoU | vertices | seconds |"
    )?;
    writeln!(out, "|---|--:|--:|--:|--:|--:|--:|")?;
    let mut tiles = Vec::new();
    for name in names.split(',') {
        let truth = Normalize::UnitDiagonal.apply(shape(name)?);
        let orbit = Orbit {
            count: 40,
            target: [0.0; 3],
            distance: [1.6, 1.8],
            width: side,
            height: side,
            ..Orbit::default()
        };
        let pixel = (2.0 * 1.7 * (0.5 * orbit.fov_y.to_radians()).tan() / side as f64) as f32;
        let look = RenderOptions { lighting: Lighting::studio(), ..RenderOptions::default() };
        let views = Views::in_memory(render_views(&truth, &orbit.cameras(), &look, &|_, _| {})?);
        let start = Instant::now();
        let fitted = fit(&views, &config, &mut Watch::default())?;
        let seconds = start.elapsed().as_secs_f64();
        let held_out: Vec<&View> = fitted.held_out_views.iter().map(|&i| &views.views[i]).collect();
        let iou = score_views(&fitted.mesh, &held_out, &|_, _| {})?.mask_iou;
        let mut angles = angles(&fitted.mesh, &truth, AWAY * pixel);
        angles.sort_by(f32::total_cmp);
        let mean = angles.iter().sum::<f32>() / angles.len() as f32;
        let beyond = angles.iter().filter(|&&a| a > 3.0).count() as f32 / angles.len() as f32;
        writeln!(
            out,
            "| {name} | {mean:.2} | {:.1} | {:.1} % | {iou:.4} | {} | {seconds:.1} |",
            angles[angles.len() * 95 / 100],
            100.0 * beyond,
            fitted.health.vertices,
        )?;
        write_mesh(Path::new(&folder).join(format!("{name}.ply")), &fitted.mesh)?;
        let from = Orbit { count: 2, elevation: [20.0, 35.0], width: TILE, height: TILE, ..orbit };
        let mut sides = Vec::new();
        for mesh in [&fitted.mesh, &truth] {
            let gray = TriMesh { texture: None, ..mesh.clone() }.colored([0.7; 3]);
            sides.extend(render_views(&gray, &from.cameras(), &look, &|_, _| {})?);
        }
        tiles.push([sides]);
    }
    let tiles: Vec<&[Vec<View>; 1]> = tiles.iter().collect();
    write_png(Path::new(&folder).join("sheet.png"), &sheet(&tiles, 1))?;
    Ok(())
}

/// Degrees between a fitted face's normal and the true one, at points all over the surface but for those this near to a true edge.
fn angles(fitted: &TriMesh, truth: &TriMesh, away: f32) -> Vec<f32> {
    let surface = |mesh: &TriMesh, count: usize| -> (Vec<[f32; 3]>, Vec<[f32; 3]>) {
        let normals = face_normals(&mesh.positions, &mesh.faces);
        let points = sample_surface(mesh, count, 1);
        points.iter().map(|p| (p.position(mesh), normals[p.face as usize])).unzip()
    };
    let ((points, found), (places, wanted)) =
        (surface(fitted, POINTS[0]), surface(truth, POINTS[1]));
    let edges = edges(truth);
    let near = |p: [f32; 3]| edges.iter().any(|&[a, b]| distance(p, a, b) < away);
    let pairs = nearest(&points, &places);
    let angle = |(k, nearest): (usize, &mesh_core::Nearest)| {
        let cos = dot(found[k], wanted[nearest.index as usize]).clamp(-1.0, 1.0);
        (!near(points[k])).then(|| cos.acos().to_degrees())
    };
    pairs.iter().enumerate().filter_map(angle).collect()
}

/// Where neighbouring faces differ much.
fn edges(mesh: &TriMesh) -> Vec<[[f32; 3]; 2]> {
    let normals = face_normals(&mesh.positions, &mesh.faces);
    let topology = Topology::of(mesh);
    let sharp = |faces: &[u32; 2]| {
        let [a, b] = faces.map(|face| face as usize);
        !faces.contains(&Topology::NONE) && dot(normals[a], normals[b]) < EDGE.to_radians().cos()
    };
    let sides = topology.edges.iter().zip(&topology.edge_faces);
    let sharp = sides.filter(|(_, faces)| sharp(faces));
    sharp.map(|(ends, _)| ends.map(|v| mesh.positions[v as usize])).collect()
}

/// From a point to a segment.
fn distance(p: [f32; 3], a: [f32; 3], b: [f32; 3]) -> f32 {
    let [along, to]: [[f32; 3]; 2] =
        [std::array::from_fn(|k| b[k] - a[k]), std::array::from_fn(|k| p[k] - a[k])];
    let t = (dot(along, to) / dot(along, along).max(1e-12)).clamp(0.0, 1.0);
    let off: [f32; 3] = std::array::from_fn(|k| to[k] - t * along[k]);
    dot(off, off).sqrt()
}

fn shape(name: &str) -> Result<TriMesh, Failure> {
    Ok(match name {
        "sphere" => icosphere(6),
        "torus" => torus(1.0, 0.35, 192, 96),
        // A pebble with a waist and bumps.
        "blob" => icosphere(6).map_positions(|[x, y, z]: [f32; 3]| {
            let bump =
                1.0 + 0.12 * (5.0 * x + 1.0).sin() * (4.0 * z).cos() + 0.18 * (3.0 * y).cos();
            [0.8 * bump * x, 0.9 * bump * y, 0.65 * bump * z]
        }),
        "box" => cuboid([1.2, 0.8, 0.6]),
        // An angle iron with a step.
        "part" => prism(
            &[
                [0.0, 0.0],
                [1.2, 0.0],
                [1.2, 0.3],
                [0.7, 0.3],
                [0.7, 0.55],
                [0.3, 0.55],
                [0.3, 1.0],
                [0.0, 1.0],
            ],
            0.7,
        ),
        _ => return Err(format!("{name}: expected one of {}", SHAPES.join(", ")).into()),
    })
}

/// The polygon, all of which its first corner sees, pulled up to this height.
fn prism(outline: &[[f32; 2]], height: f32) -> TriMesh {
    let count = outline.len() as u32;
    let at = |z: f32| outline.iter().map(move |&[x, y]| [x, y, z]);
    let positions = at(0.0).chain(at(height)).collect();
    let side = |k: u32| {
        let [a, b] = [k, (k + 1) % count];
        [[a, b, count + b], [a, count + b, count + a]]
    };
    let end = |k: u32| [[0, k + 1, k], [count, count + k, count + k + 1]];
    let faces = (0..count).flat_map(side).chain((1..count - 1).flat_map(end)).collect();
    TriMesh::new(positions, faces)
}
