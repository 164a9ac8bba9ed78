//! The talk's tables.

mod mean_shapes;
mod real;
mod subdivision;

pub use mean_shapes::MeanShapesStudy;
pub use real::{CUB, PASCAL, RealStudy};
pub use subdivision::SubdivisionStudy;

use models::mcmr::{Data, Mcmr, McmrConfig, Scored, ScoredObject};
use train::Configuration;

use crate::preset::{Change, Planned, scaled, tenth};
use crate::{Cell, Row, Scale, Score, Study, Trained};

/// The studies of this module, in the order of lists.
pub const STUDIES: &[&dyn Study] = &[&MeanShapesStudy, &SubdivisionStudy, &PASCAL, &CUB];

/// What makes the quick ones quick.
const QUICK: &[Change] = &[
    ("max-steps", "70"),
    ("epochs", "1000"),
    ("warmup", "5"),
    ("validation-every", "none"),
    ("samples-every", "none"),
    ("width", "8"),
    ("features", "32"),
    ("texture-width", "2"),
    ("hidden", "32"),
    ("objects", "12"),
    ("test-objects", "6"),
];

/// How many times the error that was found the quick ones may have: what was not trained has 1.3 times.
const QUICK_TIMES: f64 = 1.1;

/// Jobs at a scale: what happens in an epoch comes earlier in shorter trainings.
fn at_scale(scale: Scale, jobs: Vec<Planned<Mcmr>>) -> Vec<Planned<Mcmr>> {
    let mut jobs = scaled::<Mcmr>(scale, jobs);
    if scale == Scale::Tenth {
        let config = |(.., config): &mut Planned<Mcmr>| {
            let Configuration::<McmrConfig> { system, .. } = config;
            system.subdivide_at = system.subdivide_at.map(tenth);
            system.own_cameras_at = system.own_cameras_at.map(tenth);
        };
        jobs.iter_mut().for_each(config);
    }
    jobs
}

/// The figures of the talk for a row, in the order of its columns: 3D IoU, mask IoU with the predicted and with the true
/// camera, SSIM, L1, FID; what it does not have is not a number.
type Published = [f64; 6];

const COLUMNS: [&str; 7] = [
    "3D IoU",
    "3D IoU, strict",
    "mask IoU, predicted camera",
    "mask IoU, true camera",
    "SSIM",
    "L1",
    "FID",
];

/// The columns that claims are about.
const IOU_3D: &str = COLUMNS[0];
const IOU_3D_STRICT: &str = COLUMNS[1];
const MASK: [&str; 2] = [COLUMNS[2], COLUMNS[3]];

/// What the columns are, for captions.
const ABOUT: &str = "Objects that were not trained on. 3D IoU: the published protocol (32³ cells, the mean alignment of a category), and strict \
                     (nothing aligned). Mask IoU: pixels' centres against masks from one half on. SSIM, L1, FID: renderings with the \
                     true camera against masked photographs; no FID without Inception's weights.";

/// A figure of an object, if it has it.
type Figure = fn(&ScoredObject) -> Option<f64>;

/// A cell with the mean of a figure and its values by object.
fn figure(cell: impl Fn(f64) -> Cell, data: &Data, scored: &Scored, of: Figure) -> Cell {
    let value = scored.mean(of);
    let each = scored.each.iter();
    let each = each.filter_map(|one| Some((data.object_name(one.object), of(one)?)));
    Cell { value, ..cell(value.unwrap_or(0.0)) }.over(each)
}

/// A row with all figures, those of the talk behind them.
fn with_figures(row: Row, data: &Data, scored: &Scored, published: Option<Published>) -> Row {
    let figures: [Figure; 6] = [
        |one| one.iou_3d,
        |one| one.iou_3d_strict,
        |one| Some(one.mask_iou),
        |one| Some(one.mask_iou_true),
        |one| Some(one.ssim),
        |one| Some(one.l1),
    ];
    let mut row = row;
    for (column, of) in COLUMNS.into_iter().zip(figures) {
        let cell = |value: f64| match column {
            "L1" => Cell::smaller(column, value, 3),
            _ => Cell::larger(column, value, 3),
        };
        row = row.with(figure(cell, data, scored, of));
    }
    let fid = Cell::smaller(COLUMNS[6], scored.fid.unwrap_or(0.0), 1);
    with_published(row.with(Cell { value: scored.fid, ..fid }), published)
}

