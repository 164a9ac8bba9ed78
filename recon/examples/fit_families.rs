//! What a deformed sphere can become: fits objects of every family, and scores them on other views.
//!
//! `cargo run --release -p unsphere-recon --example fit_families -- [families] [seeds] [folder] [settings] [views]`
//!
//! Families are names with commas between them, or `all`; seeds run from 1. Without arguments one
//! car and one table are fitted; `all 3` takes five minutes and makes the documented table. Each object is fitted,
//! with the default configuration but for the settings (`"level=6 thin-parts=false"`), to 40 views of 256x256 from all
//! around, or as many as the last argument says, none held out, and scored on 8 others. The folder gets `table.md`, and `sheet.png` with each fitted mesh above the true one.
//!
//! The true meshes are made of parts that sink into each other. Chamfer distances count what is
//! hidden inside as well, which no image shows: they are upper bounds.

mod sheet;

use std::fmt::Write as _;
use std::path::Path;
use std::time::Instant;

use datasets::{View, Views};
use losses::metrics::{Preset, evaluate};
use mesh_core::{EmptyGrid, MedianOfEven, TriMesh, cubify, median, voxelize_solid, write_png};
use recon::evaluate::score_views;
use recon::fit::{FitConfig, Fitted, fit};
use recon::progress::Watch;
use synth::shapes::{Family, Shape};
use synth::{Lighting, Orbit, Placement, RenderOptions, render_views};

use sheet::sheet;

type Failure = Box<dyn std::error::Error>;

/// Side of a tile of the sheet, in pixels.
const TILE: usize = 192;

/// Cells along each side of the grid on which the parts of a true mesh are united.
const CELLS: usize = 256;

/// One object's line of the table.
struct Row {
    shape: Shape,
    iou: f64,
    /// Of the view that agrees least.
    worst: f64,
    chamfer: f64,
    watertight: bool,
    /// Of the fitted mesh, and of the union of the true one's parts.
    genus: [Option<usize>; 2],
    seconds: f64,
    /// The fitted mesh and the true one, from two sides each.
    tiles: [Vec<View>; 2],
}

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let argument =
        |k: usize, default: &str| arguments.get(k).cloned().unwrap_or_else(|| default.to_owned());
    let families: Vec<Family> = match argument(0, "car,table").as_str() {
        "all" => Family::ALL.to_vec(),
        names => names.split(',').map(str::parse).collect::<Result<_, _>>()?,
    };
    let seeds: u64 = argument(1, "1").parse()?;
    let folder = argument(2, "fit_families");
    let settings = format!("hold-out = 'none'\n{}", argument(3, "").replace(' ', "\n"));
    let config: FitConfig = toml::from_str(&settings)?;
    let count: usize = argument(4, "40").parse()?;
    std::fs::create_dir_all(&folder)?;

    let mut rows = Vec::new();
    for &family in &families {
        for seed in 1..=seeds {
            let row = measure(family.draw(seed), &config, count)?;
            let mut out = std::io::stdout().lock();
            std::io::Write::write_all(&mut out, line(&row).as_bytes())?;
            rows.push(row);
        }
    }
    let table = table(&rows, count, &arguments);
    mesh_core::io::write_atomic(Path::new(&folder).join("table.md"), |w| {
        w.write_all(table.as_bytes())
    })?;
    let tiles: Vec<&[Vec<View>; 2]> = rows.iter().map(|row| &row.tiles).collect();
    write_png(Path::new(&folder).join("sheet.png"), &sheet(&tiles, seeds as usize))?;
    Ok(())
}

/// Cameras at distances at which an object whose box has the diagonal 1 fills most of the image.
fn orbit(count: usize, placement: Placement) -> Orbit {
    Orbit { count, placement, target: [0.0; 3], distance: [1.6, 1.8], ..Orbit::default() }
}

