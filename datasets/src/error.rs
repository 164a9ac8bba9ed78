//! What can be wrong with views on disk: always the file, the field, what was found.

use std::path::{Path, PathBuf};

use crate::convention::Convention;

/// What can be done about a view whose file is missing.
const REMEDY: &str = "put it back, or leave such views out (allow missing: --allow-missing)";

/// Why views could not be read. The message names the file, the field and the remedy.
#[derive(Debug, thiserror::Error)]
#[error("{}", self.message())]
pub struct ReadViewsError {
    /// The file or folder at fault; inside an archive, `archive.zip/entry`.
    pub path: PathBuf,
    /// What is wrong with it.
    #[source]
    pub problem: ViewsProblem,
}

/// What is wrong with a file of a set of views.
#[derive(Debug, thiserror::Error)]
pub enum ViewsProblem {
    /// The file or folder cannot be opened or read.
    #[error("cannot be read: {0}")]
    Io(#[from] std::io::Error),
    /// The file is not there.
    #[error("is missing, {wanted_by}")]
    Missing {
        /// Which other file or rule wants it, and what can be done.
        wanted_by: String,
    },
    /// A file of a view is not there; the other views can be read without it.
    #[error("is missing, {wanted_by}; {REMEDY}")]
    MissingView {
        /// Which other file or rule wants it.
        wanted_by: String,
    },
    /// Another file names this one, and it lies outside of the folder that was opened.
    #[error(
        "lies outside of the folder that was opened, where no file may reach, {wanted_by}: expected \
         a relative name below it"
    )]
    Outside {
        /// Which other file wants it.
        wanted_by: String,
    },
    /// There is something of this name that cannot be read like a file.
    #[error("is a folder, a pipe or a device, expected a file")]
    Irregular,
    /// No known layout fits what is there.
    #[error("no known layout of views: {found}; {remedy}")]
    UnknownLayout {
        /// What was there.
        found: String,
        /// What was looked for, or what can be done.
        remedy: String,
    },
    /// The archive is damaged or uses something that is not supported.
    #[error("is not a zip archive that can be read: {0}")]
    Archive(#[from] zip::result::ZipError),
    /// The file claims or has more bytes than it may.
    #[error("holds or claims {found} bytes, more than the {limit} that {field} may take")]
    TooLarge {
        /// What the bytes are for.
        field: String,
        /// How many there are, or are claimed to be.
        found: u64,
        /// How many there may be.
        limit: u64,
    },
    /// The JSON cannot be parsed.
    #[error("is not valid JSON: {0}")]
    Json(#[from] serde_json::Error),
    /// A field has a value that cannot be meant.
    #[error("field `{field}`: found {found}, expected {expected}")]
    Field {
        /// The field's name, with its place where there are several.
        field: String,
        /// What is there.
        found: String,
        /// What would have been right.
        expected: String,
    },
    /// Nothing says which pixels of the image are the object.
    #[error(
        "{}; views without one can be left out (allow missing: --allow-missing)",
        no_mask(looked_for.as_deref())
    )]
    NoMask {
        /// The folder and the names in it, where a file would have been taken.
        looked_for: Option<String>,
    },
    /// The background is not plain.
    #[error(
        "field `mask`: found {:.0} % of the border to differ by more than {tolerance} from {}, expected a plain \
         backdrop: give its colour, or masks from files",
        100.0 * share, hex(*color)
    )]
    BusyBackdrop {
        /// How much of the border differs, 0 to 1.
        share: f64,
        /// What was taken for the backdrop, sRGB.
        color: [u8; 3],
        /// How far a channel may differ from it.
        tolerance: u8,
    },
    /// The views do not show together what the object is.
    #[error("field `mask`: {0}")]
    Segment(#[from] crate::SegmentError),
    /// The image cannot be decoded.
    #[error("{0}")]
    Image(#[from] mesh_core::ImageError),
    /// The mesh or the voxels cannot be decoded.
    #[error("{0}")]
    Mesh(#[source] Box<mesh_core::ReadMeshError>),
    /// The camera is not one.
    #[error("field `{field}`: {source}")]
    Camera {
        /// The fields that describe the camera.
        field: String,
        /// What is wrong with it.
        source: mesh_core::CameraError,
    },
    /// A lens shows the object where no pinhole can.
    #[error("field `{field}`: {source}")]
    OffAxis {
        /// The field that says what lens it is.
        field: String,
        /// Where the object is.
        source: crate::undistort::OffAxisError,
    },
    /// No view shows the object.
    #[error("the masks of all {views} views are empty: {remedy}")]
    EmptyMasks {
        /// How many views there are.
        views: usize,
        /// What can be done.
        remedy: String,
    },
    /// The cameras do not look at what the masks show.
    #[error(
        "field `{field}`: {wrong} of {views} cameras do not see the point where their masks meet, \
         the first is view {first}; expected {}",
        meant(*convention)
    )]
    SeesNothing {
        /// The field that holds the poses.
        field: String,
        /// How many cameras look elsewhere.
        wrong: usize,
        /// How many there are.
        views: usize,
        /// The name of the first of them.
        first: String,
        /// What the poses were taken for, where the layout has any.
        convention: Option<Convention>,
    },
}

