//! `unsphere capture`: photographs in, views out; cameras by COLMAP.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use datasets::{MaskSource, ReadOptions, Views, write_photos};
use mesh_core::{encode_png, read_image};
use recon::inspect::{ObjectInspection, inspect, write_report};
use serde::Serialize;
use train::output::{OutputFolder, disk};
use train::report::counted;

use crate::args::{Capture, Global, create};
use crate::colmap::{Asked, Colmap};
use crate::command::data::mask::photographs;
use crate::console::Console;
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::masks::{self, Made};
use crate::progress::Progress;
use crate::provenance::typed_command;

/// With fewer there is nothing to find.
const LEAST: usize = 3;
/// Files of COLMAP's model that are kept.
const MODEL: [&str; 5] = ["cameras.bin", "images.bin", "points3D.bin", "rigs.bin", "frames.bin"];

/// What is printed with `--json`.
#[derive(Debug, Serialize)]
struct Captured {
    #[serde(serialize_with = "train::path_text::serialize")]
    output: PathBuf,
    photographs: usize,
    /// How many of them have a camera now.
    views: usize,
    /// Names of those that have none.
    lost: Vec<String>,
    #[serde(flatten)]
    made: Made,
    /// For each view the share of its mask that the hull of all masks covers, on average.
    agreement: Option<f64>,
    problems: Vec<String>,
}

pub(crate) fn run(console: Console, global: Global, arguments: &Capture) -> Result<(), Failure> {
    let colmap = Colmap::find(&arguments.colmap, global.threads)?;
    let paths = photographs(&arguments.photographs)?;
    if paths.len() < LEAST {
        let (place, found) = (arguments.photographs.display(), paths.len());
        return Err(Failure::Input(format!(
            "{place}: found {} (.png, .jpg), expected {LEAST} at least, and 20 or more to make a mesh of",
            counted(found, "photograph")
        )));
    }
    let folder = create(&arguments.output, arguments.force)?;
    let interrupt = Interrupt::listen(Some(folder.unfinished()))?;
    let work = folder.path().join("work");
    let upright = upright(console, arguments, &paths, &work)?;
    // From now on there is a child to be stopped first.
    interrupt.worthwhile_saying("stopping: COLMAP is ended, and nothing is written");
    let progress = Progress::new(console, "colmap");
    let asked = Asked {
        lens: arguments.lens.name(),
        one_lens: upright.one_size,
        sequential: arguments.sequential,
    };
    let (model, _) =
        colmap.reconstruct(&work.join("images"), &work, asked, &interrupt, |step| {
            progress.say(step);
        })?;
    progress.finish();
    keep_model(&model, &folder, &work)?;
    let mut views = read_whole(console, &work)?;
    let names: BTreeSet<&str> = views.views.iter().map(|view| view.name.as_str()).collect();
    let lost: Vec<String> =
        upright.names.iter().filter(|name| !names.contains(name.as_str())).cloned().collect();
    let made = masks::make(console, &arguments.masking, &mut views.views, true)?;
    stopped(&interrupt)?;
    write_photos(&views.views, folder.path()).map_err(Failure::other)?;
    std::fs::remove_dir_all(&work).map_err(Failure::other)?;
    let found = inspected(&folder, &arguments.output)?;
    stopped(&interrupt)?;
    let output = folder.commit()?;
    let captured = Captured {
        output,
        photographs: paths.len(),
        views: views.len(),
        lost,
        made,
        agreement: found.agreement.hull_iou,
        problems: found.problems.into_iter().map(|problem| problem.message).collect(),
    };
    console.result(&captured, describe)
}

fn stopped(interrupt: &Interrupt) -> Result<(), Failure> {
    if interrupt.is_pressed() {
        return Err(Failure::Interrupted("nothing is written".to_owned()));
    }
    Ok(())
}

/// The photographs as they are to be seen.
struct Upright {
    /// Their names without endings, in order.
    names: Vec<String>,
    /// Whether all are of one size.
    one_size: bool,
}

