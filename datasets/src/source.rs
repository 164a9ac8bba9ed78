//! A folder or a zip archive, read alike: names in, bytes out.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU16, Ordering};

use mesh_core::{Limits, OverLimit};
use zip::ZipArchive;
use zip::result::ZipError;

use crate::content::{Content, inflated, over};
use crate::error::{ReadViewsError, ViewsProblem};

/// Where the files of a set of views come from. Names use `/` and are relative to the root.
///
/// Shared between threads; an archive is opened anew by every thread (see [`Source::open`]), so
/// that entries decompress in parallel without a lock.
#[derive(Debug)]
pub(crate) struct Source {
    /// The folder or the archive.
    pub(crate) path: PathBuf,
    /// Put before every name: the one folder at the root of an archive, with its slash, or nothing.
    prefix: String,
    /// The archive's entries by their names with `/`, each as it is called in the archive; `None` for a folder.
    entries: Option<BTreeMap<String, String>>,
    /// How many folders above its own a name may reach.
    above: usize,
    limits: Limits,
    /// Whether pixels are counted as they are stored, whatever EXIF says of how the camera was held.
    stored_pixels: bool,
    /// The brightest value in files of masks.
    brightest: Brightest,
}

/// The largest value that was found in files of masks so far, by any thread.
#[derive(Clone, Debug, Default)]
pub(crate) struct Brightest(Arc<AtomicU16>);

impl Brightest {
    pub(crate) fn note(&self, value: u8) {
        // 0 is for none.
        self.0.fetch_max(u16::from(value) + 1, Ordering::Relaxed);
    }

    /// None where no file was read.
    pub(crate) fn value(&self) -> Option<u16> {
        self.0.load(Ordering::Relaxed).checked_sub(1)
    }
}

/// A source opened by one thread.
pub(crate) struct Opened<'a> {
    source: &'a Source,
    archive: Option<ZipArchive<BufReader<File>>>,
}

impl Source {
    /// A folder.
    pub(crate) fn folder(path: &Path) -> Self {
        let limits = Limits::default();
        let (path, prefix) = (path.to_owned(), String::new());
        let (stored_pixels, brightest) = (false, Brightest::default());
        Self { path, prefix, entries: None, above: 0, limits, stored_pixels, brightest }
    }

    /// A zip archive; its table of contents is read once, here.
    pub(crate) fn zip(path: &Path) -> Result<Self, ReadViewsError> {
        let archive = open_archive(path)?;
        let names: BTreeMap<String, String> = archive
            .file_names()
            .filter_map(Result::ok)
            .map(|name| (tidy(&name), name.into_owned()))
            .filter(|(name, _)| !name.ends_with('/') && !is_clutter(name))
            .collect();
        let prefix = common_folder(&names);
        let limits = Limits::default();
        let (path, entries) = (path.to_owned(), Some(names));
        let (stored_pixels, brightest) = (false, Brightest::default());
        Ok(Self { path, prefix, entries, above: 0, limits, stored_pixels, brightest })
    }

    /// The same folder, whose files may also lie so many folders above it: `../images/0.png`.
    pub(crate) fn reaching(self, above: usize) -> Self {
        Self { above, ..self }
    }

    /// The same, whose files are held to these limits.
    pub(crate) fn within(self, limits: Limits) -> Self {
        Self { limits, ..self }
    }

    /// The same, whose images are not turned as EXIF says.
    pub(crate) fn with_stored_pixels(self) -> Self {
        Self { stored_pixels: true, ..self }
    }

    /// Whether images are not turned as EXIF says.
    pub(crate) fn has_stored_pixels(&self) -> bool {
        self.stored_pixels
    }

    /// The same, which notes the values of masks there.
    pub(crate) fn noting(self, brightest: Brightest) -> Self {
        Self { brightest, ..self }
    }

    /// The brightest value in files of masks.
    pub(crate) fn brightest(&self) -> &Brightest {
        &self.brightest
    }

    /// Whether a name stays where names of this source may be. Absolute ones never do.
    pub(crate) fn is_inside(&self, name: &str) -> bool {
        let mut parts = Path::new(name).components();
        let above = parts.try_fold(self.above, |above, part| match part {
            Component::Normal(_) => above.checked_add(1),
            Component::ParentDir => above.checked_sub(1),
            Component::CurDir => Some(above),
            Component::RootDir | Component::Prefix(_) => None,
        });
        above.is_some()
    }

    /// The error of a file that is not there; or that is there, and is not for reading.
    pub(crate) fn missing(&self, name: &str, wanted_by: String) -> ReadViewsError {
        let path = self.locate(name);
        let problem = if !self.is_inside(&self.placed(name)) {
            ViewsProblem::Outside { wanted_by }
        } else if self.entries.is_none() && path.exists() {
            ViewsProblem::Irregular
        } else {
            ViewsProblem::Missing { wanted_by }
        };
        ReadViewsError::new(path, problem)
    }