impl ReadViewsError {
    /// An error of the file at `path`.
    pub(crate) fn new(path: impl Into<PathBuf>, problem: impl Into<ViewsProblem>) -> Self {
        Self { path: path.into(), problem: problem.into() }
    }

    /// What a layout needs and is not there.
    pub(crate) fn missing(path: impl Into<PathBuf>, wanted_by: impl Into<String>) -> Self {
        Self::new(path, ViewsProblem::Missing { wanted_by: wanted_by.into() })
    }

    /// A file that a view needs and that is not there.
    pub(crate) fn missing_view(path: impl Into<PathBuf>, wanted_by: impl Into<String>) -> Self {
        Self::new(path, ViewsProblem::MissingView { wanted_by: wanted_by.into() })
    }

    /// What makes an error of a camera that is none.
    pub(crate) fn camera(
        path: impl Into<PathBuf>,
        field: impl Into<String>,
    ) -> impl FnOnce(mesh_core::CameraError) -> Self {
        move |source| Self::new(path, ViewsProblem::Camera { field: field.into(), source })
    }

    /// A field of the file at `path` that cannot be meant.
    pub(crate) fn field(
        path: impl Into<PathBuf>,
        field: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        let (found, expected) = (found.into(), expected.into());
        Self::new(path, ViewsProblem::Field { field: field.into(), found, expected })
    }

    /// The messages of images and meshes begin with their file.
    fn message(&self) -> String {
        match &self.problem {
            ViewsProblem::Image(error) => error.to_string(),
            ViewsProblem::Mesh(error) => error.to_string(),
            problem => format!("{}: {problem}", self.path.display()),
        }
    }

    /// The message without the advice to leave the view out, for those who have.
    pub(crate) fn without_advice(&self) -> String {
        match &self.problem {
            ViewsProblem::MissingView { wanted_by } => {
                format!("{}: is missing, {wanted_by}", self.path.display())
            }
            ViewsProblem::NoMask { looked_for } => {
                format!("{}: {}", self.path.display(), no_mask(looked_for.as_deref()))
            }
            _ => self.to_string(),
        }
    }

    /// Whether it is a view that lacks a file, or of which nothing says what is the object.
    pub(crate) fn is_incomplete_view(&self) -> bool {
        matches!(
            self.problem,
            ViewsProblem::NoMask { .. }
                | ViewsProblem::BusyBackdrop { .. }
                | ViewsProblem::Missing { .. }
                | ViewsProblem::MissingView { .. }
        )
    }

    /// The field at fault, where one is.
    pub fn field_name(&self) -> Option<&str> {
        match &self.problem {
            ViewsProblem::TooLarge { field, .. }
            | ViewsProblem::Field { field, .. }
            | ViewsProblem::Camera { field, .. }
            | ViewsProblem::SeesNothing { field, .. } => Some(field),
            ViewsProblem::NoMask { .. }
            | ViewsProblem::BusyBackdrop { .. }
            | ViewsProblem::Segment(_) => Some("mask"),
            _ => None,
        }
    }
}

/// What cameras should be, and what can be said where a file means others.
fn meant(convention: Option<Convention>) -> String {
    let Some((axes, poses)) = convention else { return "cameras that look at the object".into() };
    format!(
        "camera axes {} and {} poses; where the file means others: axes {} (--axes), poses {} (--poses)",
        axes.words(),
        poses.name(),
        axes.other().name(),
        poses.other().name()
    )
}

fn no_mask(looked_for: Option<&str>) -> String {
    let place = looked_for.map(|place| format!(", and no file (looked in {place})"));
    format!(
        "field `mask`: found no alpha that says anything{}, expected a mask file (--masks FOLDER), an alpha channel, or a plain \
         backdrop (--mask backdrop)",
        place.unwrap_or_default()
    )
}

fn hex([r, g, b]: [u8; 3]) -> String {
    format!("{r:02x}{g:02x}{b:02x}")
}

/// Why views could not be written.
#[derive(Debug, thiserror::Error)]
#[error("{}: cannot be written: {source}", path.display())]
pub struct WriteViewsError {
    /// The file or folder at fault.
    pub path: PathBuf,
    /// What went wrong.
    #[source]
    pub source: Box<dyn std::error::Error + Send + Sync>,
}

impl WriteViewsError {
    pub(crate) fn new(
        path: &Path,
        source: impl Into<Box<dyn std::error::Error + Send + Sync>>,
    ) -> Self {
        Self { path: path.to_owned(), source: source.into() }
    }
}
