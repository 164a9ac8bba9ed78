//! What is in a dataset, whether its cameras and masks agree, and what looks wrong, in words.
//!
//! Cameras are judged by the visual hull: the body that all masks allow covers every mask if the
//! cameras are right, and less where they are not. Where the true surface is known, its points
//! must land in the masks, which is the stronger check. Suppositions (images upside down, axes
//! of another tool, another focal length) are tried, and one is named where it explains clearly
//! more than the files do as they are.
//!
//! ```
//! use datasets::{Truth, Views};
//! use synth::shapes::AlarmClock;
//! use recon::inspect::inspect_views;
//! use synth::{Orbit, RenderOptions, render_views};
//!
//! let cameras = Orbit { count: 12, width: 64, height: 64, ..Orbit::default() }.cameras();
//! let clock = AlarmClock::default().build();
//! let mut views = render_views(&clock, &cameras, &RenderOptions::default(), &|_, _| {})?;
//! let as_views = |views| Views::in_memory(views);
//! let object = inspect_views(&as_views(views.clone()), &Truth::default());
//! assert!(object.problems.is_empty() && object.agreement.hull_iou > Some(0.95));
//!
//! // Somebody saved the masks upside down.
//! for view in &mut views {
//!     view.mask.data = view.mask.data.chunks(64).rev().flatten().copied().collect();
//! }
//! let object = inspect_views(&as_views(views), &Truth::default());
//! assert_eq!(object.problems[0].kind, "flipped_y");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod camera_plan;
mod coherence;
mod consistency;
mod contact_sheet;
mod coverage;
mod diagnosis;
mod error;
mod finer;
mod hull;
mod lens;
mod mask_edge;
mod mask_view;
mod opposite;
mod outliers;
mod page;
mod partners;
mod poses_read;
mod reading;
mod silhouette;
mod window;

pub use coherence::Coherence;
pub(crate) use consistency::Consistency;
pub use diagnosis::{Agreement, Problem};
pub use error::InspectError;
pub use lens::LensFit;
pub(crate) use opposite::center_of_masks;
pub use page::write_report;
pub(crate) use window::Window;

use std::collections::BTreeMap;
use std::path::PathBuf;

use datasets::{Dataset, Entry, OnInconsistent, ReadOptions, Subset, Truth, View, Views};
use mesh_core::nalgebra::Vector3;
use mesh_core::{ByteImage, Camera};
use rayon::prelude::*;
use serde::Serialize;

use finer::Fitness;
use mask_view::MaskView;

/// Cells along the longest side of the hull that is drawn.
const GRID: usize = 64;

/// What is there, and what looks wrong.
#[derive(Clone, Debug, Serialize)]
pub struct Inspection {
    /// What was opened.
    #[serde(serialize_with = "train::path_text::serialize")]
    pub path: PathBuf,
    /// How it is laid out.
    pub layout: String,
    /// How many objects there are.
    pub objects: usize,
    /// How many views they have together.
    pub views: usize,
    /// Categories by name; one without a name where the layout has none.
    pub categories: Vec<Count>,
    /// The subsets of the layout's own split; empty where it has none.
    pub subsets: Vec<Count>,
    /// What the layout had to say.
    pub warnings: Vec<String>,
    /// The objects that were looked at closely.
    pub looked_at: Vec<ObjectInspection>,
}

/// So many objects with so many views.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Count {
    /// Of what.
    pub name: String,
    /// Objects.
    pub objects: usize,
    /// Their views.
    pub views: usize,
}

