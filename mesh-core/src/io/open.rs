//! Opening files: regular ones only, and those that a file names only below its own folder.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::{NotRead, ReadMeshError};
use crate::{Budget, Limits};

/// The bytes of a regular file, and what reading it may hold, the bytes themselves counted.
pub(super) fn read_bytes(path: &Path, limits: &Limits) -> Result<(Vec<u8>, Budget), ReadMeshError> {
    let bytes =
        regular(path).map_err(|source| ReadMeshError::Io { path: path.to_owned(), source })?;
    let mut budget = limits.budget(bytes.len() as u64);
    budget
        .take(bytes.len() as u64)
        .map_err(|source| ReadMeshError::OverLimit { path: path.to_owned(), source })?;
    Ok((bytes, budget))
}

/// The bytes of a regular file. Devices and pipes may never end, and opening a pipe may never
/// return, so they are refused unopened.
pub(crate) fn regular(path: &Path) -> std::io::Result<Vec<u8>> {
    let kind = std::fs::metadata(path)?;
    if !kind.is_file() {
        let what = if kind.is_dir() { "it is a folder" } else { "not a regular file" };
        return Err(std::io::Error::other(what));
    }
    let mut bytes = Vec::new();
    // What grows while it is read ends where it ended when it was opened.
    let length = kind.len();
    bytes.try_reserve_exact(usize::try_from(length).unwrap_or(usize::MAX))?;
    File::open(path)?.take(length).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// The folder of a mesh, below which the files that it names must be.
pub(super) struct Root {
    folder: PathBuf,
    outside: bool,
}

impl Root {
    pub(super) fn of(path: &Path, limits: &Limits) -> Self {
        let folder = folder_of(path);
        // Links are resolved on both sides, or none would be below it.
        let folder = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
        Self { folder, outside: limits.outside_links }
    }

    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    /// The regular file that `name`, seen from `folder`, stands for, without links in its path.
    pub(super) fn find(&self, folder: &Path, name: &str) -> Result<PathBuf, NotRead> {
        let file = folder.join(name.replace('\\', "/"));
        let file = file.canonicalize().map_err(|_| NotRead::Missing)?;
        if !self.outside && !file.starts_with(&self.folder) {
            return Err(NotRead::Outside);
        }
        if file.is_file() { Ok(file) } else { Err(NotRead::NotAFile) }
    }
}

/// The folder that a file is in; `.` for a bare name.
pub(super) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}
