//! What can go wrong with mesh files.

#[cfg(feature = "files")]
use std::path::Path;
use std::path::PathBuf;

use crate::{ImageError, OverLimit};

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
    #[error("{}: found extension {found:?}, expected .obj, .ply, .glb, .off or .stl", path.display())]
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
    /// Reading the file would take more memory than the limits allow.
    #[error("{}: {source}", path.display())]
    OverLimit {
        /// The file.
        path: PathBuf,
        /// What would have been held.
        source: OverLimit,
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

#[cfg(feature = "files")]
impl ReadMeshError {
    /// `OverLimit`, for `map_err`.
    pub(super) fn over_limit(path: &Path) -> impl Fn(OverLimit) -> Self {
        move |source| Self::OverLimit { path: path.to_owned(), source }
    }

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
            found: shortened(found.to_string()),
            expected: expected.into(),
        }
    }
}

/// At most 80 characters, so that a line of megabytes does not become a message of megabytes, and no
/// control characters, which a terminal would obey.
#[cfg(feature = "files")]
fn shortened(text: String) -> String {
    let mut text = if text.chars().take(81).any(char::is_control) {
        let plain = text.chars().take(81).flat_map(|c| {
            let escaped = c.is_control().then(|| c.escape_default());
            let same = escaped.is_none().then_some(c);
            escaped.into_iter().flatten().chain(same)
        });
        plain.collect()
    } else {
        text
    };
    if let Some((end, _)) = text.char_indices().nth(77).filter(|&(at, _)| text.len() > at + 3) {
        text.truncate(end);
        text.push_str("...");
    }
    text
}

/// Why a mesh has no bytes in a format.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum EncodeError {
    /// The mesh is not one that a file could hold.
    #[error("the mesh is damaged: {0}")]
    Mesh(String),
    /// There is more than the format can count.
    #[error("{bytes} bytes are more than the format can count")]
    TooLong {
        /// How many bytes there are.
        bytes: usize,
    },
}

#[cfg(feature = "files")]
impl EncodeError {
    pub(super) fn at(self, path: &Path) -> WriteError {
        WriteError::Mesh { path: path.to_owned(), source: self }
    }
}

/// The endings of the formats that are written.
const WRITTEN: &str = if cfg!(feature = "3mf") {
    ".obj, .ply, .glb, .stl or .3mf"
} else {
    ".obj, .ply, .glb or .stl"
};

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
    #[error("{}: found extension {found:?}, expected {WRITTEN}", path.display())]
    Extension {
        /// The file.
        path: PathBuf,
        /// The extension, empty where there is none.
        found: String,
    },
    /// The mesh is not one that a file could hold.
    #[error("{}: not written, {source}", path.display())]
    Mesh {
        /// The file.
        path: PathBuf,
        /// What is wrong with the mesh.
        source: EncodeError,
    },
    /// The format cannot hold the grid.
    #[error("{}: not written: {what}", path.display())]
    Voxels {
        /// The file.
        path: PathBuf,
        /// What is in the way.
        what: String,
    },
}

#[cfg(all(test, feature = "files"))]
mod tests {
    use super::*;

    #[test]
    fn long_findings_are_cut_between_characters() {
        let message = |found: &str| {
            ReadMeshError::malformed(Path::new("a.obj"), "v", found, "a number").to_string()
        };
        assert!(message("1 2 x").contains("found 1 2 x, expected"));
        assert!(message(&"\u{e9}".repeat(5_000_000)).len() < 300);
        assert!(message(&"7".repeat(80)).contains(&"7".repeat(80)));
        assert!(message("a\u{1b}[2J").contains("found a\\u{1b}[2J,"));
        assert!(message(&"7".repeat(81)).contains(&format!("{}...,", "7".repeat(77))));
    }
}
