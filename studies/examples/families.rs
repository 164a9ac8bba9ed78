//! What holds back the 3D IoU of MCMR, family by family.
//!
//! `cargo run --release -p unsphere-studies --example families -- WEIGHTS [data=FOLDER] [split=test]`: for each family the scores of
//! the network as it is, with the mean shape of its family told by an oracle, with nothing added to the mean shapes, and with the
//! camera of another object; how wide, high and long its meshes and the true ones are; then how the true shapes compare with each other under the same two measures, which no network has
//! part in: with those of the family's other objects, in the mean and of the most alike, and with themselves: a little moved, a
//! little narrower, and with all that one can look through from the side closed, as a sphere that is deformed has it. Last, which mean shape the objects of each family have most of.

use std::collections::VecDeque;
use std::error::Error;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::PathBuf;
use std::sync::Arc;

use datasets::ReadOptions;
use losses::metrics::{McmrAlignment, mcmr_iou, voxel_iou};
use mesh_core::{EmptyGrid, TriMesh, VoxelGrid, bounds, cubify, voxelize_enclosed};
use models::mcmr::{Data, Mcmr, Replaced, Scored, Selection};
use train::{Checkpoint, DataError, Source, Subset};

/// Cells along the longest edge for the strict 3D IoU, as in MCMR's scores.
const CELLS: usize = 32;
/// Cells along the longest edge of the grid on which openings are closed.
const FINE: usize = 128;
/// By how much of the grid's side a true shape is moved that is compared with itself: a cell.
const MOVED: f32 = 1.0 / 32.0;
/// Of a true shape's widths, what a narrower one has.
const NARROWER: f32 = 0.9;

type Failure = Box<dyn Error>;

fn main() -> Result<(), Failure> {
    let mut arguments = std::env::args().skip(1);
    let weights = PathBuf::from(arguments.next().ok_or("WEIGHTS is expected")?);
    let (mut path, mut subset) = (None, Subset::Validation);
    for argument in arguments {
        match argument.split_once('=') {
            Some(("data", folder)) => path = Some(PathBuf::from(folder)),
            Some(("split", "test")) => subset = Subset::Test,
            Some(("split", "validation")) => subset = Subset::Validation,
            _ => return Err("data=FOLDER, split=test or split=validation is expected".into()),
        }
    }
    let (system, config) = Checkpoint::read(&weights)?.load::<Mcmr>()?;
    let options = ReadOptions::default();
    let seed = config.train.seed;
    let source = Source { path: path.as_deref(), options: &options, seed, progress: &|_, _| () };
    let data = Data::open(&config.system, &source)?;
    let as_it_is = system.scored(&data, subset)?;
    let mut text = scores(&system, &data, subset, &as_it_is)?;
    text += &sides(&data, &as_it_is)?;
    text += &truths(&data, subset)?;
    text += &selections(&data, &as_it_is);
    std::io::stdout().write_all(text.as_bytes())?;
    Ok(())
}

/// The network's scores, as it is and with something else in the place of a part.
fn scores(
    system: &Mcmr,
    data: &Data,
    subset: Subset,
    as_it_is: &Scored,
) -> Result<String, DataError> {
    let mut ways = vec![("as it is", as_it_is.clone())];
    if system.config().shapes > 1 {
        let selection = Selection::oracle(system, data, Subset::Validation)?;
        let told = Replaced { selection, ..Replaced::default() };
        ways.push(("family told", system.scored_with(data, subset, &told)?));
    }
    let bare = Replaced { undeformed: true, ..Replaced::default() };
    ways.push(("nothing added", system.scored_with(data, subset, &bare)?));
    let other = Replaced { camera_of_another: true, ..Replaced::default() };
    ways.push(("another's camera", system.scored_with(data, subset, &other)?));

    let mut text = "| family | | objects | mask IoU, predicted; true camera | 3D IoU, published; strict | camera, mean; median | flipped |\n\
                    |---|---|--:|--:|--:|--:|--:|\n"
        .to_owned();
    for (kind, family) in data.categories().iter().enumerate() {
        for (way, scored) in &ways {
            line(&mut text, family, way, &scored.of_kind(kind));
        }
    }
    for (way, scored) in &ways {
        line(&mut text, "all", way, scored);
    }
    Ok(text)
}

