//! Writes that outlast a kill, and where it matters a power cut.
//!
//! A file is whole at any moment: it is written under another name first. One of `write_whole` is on the disk, with its
//! name, before the function returns; one of `write_derived` may be lost in a power cut. What runs, studies and datasets
//! go on from is changed through here alone, so that a test can record the changes and replay them, cut off anywhere
//! (`journal`).

use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

#[cfg(test)]
use super::journal::{Change, note};

/// Files that are not finished are named after the one they become, behind this. The name is always the same: who
/// holds the folder's lock may remove what a killed process left.
const UNFINISHED: &str = ".unfinished-";

/// Whether a file was on its way to another name.
pub(super) fn is_unfinished(name: &str) -> bool {
    name.starts_with(UNFINISHED)
}

/// The folder that a path is in.
pub(super) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// Makes a folder and those above it, for good.
///
/// # Errors
/// What the system says of the first that cannot be made.
pub fn make_folders(path: &Path) -> io::Result<()> {
    if path.is_dir() {
        return Ok(());
    }
    let above = folder_of(path);
    if above != path {
        make_folders(above)?;
    }
    match make_folder(path) {
        // Someone else was quicker.
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists && path.is_dir() => {
            sync_folder(above)
        }
        made => made,
    }
}

/// Makes a folder that was not there, for good.
pub(super) fn make_folder(path: &Path) -> io::Result<()> {
    fs::create_dir(path)?;
    #[cfg(test)]
    note(Change::Folder(path.to_owned()));
    sync_folder(folder_of(path))
}

/// Writes a file, whole or not at all, for good; what stood under its name stays until then.
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    replace(path, bytes, true)?;
    sync_folder(folder_of(path))
}

/// Writes a file that can be made again: whole or not at all for who reads it and after a kill, but a power cut may take
/// its content. Waiting for the disk would cost more than making it again.
pub(crate) fn write_derived(path: &Path, bytes: &[u8]) -> io::Result<()> {
    replace(path, bytes, false)
}

/// Puts a file in the place of what stood under its name.
fn replace(path: &Path, bytes: &[u8], sync: bool) -> io::Result<()> {
    let mut name = OsString::from(UNFINISHED);
    name.push(path.file_name().ok_or(io::ErrorKind::InvalidFilename)?);
    let unfinished = path.with_file_name(name);
    let written = write_new(&unfinished, bytes, sync).and_then(|()| rename(&unfinished, path));
    if written.is_err() {
        // It may be the reason: a full disk.
        let _ = remove_file(&unfinished);
    }
    written
}

/// Writes a file that nobody sees yet.
fn write_new(path: &Path, bytes: &[u8], sync: bool) -> io::Result<()> {
    present(remove_file(path))?;
    let mut file = OpenOptions::new().write(true).create_new(true).open(path)?;
    #[cfg(test)]
    note(Change::Write(path.to_owned(), bytes.to_owned()));
    file.write_all(bytes)?;
    if sync { sync_file(&file, path) } else { Ok(()) }
}

/// Gives a file or folder another name; [`sync_folder`] makes it last.
pub(super) fn rename(from: &Path, to: &Path) -> io::Result<()> {
    fs::rename(from, to)?;
    #[cfg(test)]
    note(Change::Rename(from.to_owned(), to.to_owned()));
    Ok(())
}

/// Removes a file.
pub(super) fn remove_file(path: &Path) -> io::Result<()> {
    fs::remove_file(path)?;
    #[cfg(test)]
    note(Change::Remove(path.to_owned()));
    Ok(())
}

/// Removes a folder with all that is in it.
pub(super) fn remove_folder(path: &Path) -> io::Result<()> {
    fs::remove_dir_all(path)?;
    #[cfg(test)]
    note(Change::Remove(path.to_owned()));
    Ok(())
}

/// Moves a folder that others wrote to its place, for good: all that is in it is on the disk before it gets its name, and
/// its name before it is called done. What stood at the place is removed.
///
/// # Errors
/// What the system says of the first step that fails. What stood at the place may then be gone.
pub fn publish(from: &Path, to: &Path) -> io::Result<()> {
    sync_tree(from)?;
    make_folders(folder_of(to))?;
    if to.exists() {
        remove_folder(to)?;
    }
    rename(from, to)?;
    sync_folder(folder_of(to))
}