/// One object, looked at closely. Pairs of values are the least and the greatest.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ObjectInspection {
    /// Its category, as the layout calls it.
    pub category: String,
    /// Its name.
    pub name: String,
    /// How many views were read.
    pub views: usize,
    /// Widths of the images.
    pub width: [usize; 2],
    /// Heights of the images.
    pub height: [usize; 2],
    /// Bytes of the colours inside the masks.
    pub colors: [u8; 2],
    /// Share of an image that the object covers.
    pub coverage: [f64; 2],
    /// Horizontal angles of view, degrees; none for parallel rays.
    pub fov: Option<[f64; 2]>,
    /// Distances from the cameras to the middle of the object, in the unit of the files; none for parallel rays.
    pub distance: Option<[f64; 2]>,
    /// Elevations of the cameras above the middle of the object (+Y up), degrees.
    pub elevation: Option<[f64; 2]>,
    /// Depths on the object, where there are any.
    pub depth: Option<[f32; 2]>,
    /// The hull's box, low and high corner.
    pub hull_box: Option<[[f32; 3]; 2]>,
    /// What the layout knows of the true shape, in words.
    pub truth: Vec<String>,
    /// How well cameras and masks agree.
    pub agreement: Agreement,
    /// What looks wrong; empty if nothing does.
    pub problems: Vec<Problem>,
    /// What the reader had to say.
    pub warnings: Vec<String>,
    /// Names of the views, in their order.
    pub names: Vec<String>,
    /// All views with their masks outlined.
    #[serde(skip)]
    pub sheet: ByteImage,
    /// The cameras around the hull, from above and from the side, as SVG.
    #[serde(skip)]
    pub cameras: String,
}

/// Looks at a dataset: at all entries, and closely at some objects, evenly spread over the list.
///
/// `reading.object` looks at that one alone. `progress` is told how many objects are done, of how
/// many.
///
/// # Errors
/// If an object that is looked at cannot be read, or all its cameras stand at one point.
///
/// # Cost
/// About a second for an object of a hundred views, most of it for the suppositions that are
/// tried, and in proportion for more: each view is held against 96 others at most. The images of one object are in memory at a time.
pub fn inspect(
    dataset: &dyn Dataset,
    most_objects: usize,
    reading: &ReadOptions,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Inspection, InspectError> {
    let entries = dataset.entries();
    let chosen: Vec<usize> = if let Some(wanted) = &reading.object {
        vec![datasets::choose(dataset.root(), entries, Some(wanted))?]
    } else {
        let count = most_objects.clamp(1, entries.len());
        (0..count).map(|k| k * entries.len() / count).collect()
    };
    // What makes no sense is what this is about.
    let reading =
        ReadOptions { on_inconsistent: OnInconsistent::Accept, depth: true, ..reading.clone() };
    let mut looked_at = Vec::new();
    for (done, &object) in chosen.iter().enumerate() {
        progress(done, chosen.len());
        let views = dataset.views(object, None, &reading, &|_, _| {})?;
        let truth = dataset.truth(object)?;
        let Entry { category, name, .. } = entries[object].clone();
        let found = inspect_views_with(&views, &truth, &reading);
        if let Some(reason) = error::at_one_point(&views.views, &found.problems) {
            let path = dataset.root().to_owned();
            return Err(InspectError::Cameras { path, object: name, reason });
        }
        looked_at.push(ObjectInspection { category, name, ..found });
    }
    progress(chosen.len(), chosen.len());
    Ok(Inspection {
        path: dataset.root().to_owned(),
        layout: dataset.layout().to_string(),
        objects: entries.len(),
        views: entries.iter().map(|entry| entry.views).sum(),
        categories: counts(entries, |entry| Some(entry.category.clone())),
        subsets: counts(entries, |entry| entry.subset.map(subset_name)),
        warnings: dataset.warnings().to_vec(),
        looked_at,
    })
}

/// How the masks of views, or of 96 of them, evenly spread, fit together under these cameras, and to the views' colours; none
/// where they fix no body.
pub(crate) fn fitness_of(views: &[(&View, &Camera)]) -> Option<Fitness> {
    let views = &partners::spread(views, partners::MOST)[..];
    let mask_views: Vec<MaskView> =
        views.par_iter().map(|&(view, camera)| MaskView::seen_by(view, camera)).collect();
    finer::fitness(views, hull::bounding_sphere(&mask_views)?)
}

/// Share of the directions that a surface can face in which no camera sees it, and the axis nearest to their middle.
pub(crate) fn unseen_of<'a>(
    cameras: impl Iterator<Item = &'a Camera>,
    center: [f64; 3],
) -> (f64, String) {
    let unseen = coverage::Unseen::of(cameras, center);
    (unseen.share, unseen.side())
}

fn subset_name(subset: Subset) -> String {
    match subset {
        Subset::Train => "train",
        Subset::Validation => "validation",
        Subset::Test => "test",
    }
    .to_owned()
}

