//! What a prediction is made from, and what it is judged by.

use std::path::{Path, PathBuf};

use datasets::{Layout, Photograph, ReadOptions, View, Views, read_views};
use mesh_core::{Camera, counted};
use recon::delivery::apart_from;
use train::DataError;

use super::names::{Named, view_called};

/// A user's files, and which of them the system is given.
#[derive(Clone)]
pub struct Request<'a> {
    /// Whatever [`read_views`] opens.
    pub path: &'a Path,
    /// How it is read. Views whose files are missing are left out with a warning in any case.
    pub options: ReadOptions,
    /// Which views are given; the others judge the prediction.
    pub choice: Choice<'a>,
    /// More views that judge it.
    pub score: Option<&'a Path>,
    /// Depth of the image, for systems that take it: a file of planar depth, or of disparity as estimators leave it.
    pub depth: Option<&'a Path>,
    /// Focal lengths and principal point of the image, pixels, instead of what the views say: `fx, fy, cx, cy`.
    pub intrinsics: Option<[f64; 4]>,
    /// Told how much is read, of how much, from any thread.
    pub progress: &'a (dyn Fn(usize, usize) + Sync),
}

impl std::fmt::Debug for Request<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut out = f.debug_struct("Request");
        out.field("path", &self.path).field("choice", &self.choice).finish_non_exhaustive()
    }
}

/// Which views are given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Choice<'a> {
    /// All.
    All,
    /// So many, in the order of their source.
    First(usize),
    /// Those of these names: whole, by their last part, without the extension, or by their number, which in names that have none is
    /// the place in the order of their source, from 0 on.
    Named(&'a [String]),
}

/// Views that were read, parted into those that the system is given and those that judge it.
#[derive(Clone, Debug, PartialEq)]
pub struct PredictInput {
    /// What the system is given, in the order that was asked for; at least one.
    pub given: Vec<View>,
    /// What it is not given.
    pub others: Vec<View>,
    /// The file or folder of the views.
    pub source: PathBuf,
    /// How they were laid out.
    pub layout: Layout,
    /// What a user should know, one sentence each.
    pub warnings: Vec<String>,
    /// Whether nothing said where the camera of the given view stands.
    pub camera_assumed: bool,
}

impl<'a> Request<'a> {
    /// All views at a path, read as the layout offers them.
    pub fn new(path: &'a Path) -> Self {
        let options = ReadOptions::default();
        Self {
            path,
            options,
            choice: Choice::All,
            score: None,
            depth: None,
            intrinsics: None,
            progress: &|_, _| (),
        }
    }
}

impl PredictInput {
    /// Reads views and parts them.
    ///
    /// # Errors
    /// If nothing can be read, or none of the views asked for is there.
    pub fn read(request: &Request<'_>) -> Result<Self, DataError> {
        refuse(request)?;
        Self::views(request)?.judged_too(request)
    }

    fn views(request: &Request<'_>) -> Result<Self, DataError> {
        let lenient = ReadOptions { allow_missing: true, ..request.options.clone() };
        let views =
            read_views(request.path, &lenient, request.progress).map_err(DataError::read)?;
        Self::part(views, request.choice)
    }

    /// With the views that only judge, but for those that are there already.
    fn judged_too(mut self, request: &Request<'_>) -> Result<Self, DataError> {
        let Some(path) = request.score else { return Ok(self) };
        // The list of names is of the views that are given.
        let others = ReadOptions { allow_missing: true, only: None, ..request.options.clone() };
        let score = read_views(path, &others, request.progress).map_err(DataError::read)?;
        let all = score.views.len();
        let apart = apart_from(score.views, &self.given);
        let known = all - apart.len();
        self.others.extend(apart_from(apart, &self.others));
        self.warnings.extend(score.warnings);
        if self.others.is_empty() {
            let text = format!(
                "{}: the cameras of all its views are given: none is left to score by",
                path.display()
            );
            return Err(DataError::Unfit(text));
        }
        if known > 0 {
            let has = if known == 1 { "has a camera that is" } else { "have cameras that are" };
            self.warnings.push(format!(
                "{}: {known} of {} {has} given: left out of the scores",
                path.display(),
                counted(all, "view")
            ));
        }
        Ok(self)
    }

