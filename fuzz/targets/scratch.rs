//! Folders of files out of bytes, for readers that follow paths.

use std::cell::RefCell;
use std::path::{Component, Path, PathBuf};

/// Neither more files are made of one input, nor longer names.
const FILES: usize = 40;
const NAME: usize = 80;

/// Files as one text of bytes: for each its name, a line feed, its length in two bytes, its bytes.
pub(crate) fn packed(files: &[(&str, &[u8])]) -> Vec<u8> {
    let mut out = Vec::new();
    for (name, bytes) in files {
        out.extend(name.bytes());
        out.push(b'\n');
        out.extend((bytes.len() as u16).to_le_bytes());
        out.extend(*bytes);
    }
    out
}

/// The files of such bytes, whatever the bytes.
pub(crate) fn unpacked(mut bytes: &[u8]) -> Vec<(String, &[u8])> {
    let mut files = Vec::new();
    while files.len() < FILES {
        let Some(end) = bytes.iter().take(NAME).position(|&b| b == b'\n') else { break };
        let name = String::from_utf8_lossy(&bytes[..end]).into_owned();
        let Some((length, rest)) = bytes[end + 1..].split_first_chunk() else { break };
        let length = usize::from(u16::from_le_bytes(*length)).min(rest.len());
        files.push((name, &rest[..length]));
        bytes = &rest[length..];
    }
    files
}

thread_local! {
    static PLACE: RefCell<Option<tempfile::TempDir>> = const { RefCell::new(None) };
}

/// Runs a reader over a folder with these files and nothing else.
pub(crate) fn with_files<S: AsRef<str>, B: AsRef<[u8]>>(
    files: &[(S, B)],
    read: impl FnOnce(&Path),
) {
    PLACE.with_borrow_mut(|place| {
        let place = place.get_or_insert_with(|| tempfile::tempdir().expect("a place for files"));
        let root = place.path().join("set");
        // What is left of the input before.
        if root.exists() {
            std::fs::remove_dir_all(&root).expect("a folder of our own");
        }
        std::fs::create_dir_all(&root).expect("a folder");
        for (name, bytes) in files {
            let Some(path) = inside(&root, name.as_ref()) else { continue };
            if let Some(folder) = path.parent() {
                // A file may stand where a folder should be: then this one is not there.
                let _ = std::fs::create_dir_all(folder);
            }
            let _ = std::fs::write(&path, bytes.as_ref());
        }
        read(&root);
    });
}

/// Where a file of this name lies, if that is below the folder.
fn inside(root: &Path, name: &str) -> Option<PathBuf> {
    let fine = |part: Component<'_>| matches!(part, Component::Normal(_));
    let path = Path::new(name);
    let deep = path.components().count();
    (deep > 0 && deep < 8 && path.components().all(fine) && !name.contains('\0'))
        .then(|| root.join(path))
}