fn counts(entries: &[Entry], name: impl Fn(&Entry) -> Option<String>) -> Vec<Count> {
    let mut counts: BTreeMap<String, [usize; 2]> = BTreeMap::new();
    for entry in entries {
        if let Some(name) = name(entry) {
            let count = counts.entry(name).or_default();
            *count = [count[0] + 1, count[1] + entry.views];
        }
    }
    let count = |(name, [objects, views]): (String, [usize; 2])| Count { name, objects, views };
    counts.into_iter().map(count).collect()
}

/// Looks closely at the views of one object, against its truth where there is one.
///
/// # Panics
/// If there are no views, or one of them is [not valid](datasets::View::validate).
pub fn inspect_views(views: &Views, truth: &Truth) -> ObjectInspection {
    inspect_views_with(views, truth, &ReadOptions::default())
}

/// [`inspect_views`] of views that were read with options, to which the remedies that it names are relative.
///
/// # Panics
/// As [`inspect_views`].
pub fn inspect_views_with(views: &Views, truth: &Truth, reading: &ReadOptions) -> ObjectInspection {
    assert!(!views.is_empty(), "inspect_views: no views");
    let list = &views.views;
    let mask_views: Vec<MaskView> = list.par_iter().map(MaskView::new).collect();
    let (agreement, problems, sphere) =
        diagnosis::diagnose(list, &mask_views, truth, (views.layout, reading));
    let hull = sphere.and_then(|sphere| hull::carve(&mask_views, sphere, GRID));
    let fovs: Option<Vec<f64>> =
        list.iter().map(|view| view.camera.fov().map(|fov| fov[0].to_degrees())).collect();
    let middle = sphere.map(|sphere| Vector3::from(sphere.center));
    let from_middle = |f: &dyn Fn(&Camera, Vector3<f64>) -> f64| {
        let of = |view: &View, m| f(&view.camera, towards(&view.camera, m));
        middle.and_then(|m| range(list.iter().map(|view| of(view, m))))
    };
    let depths = list.iter().filter_map(|view| {
        let depth = view.depth.as_ref()?;
        range32(depth.data.iter().zip(&view.mask.data).filter(|(_, m)| **m != 0).map(|(d, _)| *d))
    });
    let cameras: Vec<_> = list.iter().map(|view| &view.camera).collect();
    ObjectInspection {
        views: list.len(),
        width: sizes(list.iter().map(|view| view.color.width)),
        height: sizes(list.iter().map(|view| view.color.height)),
        colors: colors(list),
        coverage: range(
            list.iter().map(|view| view.mask_pixels() as f64 / view.mask.data.len() as f64),
        )
        .unwrap_or_default(),
        fov: fovs.and_then(|fovs| range(fovs.into_iter())),
        distance: from_middle(&|camera, to| {
            if camera.is_perspective() { to.norm() } else { f64::NAN }
        }),
        elevation: from_middle(&|_, to| to.y.atan2(to.x.hypot(to.z)).to_degrees()),
        depth: depths.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]),
        hull_box: hull.as_ref().map(|hull| {
            let high = hull.dims.map(|n| n as f32);
            [hull.origin, std::array::from_fn(|k| hull.origin[k] + hull.cell[k] * high[k])]
        }),
        truth: truth_words(truth),
        agreement,
        problems,
        warnings: views.warnings.clone(),
        names: list.iter().map(|view| view.name.clone()).collect(),
        sheet: contact_sheet::contact_sheet(list),
        cameras: camera_plan::cameras_svg(&cameras, sphere, hull.as_ref()),
        ..ObjectInspection::default()
    }
}

/// From a point to where a camera looks from: parallel rays come from the same side of everything, wherever the camera's plane is.
fn towards(camera: &Camera, point: Vector3<f64>) -> Vector3<f64> {
    if camera.is_perspective() { camera.center() - point } else { -camera.forward() }
}

fn truth_words(truth: &Truth) -> Vec<String> {
    let mut words = Vec::new();
    if let Some(mesh) = &truth.mesh {
        words.push(format!("a mesh of {} faces", mesh.faces.len()));
    }
    if let Some(points) = &truth.points {
        words.push(format!("{} points with normals", points.positions.len()));
    }
    if let Some(voxels) = &truth.voxels {
        let [x, y, z] = voxels.dims;
        words.push(format!("voxels, {x}x{y}x{z}"));
    }
    words
}

