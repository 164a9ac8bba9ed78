//! The bytes of regular files.

use std::fs::File;
use std::io::Read;
use std::path::Path;

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