/// Brings the names in a folder to the disk.
pub(crate) fn sync_folder(path: &Path) -> io::Result<()> {
    // Elsewhere a folder cannot be opened, and names need no help.
    if cfg!(unix) {
        lenient(File::open(path)?.sync_all())?;
    }
    #[cfg(test)]
    note(Change::SyncFolder(path.to_owned()));
    Ok(())
}

/// Brings a folder that others wrote to the disk, with everything in it.
pub(super) fn sync_tree(path: &Path) -> io::Result<()> {
    for entry in fs::read_dir(path)? {
        let entry = entry?;
        let (kind, path) = (entry.file_type()?, entry.path());
        if kind.is_dir() {
            #[cfg(test)]
            note(Change::Folder(path.clone()));
            sync_tree(&path)?;
        } else if kind.is_file() {
            #[cfg(test)]
            note(Change::Write(path.clone(), fs::read(&path)?));
            // Windows syncs only what may be written.
            let file = OpenOptions::new().read(true).write(cfg!(windows)).open(&path)?;
            sync_file(&file, &path)?;
        }
    }
    sync_folder(path)
}

#[cfg_attr(not(test), expect(unused_variables, reason = "the journal of tests has the path"))]
fn sync_file(file: &File, path: &Path) -> io::Result<()> {
    lenient(file.sync_all())?;
    #[cfg(test)]
    note(Change::Sync(path.to_owned()));
    Ok(())
}

/// Some file systems know no syncing: they do what they can.
fn lenient(synced: io::Result<()>) -> io::Result<()> {
    use io::ErrorKind::{InvalidInput, Unsupported};
    match synced {
        Err(error) if matches!(error.kind(), InvalidInput | Unsupported) => Ok(()),
        synced => synced,
    }
}

/// A file that grows at its end; what was added is never rewritten.
#[derive(Debug)]
pub(crate) struct Growing {
    path: PathBuf,
    file: File,
    length: u64,
    /// Whether there may be something behind its end: a part of what did not fit, which could not be cut off.
    torn: bool,
}

impl Growing {
    /// Opens a file that is there, and goes on behind so many of its bytes; the others are cut off.
    pub(crate) fn open(path: PathBuf, length: u64) -> io::Result<Self> {
        // Not to append: Windows cuts no file that was opened so.
        let file = OpenOptions::new().write(true).open(&path)?;
        let mut growing = Self { path, file, length, torn: true };
        growing.cut()?;
        Ok(growing)
    }

    /// Adds bytes in one write. If they do not fit, none of them is left; where not even that can be had, at the latest
    /// the next bytes do not follow a part of them.
    pub(crate) fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        if self.torn {
            self.cut()?;
        }
        let end = SeekFrom::Start(self.length);
        let written = self.file.seek(end).and_then(|_| self.file.write_all(bytes));
        if let Err(error) = written {
            self.torn = true;
            let _ = self.cut();
            return Err(error);
        }
        self.length += bytes.len() as u64;
        #[cfg(test)]
        note(Change::Append(self.path.clone(), bytes.to_owned()));
        Ok(())
    }

    /// Brings everything to the disk.
    pub(crate) fn sync(&self) -> io::Result<()> {
        sync_file(&self.file, &self.path)
    }

    /// Where it is.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    fn cut(&mut self) -> io::Result<()> {
        self.file.set_len(self.length)?;
        self.torn = false;
        #[cfg(test)]
        note(Change::Cut(self.path.clone(), self.length as usize));
        Ok(())
    }
}

/// What was looked for; none if it is not there.
///
/// # Errors
/// What the system says of it otherwise.
pub fn present<T>(found: io::Result<T>) -> io::Result<Option<T>> {
    match found {
        Ok(found) => Ok(Some(found)),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    /// A part of what did not fit stays in the file, since it cannot be cut either.
    #[test]
    fn nothing_follows_what_could_not_be_cut_off() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("log");
        fs::write(&path, "").unwrap();
        let mut log = Growing::open(path.clone(), 0).unwrap();
        log.append(b"one\n").unwrap();
        let sound = std::mem::replace(&mut log.file, File::open(&path).unwrap());
        fs::write(&path, "one\nthe beginning of a long line").unwrap();
        assert!(log.append(b"a long line\n").is_err());
        // Still: nothing may be added.
        assert!(log.append(b"two\n").is_err());
        log.file = sound;
        log.append(b"two\n").unwrap();
        log.append(b"three\n").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"one\ntwo\nthree\n");
    }
}
