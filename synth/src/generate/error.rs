//! What can go wrong.

use std::io;
use std::path::{Path, PathBuf};

use datasets::WriteViewsError;
use diff_raster::FacesError;

use super::config::MANIFEST;

/// Why a dataset could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GenerateError {
    /// Another process works in the folder.
    #[error("{} is in use by {holder}; wait until it ends, or choose another folder", path.display())]
    Busy {
        /// The folder.
        path: PathBuf,
        /// Process, machine and since when, as the other noted it.
        holder: String,
    },
    /// The configuration has values that cannot be.
    #[error("configuration of the dataset: {}", .0.join("; "))]
    Config(Vec<String>),
    /// The folder holds something that is no dataset of ours.
    #[error(
        "{} is not empty and has no {}, so it is no dataset that was begun; choose another folder",
        path.display(),
        MANIFEST
    )]
    Foreign {
        /// The folder.
        path: PathBuf,
    },
    /// The folder holds a dataset of another configuration.
    #[error(
        "{}: found `{found}`, this run has `{asked}`; take it up with the same options, or choose \
         another folder",
        path.display()
    )]
    Different {
        /// The manifest.
        path: PathBuf,
        /// The first setting of it that differs.
        found: String,
        /// What that setting is in this run.
        asked: String,
    },
    /// The model's faces are not of its vertices.
    #[error("the model: {0}")]
    Model(#[from] FacesError),
    /// A model is nothing that 3D-R2N2's cameras stand around.
    #[error(
        "{object}: reaches {reach:.3} from the origin; 3D-R2N2's cameras stand at 1.1 to 1.7 from it, around a box of diagonal 1: \
         normalise the model (--normalize unit-diagonal), or choose cameras that follow its size (--cameras sphere)"
    )]
    Reach {
        /// Its category and name.
        object: String,
        /// How far from the origin its farthest vertex is.
        reach: f64,
    },
    /// The layout has no words for a camera: it looks past the origin.
    #[error("3D-R2N2's layout: {0}; normalise the model, or choose another layout")]
    Camera(#[from] mesh_core::CameraError),
    /// Views cannot be written.
    #[error(transparent)]
    Views(#[from] WriteViewsError),
    /// A mesh, an image or a table cannot be written.
    #[error(transparent)]
    File(#[from] mesh_core::WriteError),
    /// The file system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

impl GenerateError {
    pub(super) fn io(path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { path, source }
    }
}
