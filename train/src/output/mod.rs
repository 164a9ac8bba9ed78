//! Output folders that appear whole or not at all, and who works in them.

pub mod disk;
#[cfg(test)]
pub(crate) mod journal;
mod lock;

use std::ffi::{OsStr, OsString};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

pub use disk::present;
pub use lock::{Lock, LockError};

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
    /// Another process writes to the same place.
    #[error("{} is being written by {holder}; wait until it ends, or choose another folder", path.display())]
    Busy {
        /// The path asked for.
        path: PathBuf,
        /// Process, machine and since when, as the other noted it.
        holder: String,
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
/// A process that is killed leaves its unfinished folder, which the next one for the same place removes: the
/// folder's name carries the place, and a lock in it tells whether anyone is still at work. On a file system without locks
/// each process has an unfinished folder of its own, and that of a killed one stays.
///
/// ```
/// use train::output::OutputFolder;
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
    /// Holds the lock and the files.
    unfinished: PathBuf,
    files: PathBuf,
    lock: Option<Lock>,
}

impl OutputFolder {
    /// Prepares a folder that will stand at `target`, creating its parents.
    ///
    /// Done before long work starts, this finds out whether the place can be written at all.
    ///
    /// # Errors
    /// If `target` exists and `overwrite` is false, is a file, cannot be written, or is being written by another process.
    pub fn create(target: &Path, overwrite: bool) -> Result<Self, OutputError> {
        if target.exists() {
            if !target.is_dir() {
                return Err(OutputError::NotAFolder { path: target.into() });
            }
            if !overwrite {
                return Err(OutputError::Exists { path: target.into() });
            }
        }
        let io = |source| OutputError::Io { path: target.into(), source };
        let parent = disk::folder_of(target);
        disk::make_folders(parent).map_err(io)?;
        let unfinished = parent.join(unfinished_name(target));
        let lock = loop {
            disk::make_folders(&unfinished).map_err(io)?;
            match Lock::take(&unfinished.join("lock")) {
                Ok(lock) => break lock,
                // One that ended just now took the folder along.
                Err(LockError::Io(error)) if error.kind() == io::ErrorKind::NotFound => {}
                Err(LockError::Io(source)) => return Err(io(source)),
                Err(LockError::Busy(holder)) => {
                    return Err(OutputError::Busy { path: target.into(), holder });
                }
            }
        };
        let (lock, unfinished) = if lock.is_held() {
            (Some(lock), unfinished)
        } else {
            drop(lock);
            // Another process may be about to do the same.
            let _ = fs::remove_dir(&unfinished);
            (None, own_folder(parent, &unfinished_name(target)).map_err(io)?)
        };
        let files = unfinished.join("files");
        let folder = Self { target: target.into(), unfinished, files, lock };
        if folder.files.exists() {
            fs::remove_dir_all(&folder.files).map_err(io)?;
        }
        disk::make_folders(&folder.files).map_err(io)?;
        Ok(folder)
    }

    /// Where to put the files until [`OutputFolder::commit`].
    pub fn path(&self) -> &Path {
        &self.files
    }

    /// What is in the way if this process ends without dropping this: to be removed then.
    pub fn unfinished(&self) -> &Path {
        &self.unfinished
    }

    /// Writes one file into the folder.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<(), OutputError> {
        let path = self.path().join(name);
        fs::write(&path, bytes).map_err(|source| OutputError::Io { path, source })
    }

    /// Moves everything to the final place and returns it. All of it is on the disk then.
    ///
    /// A new folder appears in one step. Into an existing folder each entry is moved by itself,
    /// replacing one of its name; entries of other names are left alone.
    ///
    /// # Errors
    /// If the final place has become unwritable.
    pub fn commit(self) -> Result<PathBuf, OutputError> {
        let (files, target) = (self.path(), &self.target);
        let io = |path: &Path| {
            let path = path.to_path_buf();
            move |source| OutputError::Io { path, source }
        };
        disk::sync_tree(files).map_err(io(target))?;
        if target.exists() {
            for entry in fs::read_dir(files).map_err(io(files))? {
                let entry = entry.map_err(io(files))?;
                let place = target.join(entry.file_name());
                let own = entry.file_type().map_err(io(files))?;
                // A folder goes before anything takes its name, and anything goes before a folder does. A link is no folder.
                let removed = match fs::symlink_metadata(&place) {
                    Ok(found) if found.is_dir() => disk::remove_folder(&place),
                    Ok(_) if own.is_dir() => disk::remove_file(&place),
                    _ => Ok(()),
                };
                removed.map_err(io(&place))?;
                disk::rename(&entry.path(), &place).map_err(io(&place))?;
            }
            disk::sync_folder(target).map_err(io(target))?;
        } else {
            disk::rename(files, target).map_err(io(target))?;
        }
        disk::sync_folder(disk::folder_of(target)).map_err(io(target))?;
        Ok(target.clone())
    }
}

impl Drop for OutputFolder {
    fn drop(&mut self) {
        // What resists is left, for the next one that writes here. The lock goes last, and the folder only once it is
        // empty: another process may be waiting for it.
        let _ = fs::remove_dir_all(&self.files);
        self.lock = None;
        let _ = fs::remove_dir(&self.unfinished);
    }
}

/// The name of the folder in which what will stand at `target` is made.
fn unfinished_name(target: &Path) -> OsString {
    /// Names may have 255 bytes.
    const LONGEST: usize = 200;
    let mut name = OsString::from(".unsphere-");
    match target.file_name() {
        Some(last) if last.len() <= LONGEST => name.push(last),
        Some(last) => {
            let hash = crate::Fingerprint::new().with(last.as_encoded_bytes()).value();
            name.push(format!("{hash:016x}"));
        }
        // The present folder, say.
        None => name.push("output"),
    }
    name
}