fn line(text: &mut String, family: &str, way: &str, scored: &Scored) {
    let mean = |of: fn(&models::mcmr::ScoredObject) -> Option<f64>| {
        scored.mean(of).map_or_else(|| "-".to_owned(), |value| format!("{value:.3}"))
    };
    let (iou, iou_true) = (mean(|one| Some(one.mask_iou)), mean(|one| Some(one.mask_iou_true)));
    let (published, strict) = (mean(|one| one.iou_3d), mean(|one| one.iou_3d_strict));
    let camera = scored.mean(|one| one.rotation_symmetric).unwrap_or(f64::NAN);
    let median = scored.median(|one| one.rotation_symmetric).unwrap_or(f64::NAN);
    let flipped = mean(|one| one.flipped.map(|is| f64::from(u8::from(is))));
    let objects = scored.each.len();
    _ = writeln!(
        text,
        "| {family} | {way} | {objects} | {iou}; {iou_true} | {published}; {strict} | {camera:.1}°; {median:.1}° | {flipped} |"
    );
}

/// How wide, high and long the objects of each family are in the mean, as they are predicted and in truth.
fn sides(data: &Data, scored: &Scored) -> Result<String, DataError> {
    let mut text = "\n| family | predicted: wide; high; long | true |\n|---|--:|--:|\n".to_owned();
    for (kind, family) in data.categories().iter().enumerate() {
        let (mut predicted, mut known) = (Vec::new(), Vec::new());
        for one in scored.each.iter().filter(|one| one.kind == kind) {
            if let Some(bounds) = data.truth(one.object)?.and_then(|truth| truth.bounds()) {
                predicted.push(one.sides);
                known.push(bounds::sides(bounds));
            }
        }
        let mean = |all: &[[f32; 3]]| {
            let side = |k: usize| all.iter().map(|sides| sides[k]).sum::<f32>() / all.len() as f32;
            let [wide, high, long] = [0, 1, 2].map(side);
            format!("{wide:.3}; {high:.3}; {long:.3}")
        };
        _ = writeln!(text, "| {family} | {} | {} |", mean(&predicted), mean(&known));
    }
    Ok(text)
}

/// How the true shapes of a family compare with each other and with themselves.
fn truths(data: &Data, subset: Subset) -> Result<String, DataError> {
    let mut text = "\n| family | | 3D IoU, published; strict |\n|---|---|--:|\n".to_owned();
    for (kind, family) in data.categories().iter().enumerate() {
        let of = |subset: Subset| -> Result<Vec<Arc<TriMesh>>, DataError> {
            let objects = data.listed(subset).iter().filter(|&&o| data.category(o).0 == kind);
            objects.filter_map(|&object| data.truth(object).transpose()).collect()
        };
        let scored = of(subset)?;
        let other = of(if subset == Subset::Test { Subset::Validation } else { Subset::Test })?;
        let pairs = scored.iter().map(|truth| {
            let ious = other.iter().map(|mesh| (iou(mesh, truth), voxel_iou(mesh, truth, CELLS)));
            ious.collect::<Vec<_>>()
        });
        let pairs: Vec<Vec<(f64, f64)>> = pairs.collect();
        let best = |row: &Vec<(f64, f64)>| {
            row.iter()
                .fold((0.0, 0.0), |best: (f64, f64), one| (best.0.max(one.0), best.1.max(one.1)))
        };
        let changed = |change: fn(&TriMesh) -> TriMesh| {
            mean(scored.iter().map(|truth| {
                let mesh = change(truth);
                (mcmr_iou(&mesh, truth, McmrAlignment::IDENTITY), voxel_iou(&mesh, truth, CELLS))
            }))
        };
        let rows = [
            ("another object's shape", mean(pairs.iter().flatten().copied())),
            ("the most alike of the others", mean(pairs.iter().map(best))),
            ("itself, a cell higher", changed(|mesh| placed(mesh, |[x, y, z]| [x, y + MOVED, z]))),
            (
                "itself, a tenth narrower",
                changed(|mesh| placed(mesh, |[x, y, z]| [NARROWER * x, y, z])),
            ),
            ("itself, openings closed", changed(closed)),
        ];
        for (name, (published, strict)) in rows {
            _ = writeln!(text, "| {family} | {name} | {published:.3}; {strict:.3} |");
        }
    }
    Ok(text)
}

fn placed(mesh: &TriMesh, place: fn([f32; 3]) -> [f32; 3]) -> TriMesh {
    TriMesh::new(mesh.positions.iter().map(|&p| place(p)).collect(), mesh.faces.clone())
}