/// Fits one object and compares it with the truth.
fn measure(shape: Shape, config: &FitConfig, count: usize) -> Result<Row, Failure> {
    let truth = shape.mesh();
    let look = RenderOptions { lighting: Lighting::studio(), ..RenderOptions::default() };
    let render =
        |mesh: &TriMesh, orbit: &Orbit| render_views(mesh, &orbit.cameras(), &look, &|_, _| {});
    let views = render(&truth, &orbit(count, Placement::Fibonacci))?;
    let views = Views::in_memory(views);
    let others = render(&truth, &Orbit { seed: 1, ..orbit(8, Placement::Random) })?;

    let start = Instant::now();
    let Fitted { mesh, health, .. } = fit(&views, config, &mut Watch::default())?;
    let seconds = start.elapsed().as_secs_f64();

    let others: Vec<&View> = others.iter().collect();
    let scores = score_views(&mesh, &others, &|_, _| {})?;
    let report = evaluate(&mesh, &truth, &Preset::OccNet.protocol(0))?;
    let front = Orbit {
        elevation: [20.0, 35.0],
        width: TILE,
        height: TILE,
        ..orbit(2, Placement::Fibonacci)
    };
    Ok(Row {
        iou: scores.mask_iou,
        worst: scores.views.iter().map(|v| v.mask_iou).fold(1.0, f64::min),
        chamfer: report.chamfer.unwrap_or(f64::NAN),
        watertight: health.is_watertight(),
        genus: [health.genus(), united(&truth).health().genus()],
        seconds,
        tiles: [render(&mesh, &front)?, render(&truth, &front)?],
        shape,
    })
}

/// The surface of the cells that any part of a mesh fills.
fn united(mesh: &TriMesh) -> TriMesh {
    let Some((low, high)) = mesh.bounds() else { return TriMesh::default() };
    let grid = voxelize_solid(mesh, [CELLS; 3], (low.map(|x| x - 0.01), high.map(|x| x + 0.01)));
    cubify(&grid, EmptyGrid::Nothing).split_nonmanifold()
}

fn line(row: &Row) -> String {
    let closed = if row.watertight { "yes" } else { "NO" };
    let [genus, united] =
        row.genus.map(|genus| genus.map_or_else(|| "none".into(), |g| g.to_string()));
    let traits: Vec<&str> = row.shape.traits.iter().map(|t| t.1.as_str()).collect();
    format!(
        "| {} | {} | {:.4} | {:.4} | {:.4} | {closed} | {genus} | {united} | {:.1} | {} |\n",
        row.shape.family,
        row.shape.seed,
        row.iou,
        row.worst,
        row.chamfer,
        row.seconds,
        traits.join(", ")
    )
}

fn table(rows: &[Row], count: usize, arguments: &[String]) -> String {
    let mut text = format!(
        "Fits of procedural objects: {count} views of 256x256 from all around, default configuration, \
         scored on 8 other views.\n\n`cargo run --release -p unsphere-recon --example fit_families -- {}`, \
         {} threads.\n\n| family | seed | mask IoU | worst view | Chamfer (occnet) | closed | genus \
         | of the union | seconds | drawn |\n|---|---|---|---|---|---|---|---|---|---|\n",
        arguments.join(" "),
        std::thread::available_parallelism().map_or(1, usize::from),
    );
    for row in rows {
        text.push_str(&line(row));
    }
    let of = |value: fn(&Row) -> f64| {
        median(rows.iter().map(value), MedianOfEven::Mean).unwrap_or(f64::NAN)
    };
    let closed = rows.iter().filter(|row| row.watertight).count();
    let _ = writeln!(
        text,
        "\nMedian mask IoU {:.4}, median Chamfer {:.4}, closed {closed} of {}, median time {:.1} s.",
        of(|r| r.iou),
        of(|r| r.chamfer),
        rows.len(),
        of(|r| r.seconds),
    );
    let failed: Vec<String> = rows
        .iter()
        .filter(|row| row.iou < 0.9)
        .map(|row| format!("{} {} ({:.3})", row.shape.family, row.shape.seed, row.iou))
        .collect();
    let _ = writeln!(
        text,
        "Below 0.9: {}.",
        if failed.is_empty() { "none".into() } else { failed.join(", ") }
    );
    text
}