/// Makes a folder that no other process has, where there are no locks: its name has the process's number, and that may be
/// another machine's too.
///
/// # Errors
/// If it cannot be made.
pub fn own_folder(parent: &Path, name: &OsStr) -> io::Result<PathBuf> {
    let id = std::process::id();
    for k in 0_u32.. {
        let mut own = name.to_owned();
        own.push(if k == 0 { format!("-{id}") } else { format!("-{id}-{k}") });
        let path = parent.join(own);
        match disk::make_folder(&path) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            made => return made.map(|()| path),
        }
    }
    Err(io::ErrorKind::AlreadyExists.into())
}

/// The file in a folder that whoever works in it holds locked.
pub(crate) const LOCK: &str = ".lock";

/// Whether a file in a folder says nothing of what the folder is for: a lock, or what was not finished.
pub fn is_incidental(name: &OsStr) -> bool {
    name == LOCK || name.to_str().is_some_and(disk::is_unfinished)
}

/// Takes a folder for this process alone, as long as the answer lives.
///
/// # Errors
/// If another process has it, by name, or the lock cannot be made.
pub fn lock_folder(folder: &Path) -> Result<Lock, LockError> {
    Lock::take(&folder.join(LOCK))
}

/// Removes what killed processes left in folders that are ours alone.
pub fn sweep<'a>(lock: &Lock, folders: impl IntoIterator<Item = &'a Path>) {
    if !lock.is_held() {
        return;
    }
    for folder in folders {
        // A folder that is not there has nothing to sweep; a file that resists is in nobody's way.
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            if entry.file_name().to_str().is_some_and(disk::is_unfinished) {
                let _ = disk::remove_file(&entry.path());
            }
        }
    }
}

/// Removes the named files and folders below a folder, and leaves all others alone; what is not
/// there is no error.
///
/// # Errors
/// The file that the system would not remove, and why.
pub fn remove_within(folder: &Path, names: &[&str]) -> Result<(), (PathBuf, io::Error)> {
    for name in names {
        let path = folder.join(name);
        let removed = match fs::symlink_metadata(&path) {
            Ok(found) if found.is_dir() => disk::remove_folder(&path),
            Ok(_) => disk::remove_file(&path),
            Err(_) => Ok(()),
        };
        removed.map_err(|source| (path, source))?;
    }
    Ok(())
}

/// Writes a file below a folder, whole or not at all, with the folders on the way to it.
///
/// # Errors
/// The file that could not be written, and why.
pub fn write_within(folder: &Path, name: &str, bytes: &[u8]) -> Result<(), (PathBuf, io::Error)> {
    let path = folder.join(name);
    let made = disk::make_folders(disk::folder_of(&path));
    made.and_then(|()| disk::write_whole(&path, bytes)).map_err(|source| (path, source))
}

/// The same for a file that can be made again: a power cut may take its content.
pub(crate) fn write_derived_within(
    folder: &Path,
    name: &str,
    bytes: &[u8],
) -> Result<(), (PathBuf, io::Error)> {
    let path = folder.join(name);
    let made = disk::make_folders(disk::folder_of(&path));
    made.and_then(|()| disk::write_derived(&path, bytes)).map_err(|source| (path, source))
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

    /// Two processes at once on a file system without locks, as far as one can tell.
    #[test]
    fn without_locks_nobody_touches_anothers_files() {
        lock::tests::LOCKLESS.set(true);
        let place = tempfile::tempdir().unwrap();
        let target = place.path().join("out");
        let first = OutputFolder::create(&target, true).unwrap();
        first.write("first", b"1").unwrap();
        let second = OutputFolder::create(&target, true).unwrap();
        second.write("second", b"2").unwrap();
        let path = first.commit().unwrap();
        assert_eq!(fs::read(path.join("first")).unwrap(), b"1");
        second.commit().unwrap();
        assert_eq!(fs::read(path.join("first")).unwrap(), b"1");
        assert_eq!(fs::read(path.join("second")).unwrap(), b"2");
        assert_eq!(fs::read_dir(place.path()).unwrap().count(), 1);
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

    /// Files where folders are to be, and the other way round.
    #[test]
    fn an_entry_replaces_one_of_its_name_whatever_both_are() {
        let place = tempfile::tempdir().unwrap();
        let target = place.path().join("out");
        fs::create_dir_all(target.join("mesh.ply/deep")).unwrap();
        fs::write(target.join("sequence"), b"a file").unwrap();
        let folder = OutputFolder::create(&target, true).unwrap();
        folder.write("mesh.ply", b"new").unwrap();
        fs::create_dir(folder.path().join("sequence")).unwrap();
        folder.write("sequence/0.png", b"new").unwrap();
        folder.commit().unwrap();
        for name in ["mesh.ply", "sequence/0.png"] {
            assert_eq!(fs::read(target.join(name)).unwrap(), b"new", "{name}");
        }
        assert_eq!(fs::read_dir(&target).unwrap().count(), 2);
    }

    #[test]
    fn a_file_in_the_way_is_refused_even_when_overwriting() {
        let place = tempfile::tempdir().unwrap();
        let target = place.path().join("out");
        fs::write(&target, b"a file").unwrap();
        assert!(matches!(OutputFolder::create(&target, true), Err(OutputError::NotAFolder { .. })));
    }
}
