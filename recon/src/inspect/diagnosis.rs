//! What is wrong with a set of views: each supposition is tried, and the best explanation named.

use datasets::{Layout, ReadOptions, Truth, View};
use mesh_core::sample_points;
use rayon::prelude::*;
use serde::Serialize;

use super::coherence::Coherence;
use super::finer;
use super::hull::{Sphere, agreement, bounding_sphere, coincide};
use super::lens::LensFit;
use super::mask_view::MaskView;
use super::outliers::Outliers;
use super::poses_read::{self, PosesRead};
use super::reading::Reading;

/// Views that the search looks at; all are looked at for the figures.
const SEARCHED: usize = 28;
/// Pixels of each mask that are looked at.
const SAMPLES: usize = 320;
/// The same in a search.
const FEW_SAMPLES: usize = 140;
/// Points of the true surface.
const POINTS: usize = 2000;
/// A focal length that leaves more of the masks unexplained than this is not what is wrong.
const EXPLAINS: f64 = 0.85;
/// Below this agreement a few views alone may be what is wrong.
const SUSPECT: f64 = 0.97;
/// Factors of the focal length that are tried, 1 among them.
const LEAST_FACTOR: f64 = 0.4;
const FACTORS: i32 = 12;

/// What else cameras and masks may mean: its name, how to read them so, and what to tell where that explains more.
const READINGS: [(&str, Reading, &str); 6] = [
    (
        "flipped_y",
        Reading::FlippedY,
        "y is flipped: the images are upside down for these cameras, or the cameras' y points \
         down where up was expected",
    ),
    (
        "flipped_x",
        Reading::FlippedX,
        "x is flipped: the images are mirrored for these cameras (or the turntable turns the \
         other way: --turntable-reverse)",
    ),
    ("turned", Reading::Turned, "the images are turned by half for these cameras"),
    ("opencv_axes", Reading::OpenCvAxes, "the cameras look away from the object"),
    (
        "inverse_pose",
        Reading::InversePose,
        "the poses look inverted: camera to world where world to camera was expected, or the reverse",
    ),
    (
        "inverse_opencv_pose",
        Reading::InverseOpenCvPose,
        "the poses look inverted and in the axes of another tool",
    ),
];

/// The problem of cameras that all stand in one place.
pub(super) const COINCIDENT: &str = "coincident_cameras";

/// Something that looks wrong, in words.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Problem {
    /// A short name for programs, like `flipped_y`.
    pub kind: &'static str,
    /// What is wrong and what to do about it.
    pub message: String,
}

impl Problem {
    pub(super) fn new(kind: &'static str, message: impl Into<String>) -> Self {
        Self { kind, message: message.into() }
    }
}

/// How well cameras and masks agree.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Agreement {
    /// Mean over views of the intersection over union of the visual hull's silhouette and the
    /// mask; none where the views cannot fix a hull.
    pub hull_iou: Option<f64>,
    /// The same, view by view.
    pub hull_iou_by_view: Vec<Option<f64>>,
    /// Mean share of the true surface's points that land in the mask, where the truth is known.
    pub points_inside: Option<f64>,
    /// Mean over views of the intersection over union of the box of the projected points and the
    /// box of the mask.
    pub points_box_iou: Option<f64>,
    /// Factors of the focal length that were tried, with the agreement at each.
    pub focal: Vec<[f64; 2]>,
    /// Other readings that were tried, by name, with the agreement at each.
    pub readings: Vec<(&'static str, f64)>,
    /// How each view fits the others, both ways; none where its mask is empty.
    pub coherence_by_view: Vec<Option<Coherence>>,
    /// The means over views.
    pub coherence: Option<Coherence>,
    /// The focal length and principal point under which outlines fit together best.
    pub lens: Option<LensFit>,
    /// How far outside of the masks' edges colours change most, pixels of an image of at most 320; negative where masks are too
    /// large, none where the images do not tell.
    pub mask_edge: Option<f64>,
    /// Share of all directions that a surface can face in which no view sees it.
    pub unseen: Option<f64>,
}

