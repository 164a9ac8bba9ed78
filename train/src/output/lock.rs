//! Folders that one process at a time works in.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// The most that is told of a holder; a lock's file may hold anything.
const LONGEST: usize = 200;
/// How often a lock is tried whose file is removed at the same moment.
const ATTEMPTS: usize = 100;

/// A file that is locked as long as this lives, by the system: a killed process holds no lock.
#[derive(Debug)]
pub struct Lock {
    path: PathBuf,
    file: File,
    /// Not where the file system knows no locks.
    held: bool,
    /// Whether the file was not there before.
    made: bool,
}

/// Why there is no lock.
#[derive(Debug)]
pub enum LockError {
    /// Another has it: who, in words.
    Busy(String),
    /// The file cannot be had.
    Io(io::Error),
}

impl Lock {
    /// Takes a lock, and notes in its file who has it. On a file system without locks the answer is a lock that is not
    /// [held](Self::is_held).
    pub(crate) fn take(path: &Path) -> Result<Self, LockError> {
        for _ in 0..ATTEMPTS {
            let (file, made) = open(path).map_err(LockError::Io)?;
            let mut lock = Self { path: path.to_owned(), file, held: false, made };
            match try_lock(&lock.file) {
                Ok(()) => lock.held = true,
                Err(TryLockError::WouldBlock) => {
                    // Its holder removes it.
                    lock.made = false;
                    return Err(LockError::Busy(lock.holder()));
                }
                Err(TryLockError::Error(_)) => return Ok(lock),
            }
            // Its last holder may have removed the file between the two lines above.
            if lock.is_at_its_path() {
                // Who has it is for people; the lock is the system's.
                let _ = lock.sign();
                return Ok(lock);
            }
            (lock.held, lock.made) = (false, false);
        }
        Err(LockError::Busy("others".into()))
    }

    /// Whether no other process can have it: what lies around in the folder is nobody's. Where it is false, on a file
    /// system without locks, others may be at work beside this process, and only what it made itself is its own.
    pub fn is_held(&self) -> bool {
        self.held
    }

    fn sign(&mut self) -> io::Result<()> {
        self.file.set_len(0)?;
        self.file.rewind()?;
        let since = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |t| t.as_secs());
        let (id, host, since) = (std::process::id(), host(), utc(since));
        self.file.write_all(format!("process {id} on {host} since {since}\n").as_bytes())
    }

    /// What the holder noted.
    fn holder(&mut self) -> String {
        let mut bytes = Vec::new();
        let _ = (&mut self.file).take(LONGEST as u64).read_to_end(&mut bytes);
        let text = String::from_utf8_lossy(&bytes);
        let line: String =
            text.lines().next().unwrap_or("").chars().filter(|c| !c.is_control()).collect();
        if line.is_empty() { "another process".into() } else { line }
    }

    #[cfg(unix)]
    fn is_at_its_path(&self) -> bool {
        use std::os::unix::fs::MetadataExt;
        let same =
            |a: &std::fs::Metadata, b: &std::fs::Metadata| (a.dev(), a.ino()) == (b.dev(), b.ino());
        match (self.file.metadata(), std::fs::metadata(&self.path)) {
            (Ok(own), Ok(there)) => same(&own, &there),
            _ => false,
        }
    }

    /// Taken to be so elsewhere, where std tells two files of one name apart in no stable way. Should the system give the
    /// name of an open file that was removed away at once, as some versions of Windows do, then two processes that start in
    /// the very moment in which a third ends could both have the lock. (On Windows, too, nobody can read what the holder
    /// of a lock noted: it is called "another process".)
    #[cfg(not(unix))]
    fn is_at_its_path(&self) -> bool {
        true
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // As long as it is held, it is ours to remove; and where nobody can hold it, if we made it. What resists is taken
        // over by the next.
        if (self.held || self.made) && self.is_at_its_path() {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

/// Opens a lock's file, and whether it was not there before.
fn open(path: &Path) -> io::Result<(File, bool)> {
    let mut options = OpenOptions::new();
    options.read(true).write(true);
    match options.clone().create_new(true).open(path) {
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
            // It may go at this moment.
            Ok((options.create(true).truncate(false).open(path)?, false))
        }
        file => Ok((file?, true)),
    }
}

fn try_lock(file: &File) -> Result<(), TryLockError> {
    #[cfg(test)]
    if tests::LOCKLESS.get() {
        return Err(TryLockError::Error(io::ErrorKind::Unsupported.into()));
    }
    file.try_lock()
}

/// The name of this machine, where the system tells it in a file.
fn host() -> String {
    ["/proc/sys/kernel/hostname", "/etc/hostname"]
        .iter()
        .find_map(|path| std::fs::read_to_string(path).ok())
        .map(|name| name.trim().to_owned())
        .filter(|name| !name.is_empty())
        .unwrap_or_else(|| "this machine".into())
}

/// Seconds since 1970 as a date and a time.
fn utc(seconds: u64) -> String {
    let (mut days, rest) = (seconds / 86_400, seconds % 86_400);
    let leap = |year: u64| {
        year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400))
    };
    let mut year = 1970;
    while days >= 365 + u64::from(leap(year)) {
        days -= 365 + u64::from(leap(year));
        year += 1;
    }
    let february = 28 + u64::from(leap(year));
    let mut month = 0;
    for length in [31, february, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31] {
        month += 1;
        if days < length {
            break;
        }
        days -= length;
    }
    let (hour, minute, second) = (rest / 3600, rest / 60 % 60, rest % 60);
    format!("{year}-{month:02}-{:02} {hour:02}:{minute:02}:{second:02} UTC", days + 1)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
