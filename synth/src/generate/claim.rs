//! Who works in the folder of a dataset: one process at the whole of it, or several at a share each.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use train::Shard;
use train::output::{Lock, LockError, disk, lock_folder, own_folder};

use super::error::GenerateError;

/// The folder, in the root of a dataset, of objects that are being written; a run that was killed
/// leaves it, and the next one removes it. On a file system without locks each run has its own, whose name goes on.
pub const UNFINISHED: &str = ".unfinished";
/// The same of a share, whose name goes on; it holds the share's lock.
const OF_SHARD: &str = ".unfinished-shard-";

/// How long another process may be at the files of the whole before this one gives up.
const PATIENCE: Duration = Duration::from_secs(60);

/// The whole of a dataset, or a share of it, for this process alone.
#[derive(Debug)]
pub(super) struct Claim {
    /// The folder of what is unfinished, this process's own.
    pub(super) unfinished: PathBuf,
    _lock: Lock,
}

impl Claim {
    /// Claims a share of a dataset whose folder is locked for this process. Where that is the whole of it nobody may be at
    /// a share.
    pub(super) fn new(root: &Path, folder: Lock, shard: Shard) -> Result<Self, GenerateError> {
        if !shard.is_whole() {
            return Self::of_shard(root, shard);
        }
        sweep_shards(root)?;
        let unfinished = unfinished(root, folder.is_held()).map_err(GenerateError::io(root))?;
        Ok(Self { unfinished, _lock: folder })
    }

    fn of_shard(root: &Path, shard: Shard) -> Result<Self, GenerateError> {
        let name = format!("{OF_SHARD}{}", shard.to_string().replace('/', "-of-"));
        let own = root.join(&name);
        disk::make_folders(&own).map_err(GenerateError::io(&own))?;
        let lock = lock_now(&own)?;
        if !lock.is_held() {
            let unfinished = own_folder(root, name.as_ref()).map_err(GenerateError::io(root))?;
            return Ok(Self { unfinished, _lock: lock });
        }
        for entry in fs::read_dir(&own).map_err(GenerateError::io(&own))?.flatten() {
            // What a killed process left; the lock is a file.
            let _ = fs::remove_dir_all(entry.path());
        }
        Ok(Self { unfinished: own, _lock: lock })
    }
}

/// Takes a folder for this process alone.
pub(super) fn lock_now(folder: &Path) -> Result<Lock, GenerateError> {
    lock_folder(folder).map_err(|error| match error {
        LockError::Busy(holder) => GenerateError::Busy { path: folder.to_owned(), holder },
        LockError::Io(source) => GenerateError::io(folder)(source),
    })
}

/// The same, after others who have it for moments.
pub(super) fn lock_soon(folder: &Path) -> Result<Lock, GenerateError> {
    let begun = Instant::now();
    loop {
        match lock_now(folder) {
            Err(GenerateError::Busy { .. }) if begun.elapsed() < PATIENCE => {
                std::thread::sleep(Duration::from_millis(50));
            }
            other => return other,
        }
    }
}

/// Removes what killed processes left of shares.
fn sweep_shards(root: &Path) -> Result<(), GenerateError> {
    for entry in fs::read_dir(root).map_err(GenerateError::io(root))?.flatten() {
        let is_share = entry.file_name().to_str().is_some_and(|name| name.starts_with(OF_SHARD));
        if is_share && lock_now(&entry.path())?.is_held() {
            let _ = fs::remove_dir_all(entry.path());
        }
    }
    Ok(())
}

/// The folder of what is unfinished. Of a dataset that is locked for this process, what lies there is nobody's.
fn unfinished(root: &Path, locked: bool) -> std::io::Result<PathBuf> {
    if !locked {
        return own_folder(root, UNFINISHED.as_ref());
    }
    let folder = root.join(UNFINISHED);
    let _ = fs::remove_dir_all(&folder);
    Ok(folder)
}

#[cfg(test)]
mod tests {
    use train::output::is_incidental;

    use super::*;

    #[test]
    fn only_who_holds_the_lock_removes_what_others_left() {
        let place = tempfile::tempdir().expect("a folder");
        let left = place.path().join(UNFINISHED).join("table-0001");
        fs::create_dir_all(&left).expect("a folder");
        let own = unfinished(place.path(), false).expect("a folder of its own");
        let other = unfinished(place.path(), false).expect("another");
        assert!(left.is_dir() && own.is_dir() && other.is_dir() && own != other);
        let names = [&own, &other].map(|folder| folder.file_name().expect("it has a name"));
        assert!(names.iter().all(|name| is_incidental(name)), "{names:?}");
        assert_eq!(
            unfinished(place.path(), true).expect("the place"),
            place.path().join(UNFINISHED)
        );
        assert!(!left.exists() && own.is_dir());
    }

    #[test]
    fn a_share_is_claimed_once_and_the_whole_by_nobody_else() {
        let place = tempfile::tempdir().expect("a folder");
        let root = place.path();
        let [first, second] = [Shard::new(1, 2), Shard::new(2, 2)].map(|s| s.expect("a share"));
        let claim = |shard| Claim::new(root, lock_soon(root)?, shard);
        let (one, two) = (claim(first).expect("free"), claim(second).expect("free"));
        assert!(one.unfinished != two.unfinished);
        for shard in [first, Shard::WHOLE] {
            let busy = claim(shard).expect_err("taken").to_string();
            assert!(busy.contains(&format!("process {}", std::process::id())), "{busy}");
        }
        // A killed one leaves what it was at; the next at this share, or at the whole, removes it.
        let left = one.unfinished.join("table-0001");
        fs::create_dir_all(&left).expect("a folder");
        drop((one, two));
        let again = claim(first).expect("free again");
        assert!(!left.exists() && again.unfinished.is_dir());
        fs::create_dir_all(&left).expect("a folder");
        drop(again);
        drop(claim(Shard::WHOLE).expect("free again"));
        assert!(!left.exists());
    }
}