/// With the figures of the talk.
fn with_published(mut row: Row, published: Option<Published>) -> Row {
    let names = ["3D IoU", "mask IoU, predicted", "mask IoU, true", "SSIM", "L1", "FID"];
    for (name, value) in names.into_iter().zip(published.into_iter().flatten()) {
        if value.is_finite() {
            let decimals = if name == "FID" { 2 } else { 3 };
            row = row.with(Cell::plain(format!("talk: {name}"), value, decimals));
        }
    }
    row
}

/// Mask IoU as the published code counts, where any trace of a soft mask is object.
fn by_published_rule(row: Row, data: &Data, scored: &Scored) -> Row {
    let larger = |column: &'static str| move |value| Cell::larger(column, value, 3);
    let row = row
        .with(figure(larger(MASK[0]), data, scored, |one| Some(one.published_iou)))
        .with(figure(larger(MASK[1]), data, scored, |one| Some(one.published_iou_true)));
    with_camera(row, data, scored)
}

/// The error of cameras: as it is, modulo the object's symmetry, its median, and how many of those objects that have a front
/// are seen from behind it.
fn with_camera(row: Row, data: &Data, scored: &Scored) -> Row {
    let degrees = |column: &'static str| move |value| Cell::smaller(column, value, 1);
    let median = scored.median(|one| one.rotation_symmetric);
    let flipped: Figure = |one| one.flipped.map(|is| if is { 100.0 } else { 0.0 });
    let median = Cell { value: median, ..degrees("median")(median.unwrap_or(0.0)) };
    row.with(figure(degrees("camera, degrees"), data, scored, |one| Some(one.rotation)))
        .with(figure(degrees("modulo symmetry"), data, scored, |one| one.rotation_symmetric))
        .with(median)
        .with(figure(degrees("flipped, %"), data, scored, flipped))
}

/// Between which errors objects are counted, degrees.
const BINS: [f64; 7] = [0.0, 10.0, 20.0, 45.0, 90.0, 135.0, 180.0];

/// How many of the objects have an error of their camera, modulo their symmetry, between such and such.
fn histogram(label: &str, data: &Data, scored: &Scored) -> Row {
    let last = BINS.len() - 2;
    let within = |one: &ScoredObject, bin: usize| {
        let error = one.rotation_symmetric?;
        let inside = error >= BINS[bin] && (error < BINS[bin + 1] || bin == last);
        Some(if inside { 100.0 } else { 0.0 })
    };
    (0..=last).fold(Row::new(HISTOGRAM, label), |row, bin| {
        let of = |one: &ScoredObject| within(one, bin);
        let value = scored.mean(of);
        let each =
            scored.each.iter().filter_map(|one| Some((data.object_name(one.object), of(one)?)));
        let name = format!("{} to {}", BINS[bin], BINS[bin + 1]);
        row.with(Cell { value, ..Cell::plain(name, 0.0, 1) }.over(each))
    })
}

/// The name of that table.
const HISTOGRAM: &str = "Objects by the error of their camera, modulo their symmetry, %";
const ABOUT_HISTOGRAM: &str = "Degrees above the columns. A camera that is guessed without looking has its errors all over; one that takes the \
                               front for the back, near 180 degrees.";

/// The row of a model that was not trained.
fn untrained(label: &str) -> String {
    format!("{label}, not trained")
}

/// Of a row in a table, by the error that an IoU leaves to 1: not behind another's.
fn not_behind(table: &str, own: &str, other: &str, column: &str) -> crate::Comparison {
    Score::new(table, own, column).not_behind(Score::new(table, other, column), 1.0)
}

/// The name of that table.
const RULE: &str = "Mask IoU by the published rule, and the error of cameras";
const ABOUT_RULE: &str = "As the published code counts: any trace of a soft mask is object. Modulo symmetry: the smallest error after a turn \
                          about the upright axis that leaves the true surface as it is, and the median of it. Flipped: by more than 90 \
                          degrees, of the objects that have a front.";

/// Writes the mean shapes' way from spheres, which the samples of a training have in their upper halves, as an animation
/// into its folder. Nothing if it kept no samples.
fn animate(trained: &Trained<Mcmr>) {
    let Some(gif) = animation(&trained.run.path().join("samples")) else { return };
    // It is an extra: a training whose folder cannot be written has failed before.
    let _ = train::output::write_within(trained.run.path(), "mean-shapes.gif", &gif);
}