    /// The error of a view's file that is not there; nothing where it is.
    pub(crate) fn need(
        &self,
        name: &str,
        wanted_by: impl FnOnce() -> String,
    ) -> Result<(), ReadViewsError> {
        if self.has(name) { Ok(()) } else { Err(self.missing_view(name, wanted_by())) }
    }

    /// The error of a view's file that is not there; or that is there, and is not for reading.
    pub(crate) fn missing_view(&self, name: &str, wanted_by: String) -> ReadViewsError {
        let ReadViewsError { path, problem } = self.missing(name, wanted_by);
        match problem {
            ViewsProblem::Missing { wanted_by } => ReadViewsError::missing_view(path, wanted_by),
            problem => ReadViewsError { path, problem },
        }
    }

    /// Whether the source is a zip archive.
    pub(crate) fn is_zip(&self) -> bool {
        self.entries.is_some()
    }

    /// The name by which a file is there: that with `/` where Windows wrote `\\` and no file is called so.
    fn placed<'n>(&self, name: &'n str) -> Cow<'n, str> {
        match self.entries {
            Some(_) => tidy(name).into(),
            None if name.contains('\\') && !self.path.join(name).exists() => tidy(name).into(),
            None => name.into(),
        }
    }

    /// Where a file is, for messages.
    pub(crate) fn locate(&self, name: &str) -> PathBuf {
        self.path.join(format!("{}{}", self.prefix, self.placed(name)))
    }

    /// Names of the files at the root, sorted.
    pub(crate) fn root_names(&self) -> Result<Vec<String>, ReadViewsError> {
        if let Some(entries) = &self.entries {
            return Ok(entries
                .keys()
                .filter_map(|name| name.strip_prefix(self.prefix.as_str()))
                .filter(|name| !name.contains('/'))
                .map(String::from)
                .collect());
        }
        names_of(&self.path).map_err(|e| ReadViewsError::new(&self.path, e))
    }

    /// Names of the files in a folder, sorted, without those in folders of it; none where there is
    /// no such folder.
    pub(crate) fn names_in(&self, folder: &str) -> Vec<String> {
        let inside = format!("{}{}/", self.prefix, tidy(folder));
        if let Some(entries) = &self.entries {
            let names = entries.keys().filter_map(|name| name.strip_prefix(inside.as_str()));
            return names.filter(|name| !name.contains('/')).map(String::from).collect();
        }
        let folder = self.path.join(folder);
        let mut names = names_of(&folder).unwrap_or_default();
        names.retain(|name| folder.join(name).is_file());
        names
    }

    /// Whether the file exists, is one (no pipe, no device), and lies where names may be.
    pub(crate) fn has(&self, name: &str) -> bool {
        let name = self.placed(name);
        match &self.entries {
            Some(entries) => entries.contains_key(&format!("{}{name}", self.prefix)),
            None => self.is_inside(&name) && self.path.join(&*name).is_file(),
        }
    }

    /// Opens the source for one thread.
    pub(crate) fn open(&self) -> Result<Opened<'_>, ReadViewsError> {
        let archive = if self.is_zip() { Some(open_archive(&self.path)?) } else { None };
        Ok(Opened { source: self, archive })
    }
}

impl<'a> Opened<'a> {
    /// Where the files come from.
    pub(crate) fn source(&self) -> &'a Source {
        self.source
    }

    /// What each file may make its reader take.
    pub(crate) fn limits(&self) -> &Limits {
        &self.source.limits
    }

    /// The bytes of a file, of which there may be at most `limit`.
    ///
    /// What an entry claims about its size is believed only when it refuses; the limit also holds
    /// for what really comes out, so that neither a forged header nor a bomb takes the memory.
    pub(crate) fn read(
        &mut self,
        name: &str,
        field: &str,
        limit: u64,
    ) -> Result<Content, ReadViewsError> {
        let path = self.source.locate(name);
        let placed = self.source.placed(name);
        let missing = || self.source.missing(name, format!("the {field} is read from it"));
        let (limit, read) = match &mut self.archive {
            Some(archive) => {
                let entry = format!("{}{placed}", self.source.prefix);
                let stored = self.source.entries.as_ref().and_then(|all| all.get(&entry));
                match archive.by_name(stored.unwrap_or(&entry)) {
                    Ok(file) => {
                        let stored = file.compressed_size();
                        let limit = limit.min(inflated(stored, &self.source.limits));
                        (limit, read_at_most(file.size(), stored, file, limit))
                    }
                    Err(ZipError::FileNotFound) => {
                        (limit, Err(std::io::ErrorKind::NotFound.into()))
                    }
                    Err(error) => return Err(ReadViewsError::new(path, error)),
                }
            }
            None if !self.source.is_inside(&placed) => return Err(missing()),
            None => (limit, read_regular(&self.source.path.join(&*placed), limit)),
        };
        match read {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Err(missing()),
            read => content(read, &path, field, limit, &self.source.limits),
        }
    }
}

