//! What can go wrong with mesh files.

use std::path::{Path, PathBuf};

use crate::ImageError;

/// Why a mesh could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadMeshError {
    /// The file could not be opened or read.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The name's ending says none of the formats.
    #[error("{}: found extension {found:?}, expected .obj, .ply or .glb", path.display())]
    Extension {
        /// The file.
        path: PathBuf,
        /// The extension, empty where there is none.
        found: String,
    },
    /// Something in the file is not as the format, or a mesh, wants it.
    #[error("{}{}: {field}: found {found}, expected {expected}", path.display(), at(*line))]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1, in text formats.
        line: Option<usize>,
        /// The part of the file.
        field: String,
        /// What stands there.
        found: String,
        /// What should.
        expected: String,
    },
    /// The texture could not be read.
    #[error("texture of {}: {source}", path.display())]
    Texture {
        /// The mesh file.
        path: PathBuf,
        /// What is wrong with the image.
        source: ImageError,
    },
}

fn at(line: Option<usize>) -> String {
    line.map_or_else(String::new, |line| format!(":{line}"))
}

impl ReadMeshError {
    /// `Malformed`, for a part of a binary file.
    pub(super) fn malformed(
        path: &Path,
        field: impl Into<String>,
        found: impl ToString,
        expected: impl Into<String>,
    ) -> Self {
        Self::at_line(path, None, field, found, expected)
    }

    /// `Malformed`, for a line of a text file.
    #[allow(clippy::needless_pass_by_value, reason = "numbers and texts read alike at the calls")]
    pub(super) fn at_line(
        path: &Path,
        line: Option<usize>,
        field: impl Into<String>,
        found: impl ToString,
        expected: impl Into<String>,
    ) -> Self {
        Self::Malformed {
            path: path.to_owned(),
            line,
            field: field.into(),
            found: found.to_string(),
            expected: expected.into(),
        }
    }
}

/// Why a file could not be written. What stood there before still stands.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WriteError {
    /// The system refused.
    #[error("{}: cannot be written: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The name's ending says none of the formats.
    #[error("{}: found extension {found:?}, expected .obj, .ply or .glb", path.display())]
    Extension {
        /// The file.
        path: PathBuf,
        /// The extension, empty where there is none.
        found: String,
    },
    /// The mesh is not one that a file could hold.
    #[error("{}: not written, the mesh is damaged: {what}", path.display())]
    Mesh {
        /// The file.
        path: PathBuf,
        /// What is wrong with the mesh.
        what: String,
    },
}