    /// Input for systems of a single image: the first of the chosen views is given, all others judge it. A path to
    /// an image will do; its camera is then assumed.
    ///
    /// # Errors
    /// As [`read`](Self::read); if the image cannot be decoded or shows no object.
    pub fn single(request: &Request<'_>) -> Result<Self, DataError> {
        refuse(request)?;
        Self::one(request)
    }

    /// [`single`](Self::single) for systems that take depth and intrinsics; they are the caller's to read.
    ///
    /// # Errors
    /// As [`single`](Self::single).
    pub(crate) fn one(request: &Request<'_>) -> Result<Self, DataError> {
        let extension = request.path.extension().and_then(|e| e.to_str()).unwrap_or_default();
        let is_image = ["png", "jpg", "jpeg"].contains(&extension.to_lowercase().as_str());
        if is_image && request.path.is_file() {
            return Self::image(request);
        }
        let mut input = Self::views(request)?;
        if request.choice != Choice::All && input.given.len() > 1 {
            let name = &input.given[0].name;
            input.warnings.push(format!(
                "this system takes one image: {name} is given, the others that were asked for judge the mesh"
            ));
        }
        let rest = input.given.split_off(1);
        input.others.splice(0..0, rest);
        input.judged_too(request)
    }

    /// A single image of an object, as if taken by one of 3D-R2N2's cameras.
    fn image(request: &Request<'_>) -> Result<Self, DataError> {
        let path = request.path;
        if let Some(option) = of_several_views(request) {
            let text = format!(
                "{}: {option} is of no use to a single image, expected a folder of views",
                path.display()
            );
            return Err(DataError::Unfit(text));
        }
        let Photograph { view, guessed } =
            Photograph::read(path, &assumed_camera, &request.options).map_err(DataError::read)?;
        let mut warnings = vec![
            "the camera of a single image is assumed: 35 mm on a sensor 32 mm wide, the object in the middle and seen from \
             27.5 degrees above"
                .to_owned(),
        ];
        if guessed {
            let share = 100.0 * view.mask_pixels() as f64 / view.mask.data.len() as f64;
            warnings.push(format!(
                "nothing says what the object is: what differs from the border's colour was taken, {share:.0} % of the \
                 image (--masks FOLDER or --mask say better)"
            ));
        }
        Ok(Self {
            given: vec![view],
            others: Vec::new(),
            source: path.to_owned(),
            layout: Layout::Photos,
            warnings,
            camera_assumed: true,
        })
    }

    /// Parts views into given and others.
    ///
    /// # Errors
    /// If none of the views asked for is there; or one is not, and no file is missing that could be
    /// the reason.
    pub fn part(views: Views, choice: Choice<'_>) -> Result<Self, DataError> {
        let Views { views, source, layout, mut warnings, .. } = views;
        let chosen: Vec<usize> = match choice {
            Choice::All => (0..views.len()).collect(),
            Choice::First(count) => {
                if count > views.len() {
                    let there = views.len();
                    warnings.push(format!("asked for the first {count} views, found {there}"));
                }
                (0..count.min(views.len())).collect()
            }
            Choice::Named(names) => named(names, &views, &source, &mut warnings)?,
        };
        if chosen.is_empty() {
            let text = format!("{}: no view is given, expected at least one", source.display());
            return Err(DataError::Unfit(text));
        }
        let mut views: Vec<Option<View>> = views.into_iter().map(Some).collect();
        let given = chosen.iter().filter_map(|&at| views[at].take()).collect();
        let given = with_an_object(given, &source, &mut warnings)?;
        let others = views.into_iter().flatten().collect();
        Ok(Self { given, others, source, layout, warnings, camera_assumed: false })
    }
}

