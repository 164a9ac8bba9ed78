//! Output folders that appear whole or not at all.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

/// Why an output folder cannot be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OutputError {
    /// There is something at the path already.
    #[error("{} exists already; choose another folder or allow overwriting (--force)", path.display())]
    Exists {
        /// The path asked for.
        path: PathBuf,
    },
    /// The path is taken by something that is not a folder.
    #[error("{} is not a folder; choose another path for the output", path.display())]
    NotAFolder {
        /// The path asked for.
        path: PathBuf,
    },
    /// The file system refused.
    #[error("cannot write {}: {source}; check that the folder exists and that you may write there", path.display())]
    Io {
        /// The file or folder that failed.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

/// A folder under construction beside its final place.
///
/// Files are written into [`OutputFolder::path`]; [`OutputFolder::commit`] moves them to the final
/// place. Dropped before that, it leaves nothing behind and whatever stood at the final place as it was.
///
/// ```
/// use recon::output::OutputFolder;
/// let place = tempfile::tempdir()?;
/// let folder = OutputFolder::create(&place.path().join("out"), false)?;
/// folder.write("note.txt", b"done")?;
/// let path = folder.commit()?;
/// assert_eq!(std::fs::read(path.join("note.txt"))?, b"done");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct OutputFolder {
    target: PathBuf,
    work: TempDir,
}

impl OutputFolder {
    /// Prepares a folder that will stand at `target`, creating its parents.
    ///
    /// Done before long work starts, this finds out whether the place can be written at all.
    ///
    /// # Errors
    /// If `target` exists and `overwrite` is false, is a file, or cannot be written.
    pub fn create(target: &Path, overwrite: bool) -> Result<Self, OutputError> {
        if target.exists() {
            if !target.is_dir() {
                return Err(OutputError::NotAFolder { path: target.into() });
            }
            if !overwrite {
                return Err(OutputError::Exists { path: target.into() });
            }
        }
        let parent = match target.parent() {
            Some(p) if !p.as_os_str().is_empty() => p,
            _ => Path::new("."),
        };
        let io = |source| OutputError::Io { path: target.into(), source };
        fs::create_dir_all(parent).map_err(io)?;
        let work = tempfile::Builder::new().prefix(".unsphere-").tempdir_in(parent).map_err(io)?;
        Ok(Self { target: target.into(), work })
    }

    /// Where to put the files until [`OutputFolder::commit`].
    pub fn path(&self) -> &Path {
        self.work.path()
    }

    /// Writes one file into the folder.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<(), OutputError> {
        let path = self.path().join(name);
        fs::write(&path, bytes).map_err(|source| OutputError::Io { path, source })
    }

    /// Moves everything to the final place and returns it.
    ///
    /// A new folder appears in one step. Into an existing folder each entry is moved by itself,
    /// replacing one of its name; entries of other names are left alone.
    ///
    /// # Errors
    /// If the final place has become unwritable.
    pub fn commit(self) -> Result<PathBuf, OutputError> {
        let Self { target, work } = self;
        let io = |path: &Path| {
            let path = path.to_path_buf();
            move |source| OutputError::Io { path, source }
        };
        make_readable(work.path()).map_err(io(work.path()))?;
        if !target.exists() {
            fs::rename(work.path(), &target).map_err(io(&target))?;
            // The folder has moved: there is nothing left to clean up.
            let _ = work.keep();
            return Ok(target);
        }
        for entry in fs::read_dir(work.path()).map_err(io(work.path()))? {
            let entry = entry.map_err(io(work.path()))?;
            let place = target.join(entry.file_name());
            if place.is_dir() {
                fs::remove_dir_all(&place).map_err(io(&place))?;
            }
            fs::rename(entry.path(), &place).map_err(io(&place))?;
        }
        Ok(target)
    }
}

/// Temporary folders are private to their owner; the finished one should be like any other.
#[cfg(unix)]
fn make_readable(path: &Path) -> io::Result<()> {
    use std::os::unix::fs::PermissionsExt as _;
    fs::set_permissions(path, fs::Permissions::from_mode(0o755))
}

#[cfg(not(unix))]
fn make_readable(_: &Path) -> io::Result<()> {
    Ok(())
}

/// Removes the named files and folders below a folder, and leaves all others alone; what is not
/// there is no error.
pub(crate) fn remove_within(folder: &Path, names: &[&str]) -> Result<(), (PathBuf, io::Error)> {
    for name in names {
        let path = folder.join(name);
        let removed = match fs::symlink_metadata(&path) {
            Ok(found) if found.is_dir() => fs::remove_dir_all(&path),
            Ok(_) => fs::remove_file(&path),
            Err(_) => Ok(()),
        };
        removed.map_err(|source| (path, source))?;
    }
    Ok(())
}

/// Writes a file below a folder, whole or not at all, with the folders on the way to it.
pub(crate) fn write_within(
    folder: &Path,
    name: &str,
    bytes: &[u8],
) -> Result<(), (PathBuf, io::Error)> {
    let path = folder.join(name);
    let made = path.parent().map_or(Ok(()), fs::create_dir_all);
    let written = made.and_then(|()| {
        mesh_core::io::write_atomic(&path, |out| out.write_all(bytes))
            .map_err(|error| io::Error::other(error.to_string()))
    });
    written.map_err(|source| (path, source))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_left_without_a_commit() {
        let place = tempfile::tempdir().unwrap();
        let target = place.path().join("out");
        let folder = OutputFolder::create(&target, false).unwrap();
        folder.write("a", b"1").unwrap();
        drop(folder);
        assert_eq!(fs::read_dir(place.path()).unwrap().count(), 0);
    }

    #[test]
    fn what_exists_is_refused_unless_overwriting() {
        let place = tempfile::tempdir().unwrap();
        let target = place.path().join("out");
        fs::create_dir(&target).unwrap();
        fs::write(target.join("mine"), b"keep").unwrap();
        fs::write(target.join("mesh.ply"), b"old").unwrap();
        let refusal = OutputFolder::create(&target, false).unwrap_err();
        assert!(refusal.to_string().contains("--force"), "{refusal}");
        let folder = OutputFolder::create(&target, true).unwrap();
        folder.write("mesh.ply", b"new").unwrap();
        folder.commit().unwrap();
        assert_eq!(fs::read(target.join("mine")).unwrap(), b"keep");
        assert_eq!(fs::read(target.join("mesh.ply")).unwrap(), b"new");
        assert_eq!(fs::read_dir(place.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_file_in_the_way_is_refused_even_when_overwriting() {
        let place = tempfile::tempdir().unwrap();
        let target = place.path().join("out");
        fs::write(&target, b"a file").unwrap();
        assert!(matches!(OutputFolder::create(&target, true), Err(OutputError::NotAFolder { .. })));
    }
}