/// Whatever the agreement is measured by.
struct Judge<'a> {
    mask_views: &'a [MaskView],
    points: Option<&'a [[f32; 3]]>,
}

impl Judge<'_> {
    /// The agreement under a reading, 0 to 1.
    fn score(&self, reading: Reading) -> f64 {
        let mask_views: Vec<MaskView> =
            self.mask_views.par_iter().map(|mask_view| mask_view.under(reading)).collect();
        if let Some(points) = self.points {
            let seen = points_in(&mask_views, points);
            return mean(seen.iter().map(|s| s.inside * s.box_iou)).unwrap_or(0.0);
        }
        bounding_sphere(&mask_views).map_or(0.0, |sphere| {
            mean(agreement(&mask_views, sphere, FEW_SAMPLES).into_iter().flatten()).unwrap_or(0.0)
        })
    }
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), v| (sum + v, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

/// Where the points of the true surface land in one view.
struct Landing {
    inside: f64,
    box_iou: f64,
}

fn points_in(mask_views: &[MaskView], points: &[[f32; 3]]) -> Vec<Landing> {
    mask_views
        .par_iter()
        .filter_map(|mask_view| {
            let bounds = mask_view.bounds()?;
            let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
            let mut inside = 0;
            for point in points {
                let point = point.map(f64::from);
                inside += usize::from(mask_view.allows(point));
                let p = mask_view.camera.project(point);
                if p.depth > 0.0 || !mask_view.camera.is_perspective() {
                    low = [low[0].min(p.column), low[1].min(p.row)];
                    high = [high[0].max(p.column), high[1].max(p.row)];
                }
            }
            // What is outside of the image has no mask to agree with.
            let (w, h) = (mask_view.camera.width as f64, mask_view.camera.height as f64);
            let [[left, top], [right, bottom]] =
                [low, high].map(|[column, row]| [column.clamp(0.0, w), row.clamp(0.0, h)]);
            let inside = inside as f64 / points.len().max(1) as f64;
            Some(Landing { inside, box_iou: box_iou(bounds, [left, top, right, bottom]) })
        })
        .collect()
}

fn box_iou(a: [f64; 4], b: [f64; 4]) -> f64 {
    let area = |b: [f64; 4]| (b[2] - b[0]).max(0.0) * (b[3] - b[1]).max(0.0);
    let both = area([a[0].max(b[0]), a[1].max(b[1]), a[2].min(b[2]), a[3].min(b[3])]);
    let either = area(a) + area(b) - both;
    if either > 0.0 { both / either } else { 0.0 }
}

/// The points that the truth offers: its own, or some of its mesh.
fn points_of(truth: &Truth) -> Option<Vec<[f32; 3]>> {
    if let Some(points) = truth.points.as_ref().filter(|p| !p.positions.is_empty()) {
        let step = points.positions.len().div_ceil(POINTS);
        return Some(points.positions.iter().step_by(step).copied().collect());
    }
    let mesh = truth.mesh.as_ref().filter(|mesh| !mesh.faces.is_empty())?;
    Some(sample_points(mesh, POINTS, 0).0)
}

/// What agreement there is, and what looks wrong.
pub(crate) fn diagnose(
    views: &[View],
    mask_views: &[MaskView],
    truth: &Truth,
    (layout, reading): (Layout, &ReadOptions),
) -> (Agreement, Vec<Problem>, Option<Sphere>) {
    let mut problems = Vec::new();
    let mut found = Agreement::default();
    masks(views, mask_views, reading, &mut problems);
    let inverted = problems.iter().any(|p| p.kind == "inverted_masks");
    let points = points_of(truth);
    if coincide(mask_views) {
        let message = "all cameras stand in one place: from there the masks show no shape; are the \
                       poses world-to-camera where camera-to-world is meant?";
        problems.push(Problem::new(COINCIDENT, message));
    }
    let sphere = bounding_sphere(mask_views);
    if let Some(sphere) = sphere.filter(|_| !inverted) {
        found.hull_iou_by_view = agreement(mask_views, sphere, SAMPLES);
        found.hull_iou = mean(found.hull_iou_by_view.iter().flatten().copied());
    }
    if let Some(points) = points.as_deref().filter(|_| !inverted) {
        let landed = points_in(mask_views, points);
        found.points_inside = mean(landed.iter().map(|l| l.inside));
        found.points_box_iou = mean(landed.iter().map(|l| l.box_iou));
    }
    // One view without the truth agrees with itself whatever its camera is.
    if inverted || (points.is_none() && mask_views.len() < 2) {
        return (found, problems, sphere);
    }
    let suspect = points.is_none() && found.hull_iou.is_none_or(|iou| iou < SUSPECT);
    if let Some(outliers) = suspect.then(|| Outliers::of(mask_views)).flatten() {
        problems.push(outlier_problem(views, &outliers, found.hull_iou));
        return (found, problems, sphere);
    }
    let step = mask_views.len().div_ceil(SEARCHED);
    let searched: Vec<MaskView> = mask_views.iter().step_by(step).cloned().collect();
    let judge = Judge { mask_views: &searched, points: points.as_deref() };
    cameras(&judge, PosesRead::of(layout, reading), &mut found, &mut problems);
    if let Some(sphere) = sphere {
        finer::look(views, sphere, &mut found, &mut problems);
    }
    (found, problems, sphere)
}

fn outlier_problem(views: &[View], outliers: &Outliers, iou: Option<f64>) -> Problem {
    let names: Vec<&str> = outliers.views.iter().map(|&k| views[k].name.as_str()).collect();
    let [fits, wrong, them] = if names.len() == 1 {
        ["fits", "its camera or its mask is wrong", "it"]
    } else {
        ["fit", "their cameras or masks are wrong", "them"]
    };
    let message = format!(
        "{} {fits} none of the others: {wrong}; leave {them} out by --except {} (agreement {:.3} instead of {:.3})",
        some_of(&names, views.len()),
        names.join(","),
        outliers.without,
        iou.unwrap_or(0.0)
    );
    Problem::new("outliers", message)
}

/// What the masks alone show.
fn masks(
    views: &[View],
    mask_views: &[MaskView],
    reading: &ReadOptions,
    problems: &mut Vec<Problem>,
) {
    let names = |wanted: &dyn Fn(&MaskView) -> bool| -> Vec<&str> {
        let kept = views.iter().zip(mask_views).filter(|(_, mask_view)| wanted(mask_view));
        kept.map(|(view, _)| view.name.as_str()).collect()
    };
    let empty = names(&|mask_view| mask_view.bounds().is_none());
    if !empty.is_empty() {
        let message = format!("the masks of {} are empty", some_of(&empty, views.len()));
        problems.push(Problem::new("empty_masks", message));
    }
    let shown = mask_views.len() - empty.len();
    let background = |mask_view: &MaskView| mask_view.border_share() > 0.75;
    if shown > 0
        && 5 * mask_views.iter().filter(|mask_view| background(mask_view)).count() >= 4 * shown
    {
        let message = if reading.invert {
            "the masks look inverted: they cover the border of the images; leave --invert-masks away"
        } else {
            "the masks look inverted: they cover the border of the images; read them with --invert-masks"
        };
        problems.push(Problem::new("inverted_masks", message));
        return;
    }
    let cut = names(&|mask_view| mask_view.is_open());
    if !cut.is_empty() {
        let message = format!(
            "the object leaves the frame in {}: what is outside has no evidence",
            some_of(&cut, views.len())
        );
        problems.push(Problem::new("out_of_frame", message));
    }
    let tiny = views.iter().filter(|view| {
        view.mask_bounds().is_some_and(|[_, _, height, width]| height.max(width) < 16)
    });
    let tiny: Vec<&str> = tiny.map(|view| view.name.as_str()).collect();
    if 2 * tiny.len() > shown {
        let message = format!(
            "the object is less than 16 pixels large in {}: crop the images or take larger ones",
            some_of(&tiny, views.len())
        );
        problems.push(Problem::new("tiny", message));
    }
}

/// Tries every reading, and names the one that explains clearly more than the files' own.
fn cameras(
    judge: &Judge<'_>,
    poses: Option<PosesRead>,
    found: &mut Agreement,
    problems: &mut Vec<Problem>,
) {
    let given = judge.score(Reading::AsGiven);
    let others = READINGS.map(|(name, reading, _)| (name, judge.score(reading)));
    found.readings = std::iter::once(("as_given", given)).chain(others).collect();
    let perspective = judge.mask_views.iter().all(|mask_view| mask_view.camera.is_perspective());
    // Of two views a wider lens explains whatever their poses lack.
    if perspective && (judge.points.is_some() || judge.mask_views.len() > 2) {
        found.focal = (-FACTORS..=FACTORS)
            .map(|k| LEAST_FACTOR.powf(-f64::from(k) / f64::from(FACTORS)))
            .map(|factor| [factor, judge.score(Reading::Focal(factor))])
            .collect();
    }
    let best = READINGS.iter().zip(others).max_by(|(_, a), (_, b)| a.1.total_cmp(&b.1));
    let focal = found.focal.iter().copied().max_by(|a, b| a[1].total_cmp(&b[1]));
    let ((name, reading, words), (_, other)) = best.expect("there are other readings");
    let at_factor = focal.map_or(given, |[_, score]| score);
    let factor = middle_of_the_best(&found.focal, given);
    if other >= at_factor && clearly_better(other, given) {
        let axes = match reading {
            Reading::OpenCvAxes => poses_read::of_axes(poses),
            _ => String::new(),
        };
        let remedy = poses.and_then(|poses| poses.remedy(*reading));
        let remedy = remedy.map_or_else(String::new, |r| format!(": {r}"));
        let message = format!("{words}{axes}{remedy} (agreement {other:.3} instead of {given:.3})");
        problems.push(Problem::new(name, message));
    } else if !(0.87..1.15).contains(&factor) && sharper(at_factor, given) && at_factor > EXPLAINS {
        let message = format!(
            "the focal length looks off: about {factor:.2} times the given one explains the masks \
             better: --focal-scale {factor:.2} (agreement {at_factor:.3} instead of {given:.3})"
        );
        problems.push(Problem::new("focal_length", message));
    } else if given < 0.7 {
        let message = format!(
            "masks and cameras do not agree (agreement {given:.3}), and neither a flip, nor other \
             axes, nor another focal length explains it"
        );
        problems.push(Problem::new("disagreement", message));
    }
}

/// Whether a reading takes away enough of what the given one leaves unexplained.
fn clearly_better(other: f64, given: f64) -> bool {
    other - given > (0.4 * (1.0 - given)).max(0.02)
}

/// The same for a focal length, whose traces are fainter: a longer one is nearly the same as a
/// smaller object, and only perspective tells them apart.
fn sharper(other: f64, given: f64) -> bool {
    other - given > (0.5 * (1.0 - given)).max(0.006)
}

/// The middle of the factors that are as good as the best: masks of whole pixels leave a range.
fn middle_of_the_best(focal: &[[f64; 2]], given: f64) -> f64 {
    let Some(best) = (0..focal.len()).max_by(|&a, &b| focal[a][1].total_cmp(&focal[b][1])) else {
        return 1.0;
    };
    let least = focal[best][1] - 0.1 * (focal[best][1] - given).max(0.0);
    let good = |k: &usize| focal[*k][1] >= least;
    let low = (0..=best).rev().take_while(good).last().unwrap_or(best);
    let high = (best..focal.len()).take_while(good).last().unwrap_or(best);
    (focal[low][0] * focal[high][0]).sqrt()
}

/// `view 3`, `views 1, 2, 5`, `7 of 24 views (1, 2, 3, ..)`, `all 24 views`.
pub(super) fn some_of(names: &[&str], of: usize) -> String {
    match names.len() {
        n if n == of && n > 1 => format!("all {n} views"),
        1 => format!("view {}", names[0]),
        2..=6 => format!("views {}", names.join(", ")),
        n => format!("{n} of {of} views ({}, ..)", names[..4].join(", ")),
    }
}