/// The places of the views that are asked for by name, each once, in that order.
fn named(
    names: &[String],
    views: &[View],
    source: &Path,
    warnings: &mut Vec<String>,
) -> Result<Vec<usize>, DataError> {
    let (mut found, mut absent, mut again) = (Vec::new(), Vec::new(), Vec::new());
    for name in names {
        match view_called(views, name) {
            Named::One(at) if found.contains(&at) => again.push(views[at].name.as_str()),
            Named::One(at) => found.push(at),
            Named::Absent => absent.push(name.as_str()),
            Named::Several(first, second) => {
                let [first, second] = [first, second].map(|at| &views[at].name);
                return Err(DataError::Unfit(format!(
                    "{}: {name} may be view {first} or view {second}, expected a whole name",
                    source.display()
                )));
            }
        }
    }
    // Where nothing is missing, the name is a slip.
    if !absent.is_empty() && (found.is_empty() || warnings.is_empty()) {
        return Err(unknown(source, &absent, views, warnings));
    }
    warnings.extend(
        absent
            .iter()
            .map(|name| format!("view {name} was asked for and is not there; the others are used")),
    );
    warnings.extend(
        again.iter().map(|name| format!("view {name} was asked for twice: it is given once")),
    );
    Ok(found)
}

/// Those views whose masks are not empty: an empty one says that there is nothing where the others see the object.
fn with_an_object(
    views: Vec<View>,
    source: &Path,
    warnings: &mut Vec<String>,
) -> Result<Vec<View>, DataError> {
    let (seen, empty): (Vec<View>, Vec<View>) =
        views.into_iter().partition(|view| view.mask.data.iter().any(|&m| m != 0));
    let names: Vec<&str> = empty.iter().map(|view| view.name.as_str()).collect();
    let names = names.join(", ");
    if seen.is_empty() {
        let text = format!("{}: the masks of the given views are empty: {names}", source.display());
        return Err(DataError::Unfit(text));
    }
    if !empty.is_empty() {
        warnings.push(format!("of {names} the mask is empty: left out"));
    }
    Ok(seen)
}

/// What most systems have no use for is a mistake.
fn refuse(request: &Request<'_>) -> Result<(), DataError> {
    if request.depth.is_none() && request.intrinsics.is_none() {
        return Ok(());
    }
    let text = "--depth and --intrinsics are for depth-pixel2mesh and mesh-rcnn";
    Err(DataError::Unfit(text.to_owned()))
}

/// The first option that was given and says something of several views, or of their cameras.
fn of_several_views(request: &Request<'_>) -> Option<&'static str> {
    let ReadOptions { only, axes, poses, focal_scale, object, turntable, .. } = &request.options;
    let own = |names: &[String]| {
        let file = request.path.file_name().unwrap_or_default().to_string_lossy();
        names.iter().all(|name| datasets::is_called(&file, name))
    };
    let said = [
        ("--views", matches!(request.choice, Choice::Named(names) if !own(names))),
        ("--first", matches!(request.choice, Choice::First(count) if count > 1)),
        ("--only", only.as_ref().is_some_and(|names| !own(names))),
        // Where the camera stands is assumed: others' cameras are in another world.
        ("--score", request.score.is_some()),
        ("--object", object.is_some()),
        ("--turntable", turntable.is_some()),
        ("--axes", axes.is_some()),
        ("--poses", poses.is_some()),
        ("--focal-scale", focal_scale.is_some()),
    ];
    said.into_iter().find(|(_, is_said)| *is_said).map(|(option, _)| option)
}

fn unknown(source: &Path, absent: &[&str], views: &[View], warnings: &[String]) -> DataError {
    /// Names listed; more are not read.
    const MOST: usize = 12;
    let names: Vec<&str> = views.iter().take(MOST).map(|view| view.name.as_str()).collect();
    let more = if views.len() > MOST { ", .." } else { "" };
    let why = warnings.iter().fold(String::new(), |text, warning| text + "; " + warning);
    DataError::Unfit(format!(
        "{}: no view {}, expected some of {}{more}{why}",
        source.display(),
        absent.join(", "),
        names.join(", "),
    ))
}

/// The camera of an image that says nothing of it: in the middle of the elevations and of the distances of 3D-R2N2's renderings.
pub(crate) fn assumed_camera(width: usize, height: usize) -> Camera {
    const ELEVATION: f64 = 27.5;
    const DISTANCE: f64 = 0.8;
    Camera::from_r2n2(0.0, ELEVATION, DISTANCE, width, height)
}