/// Copies the photographs into `images` in the working folder, turned as they say and no larger than is wanted: what
/// reads them then need not know of orientations.
fn upright(
    console: Console,
    arguments: &Capture,
    paths: &[PathBuf],
    work: &Path,
) -> Result<Upright, Failure> {
    disk::make_folders(&work.join("images")).map_err(Failure::other)?;
    let progress = Progress::new(console, "read");
    let (mut names, mut sizes) = (Vec::new(), BTreeSet::new());
    for (done, path) in paths.iter().enumerate() {
        progress.set(done, paths.len());
        let mut image = read_image(path).map_err(Failure::input)?.over([0; 3]);
        let side = image.height.max(image.width);
        if let Some(most) = arguments.max_size.map(|n| n as usize).filter(|&most| side > most) {
            let [height, width] = image.size_within(most);
            image = image.resized(height, width);
        }
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        if names.contains(&name) {
            return Err(Failure::Input(format!("{}: a second image of that name", path.display())));
        }
        sizes.insert((image.height, image.width));
        let file = work.join("images").join(format!("{name}.png"));
        std::fs::write(&file, encode_png(&image))
            .map_err(|error| Failure::Other(format!("{}: {error}", file.display())))?;
        names.push(name);
    }
    progress.finish();
    Ok(Upright { names, one_size: sizes.len() == 1 })
}

/// Keeps the model, once to be read here and once for the user.
fn keep_model(model: &Path, folder: &OutputFolder, work: &Path) -> Result<(), Failure> {
    let places = [work.join("project/sparse/0"), folder.path().join("colmap")];
    for place in &places {
        disk::make_folders(place).map_err(Failure::other)?;
        for name in MODEL.iter().filter(|name| model.join(name).is_file()) {
            std::fs::copy(model.join(name), place.join(name)).map_err(Failure::other)?;
        }
    }
    std::fs::rename(work.join("images"), work.join("project/images")).map_err(Failure::other)
}

/// The views with their distortion undone; all of an image is mask.
fn read_whole(console: Console, work: &Path) -> Result<Views, Failure> {
    let options = ReadOptions { mask: MaskSource::Whole, ..ReadOptions::default() };
    let views = datasets::read_views(&work.join("project"), &options, &|_, _| ())?;
    views.warnings.iter().for_each(|warning| console.warn(warning));
    Ok(views)
}

/// What `data inspect` says of the views, with its page beside them.
fn inspected(folder: &OutputFolder, target: &Path) -> Result<ObjectInspection, Failure> {
    let options = ReadOptions::default();
    let dataset = datasets::open_with(folder.path(), &options)?;
    let mut inspection = inspect(dataset.as_ref(), 1, &options, &|_, _| ())?;
    target.clone_into(&mut inspection.path);
    let name = target.file_name().unwrap_or_default().to_string_lossy().into_owned();
    inspection.looked_at.iter_mut().for_each(|object| object.name.clone_from(&name));
    write_report(&inspection, &typed_command(), folder)?;
    Ok(inspection.looked_at.pop().unwrap_or_default())
}

fn describe(captured: &Captured) -> String {
    let Captured { output, photographs, views, lost, agreement, problems, .. } = captured;
    let mut text = format!(
        "{}: {} of {}\n",
        output.display(),
        counted(*views, "view"),
        counted(*photographs, "photograph")
    );
    if !lost.is_empty() {
        let _ = writeln!(text, "  no camera found for {}", lost.join(", "));
    }
    if let Some(agreement) = agreement {
        let _ = writeln!(text, "  cameras and masks agree to {:.1} %", 100.0 * agreement);
    }
    for problem in problems {
        let _ = writeln!(text, "  problem: {problem}");
    }
    text + &format!(
        "{}\nunsphere fit {} -o mesh makes a mesh of them\n",
        output.join("report.html").display(),
        output.display()
    )
}