/// Bytes, and how many of them were stored.
type Stored = (Vec<u8>, u64);

/// The bytes of a file that a user names, of which there may be at most `limit`.
///
/// # Errors
/// If it cannot be read, is no file, or has more bytes.
pub(crate) fn read_file(path: &Path, field: &str, limit: u64) -> Result<Content, ReadViewsError> {
    content(read_regular(path, limit), path, field, limit, &Limits::default())
}

/// What was read, counted; or why it is none.
fn content(
    read: std::io::Result<Result<Stored, u64>>,
    path: &Path,
    field: &str,
    limit: u64,
    limits: &Limits,
) -> Result<Content, ReadViewsError> {
    match read {
        Ok(Ok((bytes, stored))) => {
            Content::new(bytes, stored, limits).map_err(|limit| over(path, field, limit))
        }
        Ok(Err(needed)) => Err(over(path, field, OverLimit { needed, most: limit })),
        // What the standard library says of something that is there and is no file.
        Err(error) if error.kind() == std::io::ErrorKind::InvalidInput => {
            Err(ReadViewsError::new(path, ViewsProblem::Irregular))
        }
        Err(error) => Err(ReadViewsError::new(path, error)),
    }
}

/// The bytes of a file, or how many there are where that is more than `limit`.
///
/// A pipe would wait for somebody to write into it, and a device may never end: neither is opened.
fn read_regular(path: &Path, limit: u64) -> std::io::Result<Result<Stored, u64>> {
    if !std::fs::metadata(path)?.is_file() {
        return Err(std::io::ErrorKind::InvalidInput.into());
    }
    let file = File::open(path)?;
    let length = file.metadata()?.len();
    read_at_most(length, length, file, limit)
}

/// The bytes, or how many there are or are claimed to be where that is more than `limit`.
fn read_at_most(
    claimed: u64,
    stored: u64,
    file: impl Read,
    limit: u64,
) -> std::io::Result<Result<Stored, u64>> {
    if claimed > limit {
        return Ok(Err(claimed));
    }
    // One byte more than there should be, so that the end is seen without room for twice as much.
    let mut bytes = Vec::with_capacity(claimed as usize + 1);
    let found = file.take(claimed + 1).read_to_end(&mut bytes)? as u64;
    if found > claimed {
        let what = format!("more bytes than the {claimed} that it says");
        return Err(std::io::Error::new(std::io::ErrorKind::InvalidData, what));
    }
    Ok(Ok((bytes, stored)))
}

/// The names in a folder, sorted, without what systems add of their own; those that are not text belong to no layout.
pub(crate) fn names_of(folder: &Path) -> std::io::Result<Vec<String>> {
    let entries: Result<Vec<_>, _> = std::fs::read_dir(folder)?.collect();
    let names = entries?.into_iter().filter_map(|entry| entry.file_name().into_string().ok());
    let mut names: Vec<String> = names.filter(|name| !is_clutter(name)).collect();
    names.sort_unstable();
    Ok(names)
}

fn open_archive(path: &Path) -> Result<ZipArchive<BufReader<File>>, ReadViewsError> {
    let file = File::open(path).map_err(|e| ReadViewsError::new(path, e))?;
    ZipArchive::new(BufReader::new(file)).map_err(|e| ReadViewsError::new(path, e))
}

/// What archivers and file managers add of their own.
fn is_clutter(name: &str) -> bool {
    let clutter = ["__MACOSX", ".DS_Store", "Thumbs.db", "desktop.ini"];
    // macOS keeps beside `a.png`, as `._a.png`, what other file systems have no place for.
    name.split('/').any(|part| part.starts_with("._") || clutter.contains(&part))
}

/// A name with `/` and without `./` at its front, for archives, whose names are compared as text, and for names that Windows wrote.
fn tidy(name: &str) -> String {
    name.replace('\\', "/").trim_start_matches("./").to_owned()
}

/// The folder that every name is in, with its slash; empty where there is none.
fn common_folder(names: &BTreeMap<String, String>) -> String {
    let mut prefix = String::new();
    loop {
        let rest = |name: &str| name.strip_prefix(prefix.as_str()).map(str::to_owned);
        let Some(first) = names.keys().next().and_then(|n| rest(n)) else { return prefix };
        let Some(slash) = first.find('/') else { return prefix };
        let longer = format!("{prefix}{}", &first[..=slash]);
        if !names.keys().all(|name| name.starts_with(&longer)) {
            return prefix;
        }
        prefix = longer;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_folder_that_all_entries_share_is_found() {
        let set = |names: &[&str]| names.iter().map(|&n| (n.to_owned(), n.to_owned())).collect();
        assert_eq!(common_folder(&set(&["a/b/1", "a/b/2"])), "a/b/");
        assert_eq!(common_folder(&set(&["a/1", "b/2"])), "");
        assert_eq!(common_folder(&set(&["1", "a/2"])), "");
        assert_eq!(common_folder(&set(&[])), "");
    }
}