fn range(values: impl Iterator<Item = f64>) -> Option<[f64; 2]> {
    values.filter(|v| v.is_finite()).map(|v| [v, v]).reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
}

fn range32(values: impl Iterator<Item = f32>) -> Option<[f32; 2]> {
    values.filter(|v| v.is_finite()).map(|v| [v, v]).reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
}

fn sizes(values: impl Iterator<Item = usize>) -> [usize; 2] {
    values.map(|v| [v, v]).reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]).unwrap_or_default()
}

fn colors(views: &[datasets::View]) -> [u8; 2] {
    let (mut low, mut high) = (255, 0);
    for view in views {
        for (pixel, _) in
            view.color.data.chunks_exact(3).zip(&view.mask.data).filter(|(_, m)| **m != 0)
        {
            for &value in pixel {
                (low, high) = (low.min(value), high.max(value));
            }
        }
    }
    [low, high]
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use synth::shapes::AlarmClock;
    use synth::{Orbit, RenderOptions, render_views};

    use super::*;

    /// A verdict on hundreds of views takes no longer than one on 96.
    #[test]
    fn of_many_views_some_are_held_against_each_other() {
        let orbit = Orbit { count: 110, width: 24, height: 24, ..Orbit::default() };
        let clock = AlarmClock::default().build();
        let views =
            render_views(&clock, &orbit.cameras(), &RenderOptions::default(), &|_, _| {}).unwrap();
        let all: Vec<(&View, &Camera)> = views.iter().map(|view| (view, &view.camera)).collect();
        let some = partners::spread(&all, 96);
        let of = |views: &[(&View, &Camera)]| fitness_of(views).unwrap().coherence;
        assert_eq!(of(&all), of(&some));
    }

    /// Two views hold each other to account.
    #[test]
    fn of_two_views_one_that_cannot_be_right_is_noticed() {
        let orbit = Orbit { count: 12, width: 96, height: 96, ..Orbit::default() };
        let clock = AlarmClock::default().build();
        let cameras = &orbit.cameras()[..2];
        let views = render_views(&clock, cameras, &RenderOptions::default(), &|_, _| {}).unwrap();
        let kinds = |views: &[View]| -> Vec<&'static str> {
            let found = inspect_views(&Views::in_memory(views.to_vec()), &Truth::default());
            found.problems.iter().map(|problem| problem.kind).collect()
        };
        assert_eq!(kinds(&views), ["one_sided"]);
        let mut moved = views;
        moved[1].camera.translation.y += 1.5;
        let found = kinds(&moved);
        assert!(found.iter().any(|kind| *kind != "one_sided"), "{found:?}");
    }

    /// What stands forty million away, as in coordinates of the earth, does not stand in one place.
    #[test]
    fn worlds_far_from_the_origin_are_judged_as_others() {
        let orbit = Orbit { count: 12, width: 64, height: 64, ..Orbit::default() };
        let clock = AlarmClock::default().build();
        let mut views =
            render_views(&clock, &orbit.cameras(), &RenderOptions::default(), &|_, _| {}).unwrap();
        for Camera { rotation, translation, .. } in views.iter_mut().map(|view| &mut view.camera) {
            *translation -= *rotation * Vector3::new(5e5, 0.0, -4e7);
        }
        let found = inspect_views(&Views::in_memory(views.clone()), &Truth::default());
        assert_eq!(found.problems, []);
        assert_eq!(error::at_one_point(&views, &found.problems), None);
        // But those that do, but for what is rounded, do.
        for (k, view) in views.iter_mut().enumerate() {
            let place = Vector3::new(5e5 + 0.01 * (k % 3) as f64, 0.02 * (k % 2) as f64, -4e7);
            view.camera.translation = -view.camera.rotation * place;
        }
        let found = inspect_views(&Views::in_memory(views.clone()), &Truth::default());
        assert!(error::at_one_point(&views, &found.problems).is_some(), "{:?}", found.problems);
    }
}
