//! What a prediction is made from, and what it is judged by.

use std::path::{Path, PathBuf};

use datasets::{Layout, ReadOptions, View, Views, read_views};
use mesh_core::Camera;
use train::DataError;

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
    /// Those of these names: whole, without the extension, or as a number.
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
        Self::views(request)
    }

    fn views(request: &Request<'_>) -> Result<Self, DataError> {
        let lenient = ReadOptions { allow_missing: true, ..request.options.clone() };
        let views =
            read_views(request.path, &lenient, request.progress).map_err(DataError::read)?;
        let mut input = Self::part(views, request.choice)?;
        if let Some(path) = request.score {
            let score = read_views(path, &lenient, request.progress).map_err(DataError::read)?;
            input.others.extend(score.views);
            input.warnings.extend(score.warnings);
        }
        Ok(input)
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
        let picture = ["png", "jpg", "jpeg"].contains(&extension.to_lowercase().as_str());
        if picture && request.path.is_file() {
            return Self::picture(request.path);
        }
        let mut input = Self::views(request)?;
        let rest = input.given.split_off(1);
        input.others.splice(0..0, rest);
        Ok(input)
    }

    /// A single image of an object, cut out by its alpha channel or an even backdrop, as if taken by one of 3D-R2N2's
    /// cameras.
    fn picture(path: &Path) -> Result<Self, DataError> {
        /// Middle of the elevations and of the distances of 3D-R2N2's renderings.
        const ELEVATION: f64 = 27.5;
        const DISTANCE: f64 = 0.8;
        /// Difference of colours that still is backdrop.
        const TOLERANCE: u8 = 24;
        let picture = mesh_core::read_image(path).map_err(DataError::unfit)?;
        let backdrop = || datasets::mask_from_backdrop(&picture.to_rgb(), None, TOLERANCE);
        let mask = datasets::mask_from_alpha(&picture).unwrap_or_else(backdrop);
        if mask.data.iter().all(|&m| m == 0) {
            let text = format!(
                "{}: no object in it, expected an alpha channel or an even backdrop",
                path.display()
            );
            return Err(DataError::Unfit(text));
        }
        let camera = Camera::from_r2n2(0.0, ELEVATION, DISTANCE, picture.width, picture.height);
        let name = path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        let view = View { name, color: picture.to_rgb(), mask, camera, depth: None };
        let warning = "the camera of a single image is assumed: 35 mm on a sensor 32 mm wide, the object in the middle \
                       and seen from 27.5 degrees above";
        Ok(Self {
            given: vec![view],
            others: Vec::new(),
            source: path.to_owned(),
            layout: Layout::Photos,
            warnings: vec![warning.to_owned()],
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
                    warnings.push(format!("{count} views were asked for, and {there} are there"));
                }
                (0..count.min(views.len())).collect()
            }
            Choice::Named(names) => {
                let (mut found, mut absent) = (Vec::new(), Vec::new());
                for name in names {
                    match views.iter().position(|view| is_called(view, name)) {
                        Some(at) if found.contains(&at) => {}
                        Some(at) => found.push(at),
                        None => absent.push(name.as_str()),
                    }
                }
                // Where nothing is missing, the name is a slip.
                if !absent.is_empty() && (found.is_empty() || warnings.is_empty()) {
                    return Err(unknown(&source, &absent, &views, &warnings));
                }
                warnings.extend(absent.iter().map(|name| {
                    format!("view {name} was asked for and is not there; the others are used")
                }));
                found
            }
        };
        if chosen.is_empty() {
            let text = format!("{}: no view is given, expected at least one", source.display());
            return Err(DataError::Unfit(text));
        }
        let mut views: Vec<Option<View>> = views.into_iter().map(Some).collect();
        let given = chosen.iter().filter_map(|&at| views[at].take()).collect();
        let others = views.into_iter().flatten().collect();
        Ok(Self { given, others, source, layout, warnings, camera_assumed: false })
    }
}

/// What most systems have no use for is a mistake.
fn refuse(request: &Request<'_>) -> Result<(), DataError> {
    if request.depth.is_none() && request.intrinsics.is_none() {
        return Ok(());
    }
    let text = "--depth and --intrinsics are for depth-pixel2mesh and mesh-rcnn";
    Err(DataError::Unfit(text.to_owned()))
}

/// Whether a view is meant by a name.
fn is_called(view: &View, name: &str) -> bool {
    let stem = view.name.rsplit_once('.').map_or(view.name.as_str(), |(stem, _)| stem);
    let numbers = (stem.parse::<u64>(), name.parse::<u64>());
    view.name == name || stem == name || matches!(numbers, (Ok(a), Ok(b)) if a == b)
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