/// The upper halves of the sheets in a folder, one after another; none where there is no sheet.
fn animation(folder: &std::path::Path) -> Option<Vec<u8>> {
    let entries = std::fs::read_dir(folder).ok()?;
    let mut files: Vec<_> = entries.filter_map(Result::ok).map(|entry| entry.path()).collect();
    files.sort();
    let upper = |path: &std::path::PathBuf| {
        let mut image = mesh_core::read_image(path).ok()?.to_rgb();
        image.height /= 2;
        image.data.truncate(3 * image.height * image.width);
        Some(image)
    };
    let mut frames: Vec<_> = files.iter().filter_map(upper).collect();
    let last = frames.last().cloned()?;
    frames.retain(|frame| (frame.width, frame.height) == (last.width, last.height));
    frames.extend(std::iter::repeat_n(last, 12));
    Some(recon::turntable::encode_gif(&frames, 12))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::Scale;

    /// Two sheets, the model red and then green above a blue truth: the truth is not in the animation.
    #[test]
    fn the_animation_shows_the_upper_halves_of_the_samples() {
        let folder = tempfile::tempdir().unwrap();
        assert!(animation(folder.path()).is_none());
        for (name, color) in
            [("epoch-00001.png", [200, 40, 40]), ("epoch-00002.png", [40, 160, 40])]
        {
            let rows = [color.repeat(8 * 4), [30, 30, 220].repeat(8 * 4)].concat();
            let sheet = mesh_core::ByteImage { height: 8, width: 8, channels: 3, data: rows };
            mesh_core::write_png(folder.path().join(name), &sheet).unwrap();
        }
        let gif = animation(folder.path()).unwrap();
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::RGBA);
        let mut reader = options.read_info(gif.as_slice()).unwrap();
        assert_eq!((reader.width(), reader.height()), (8, 4));
        let mut seen = Vec::new();
        while let Some(frame) = reader.read_next_frame().unwrap() {
            seen.push([frame.buffer[0], frame.buffer[1], frame.buffer[2]]);
        }
        let near = |a: [u8; 3], b: [u8; 3]| a.iter().zip(b).all(|(a, b)| a.abs_diff(b) < 12);
        // The last one stays for twelve frames more.
        assert_eq!(seen.len(), 2 + 12);
        assert!(near(seen[0], [200, 40, 40]) && near(seen[13], [40, 160, 40]), "{seen:?}");
    }

    #[test]
    fn jobs_are_named_once_and_sound() {
        for study in STUDIES {
            for scale in Scale::ALL {
                let plan = study.plan(scale);
                let mut jobs: Vec<&str> = plan.ids().collect();
                let count = jobs.len();
                assert!(plan.settings.lines().count() > count, "{}", study.name());
                jobs.sort_unstable();
                jobs.dedup();
                assert_eq!(jobs.len(), count, "{}", study.name());
            }
        }
    }

    #[test]
    fn a_figure_of_the_talk_that_is_missing_has_no_column() {
        let mut published = [0.5; 6];
        published[0] = f64::NAN;
        let row = with_published(Row::new("t", "l"), Some(published));
        assert_eq!(row.cells.len(), 5);
        assert!(row.cells.iter().all(|cell| cell.column != "talk: 3D IoU"));
        assert!(with_published(Row::new("t", "l"), None).cells.is_empty());
    }

    /// A subdivision comes in the same part of a shorter training.
    #[test]
    fn a_tenth_of_the_epochs_has_its_subdivision_too() {
        let jobs = |scale| {
            crate::preset::over::<Mcmr>("table", [("a", "a", vec![])], &[])
                .into_iter()
                .chain(at_scale(
                    scale,
                    crate::preset::over::<Mcmr>("table", [("a", "a", vec![])], &[]),
                ))
                .collect::<Vec<_>>()
        };
        let both = jobs(Scale::Tenth);
        let [full, tenth] = [0, 1].map(|k| &both[k].2);
        assert!(tenth.train.epochs < full.train.epochs.div_ceil(5));
        let (late, early) = (full.system.subdivide_at.unwrap(), tenth.system.subdivide_at.unwrap());
        assert!(early < late && early <= tenth.train.epochs);
        let [late, early] = [full, tenth].map(|config| config.system.own_cameras_at.unwrap());
        assert!(early < late && early <= tenth.train.epochs);
    }
}