pub(crate) mod tests {
    use std::cell::Cell;

    use super::*;

    thread_local! {
        /// Whether this thread's file system knows no locks.
        pub(crate) static LOCKLESS: Cell<bool> = const { Cell::new(false) };
    }

    #[test]
    fn without_locks_nobody_is_kept_out_and_nothing_is_left() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join(".lock");
        LOCKLESS.set(true);
        let [first, second] = [(); 2].map(|()| Lock::take(&path).unwrap());
        assert!(!first.is_held() && !second.is_held());
        drop(second);
        assert!(path.exists());
        drop(first);
        assert!(!path.exists());
        // What others made is theirs.
        std::fs::write(&path, "").unwrap();
        drop(Lock::take(&path).unwrap());
        assert!(path.exists());
    }

    #[test]
    fn one_at_a_time_and_nothing_is_left() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join(".lock");
        let lock = Lock::take(&path).unwrap();
        assert!(lock.is_held());
        let Err(LockError::Busy(holder)) = Lock::take(&path) else { panic!("two have it") };
        let expected = format!("process {} on ", std::process::id());
        assert!(holder.starts_with(&expected) && holder.ends_with(" UTC"), "{holder}");
        drop(lock);
        assert!(!path.exists());
        // The file of a killed process is taken over.
        std::fs::write(&path, "process 1 on mars since \u{1b}[2J").unwrap();
        drop(Lock::take(&path).unwrap());
        assert!(!path.exists());
        let missing = Lock::take(&place.path().join("none/.lock"));
        assert!(matches!(missing, Err(LockError::Io(_))));
    }

    /// Each thread finds the number that the one before it left: no two were inside at once.
    #[test]
    fn a_lock_that_comes_and_goes_is_never_held_twice() {
        let place = tempfile::tempdir().unwrap();
        let (path, count) = (place.path().join(".lock"), place.path().join("count"));
        std::fs::write(&count, "0").unwrap();
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..50 {
                        let lock = loop {
                            if let Ok(lock) = Lock::take(&path) {
                                break lock;
                            }
                            std::thread::yield_now();
                        };
                        let now: u32 = std::fs::read_to_string(&count).unwrap().parse().unwrap();
                        std::fs::write(&count, (now + 1).to_string()).unwrap();
                        drop(lock);
                    }
                });
            }
        });
        assert_eq!(std::fs::read_to_string(&count).unwrap(), "200");
    }

    #[test]
    fn dates() {
        assert_eq!(utc(0), "1970-01-01 00:00:00 UTC");
        // 2000 was a leap year, 2100 is none; checked with `date -u -d`.
        assert_eq!(utc(951_782_400), "2000-02-29 00:00:00 UTC");
        assert_eq!(utc(1_795_392_307), "2026-11-23 00:05:07 UTC");
        assert_eq!(utc(4_107_542_400), "2100-03-01 00:00:00 UTC");
    }
}