/// A shape with everything closed that one can look through along x: an opening is as wide as what is nearest to it.
fn closed(mesh: &TriMesh) -> TriMesh {
    let axis = |k: usize| mesh.positions.iter().map(move |p| p[k]);
    let low: [f32; 3] = std::array::from_fn(|k| axis(k).fold(f32::INFINITY, f32::min));
    let high: [f32; 3] = std::array::from_fn(|k| axis(k).fold(f32::NEG_INFINITY, f32::max));
    let cell = (0..3).map(|k| high[k] - low[k]).fold(0.0, f32::max) / FINE as f32;
    // An empty cell all around, from which the outside is found.
    let dims = std::array::from_fn(|k| ((high[k] - low[k]) / cell).ceil() as usize + 2);
    let low = low.map(|v| v - cell);
    let high = std::array::from_fn(|k| low[k] + cell * dims[k] as f32);
    let mut grid = voxelize_enclosed(mesh, dims, (low, high));
    close_along_x(&mut grid, dims);
    cubify(&grid, EmptyGrid::Nothing)
}

fn close_along_x(grid: &mut VoxelGrid, [nx, ny, nz]: [usize; 3]) {
    let at = |y: usize, z: usize| y * nz + z;
    let neighbors = |(y, z): (usize, usize)| {
        let shift = [(0, 1), (2, 1), (1, 0), (1, 2)];
        let all =
            shift.into_iter().map(move |(a, b)| ((y + a).wrapping_sub(1), (z + b).wrapping_sub(1)));
        all.filter(|&(y, z)| y < ny && z < nz)
    };
    // The first and the last filled cell of each row.
    let mut widths: Vec<Option<(usize, usize)>> = Vec::with_capacity(ny * nz);
    for (y, z) in (0..ny).flat_map(|y| (0..nz).map(move |z| (y, z))) {
        let mut filled = (0..nx).filter(|&x| grid.get([x, y, z]));
        widths.push(filled.next().map(|first| (first, filled.next_back().unwrap_or(first))));
    }
    let mut outside = vec![false; ny * nz];
    outside[at(0, 0)] = true;
    let mut pending = VecDeque::from([(0, 0)]);
    while let Some(place) = pending.pop_front() {
        for (y, z) in neighbors(place) {
            if widths[at(y, z)].is_none() && !std::mem::replace(&mut outside[at(y, z)], true) {
                pending.push_back((y, z));
            }
        }
    }
    let filled = |&(y, z): &(usize, usize)| widths[at(y, z)].is_some();
    let mut pending: VecDeque<_> =
        (0..ny).flat_map(|y| (0..nz).map(move |z| (y, z))).filter(filled).collect();
    while let Some(place) = pending.pop_front() {
        let width = widths[at(place.0, place.1)];
        for (y, z) in neighbors(place) {
            if widths[at(y, z)].is_none() && !outside[at(y, z)] {
                widths[at(y, z)] = width;
                pending.push_back((y, z));
            }
        }
    }
    for (y, z) in (0..ny).flat_map(|y| (0..nz).map(move |z| (y, z))) {
        let Some((first, last)) = widths[at(y, z)] else { continue };
        for x in first..=last {
            let cell = grid.index([x, y, z]);
            grid.bits[cell] = true;
        }
    }
}

/// The published 3D IoU of a pair by itself.
fn iou(mesh: &TriMesh, truth: &TriMesh) -> f64 {
    let alignment = McmrAlignment::of(mesh, truth).unwrap_or(McmrAlignment::IDENTITY);
    mcmr_iou(mesh, truth, alignment)
}

fn mean(pairs: impl Iterator<Item = (f64, f64)>) -> (f64, f64) {
    let (mut sum, mut count) = ((0.0, 0.0), 0.0);
    for (published, strict) in pairs {
        sum = (sum.0 + published, sum.1 + strict);
        count += 1.0;
    }
    (sum.0 / count, sum.1 / count)
}

/// How many objects of each family have most of which mean shape.
fn selections(data: &Data, scored: &Scored) -> String {
    let shapes = scored.each.first().map_or(0, |one| one.weights.len());
    let mut text = format!("\npurity {:.3}\n\n| family |", scored.purity());
    (0..shapes).for_each(|shape| _ = write!(text, " {shape} |"));
    _ = writeln!(text, "\n|---|{}", "--:|".repeat(shapes));
    for (kind, family) in data.categories().iter().enumerate() {
        let mut counts = vec![0; shapes];
        for one in scored.each.iter().filter(|one| one.kind == kind) {
            let most = |a: &usize, b: &usize| one.weights[*a].total_cmp(&one.weights[*b]);
            if let Some(shape) = (0..shapes).max_by(most) {
                counts[shape] += 1;
            }
        }
        _ = write!(text, "| {family} |");
        for count in counts {
            _ = write!(text, " {count} |");
        }
        text.push('\n');
    }
    text
}
