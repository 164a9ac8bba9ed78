//! The folder of a study: finished jobs, one file each.
//!
//! | file | what it holds |
//! |---|---|
//! | `study.txt` | study, scale, data and settings that all results are of |
//! | `results/<job>-seed-<k>.json` | the rows of a finished job |
//! | `pictures/` | what the rows show |
//! | `work/<job>-seed-<k>/` | the job's own folder: its training |
//! | `table.md`, `report.html`, `results.json` | what came of it all so far |

use std::fs;
use std::path::{Path, PathBuf};

use mesh_core::encode_png;
use serde::{Deserialize, Serialize};
use train::output::{
    Lock, LockError, disk, is_incidental, lock_folder, present, remove_within, sweep, write_within,
};
use train::{Provenance, RunFolder};

use super::curves::{Curve, curves};
use super::error::ReproduceError;
use super::row::{CaptionedImage, Cell, ImageKind, Row};

/// Everything in a study's folder, for those who overwrite one.
const ENTRIES: &[&str] =
    &["study.txt", "results", "pictures", "work", "table.md", "report.html", "results.json"];

/// The folder of a study, for this process alone.
#[derive(Debug)]
pub(super) struct Store {
    root: PathBuf,
    _lock: Lock,
}

/// A finished job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Kept {
    pub(super) job: String,
    pub(super) seed: u64,
    pub(super) rows: Vec<KeptRow>,
    /// What the job took: in its last part, or by what its rows say, if that is more.
    pub(super) seconds: f64,
    /// What its training took of that.
    #[serde(default)]
    pub(super) training: f64,
    /// How its training went.
    #[serde(default)]
    pub(super) curves: Vec<Curve>,
    pub(super) version: String,
    pub(super) commit: String,
    pub(super) cpu: String,
    pub(super) machine: String,
    pub(super) threads: usize,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct KeptRow {
    pub(super) table: String,
    pub(super) label: String,
    pub(super) cells: Vec<Cell>,
    pub(super) seconds: f64,
    pub(super) pictures: Vec<KeptImage>,
}

/// An image in the folder.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct KeptImage {
    /// The caption.
    pub caption: String,
    /// The file, below the study's folder.
    pub file: String,
    /// What it is of.
    #[serde(default)]
    pub kind: ImageKind,
}

/// Whether something stands at one of the names that a study writes.
fn taken(path: &Path) -> bool {
    ENTRIES.iter().any(|name| path.join(name).exists())
}

impl Store {
    /// Opens a folder for results of what `identity` says, or makes it.
    pub(super) fn open(path: &Path, identity: &str, force: bool) -> Result<Self, ReproduceError> {
        let store = Self { root: path.to_owned(), _lock: locked(path)? };
        let note = path.join("study.txt");
        match read(note)? {
            Some(text) if text == identity => return Ok(store),
            Some(_) if force => store.clear()?,
            Some(text) => return Err(changed(path, &text, identity)),
            // What stands there is not ours to remove, whatever it is called.
            None if path.exists() && !is_empty(path)? && (!force || taken(path)) => {
                return Err(ReproduceError::Taken { path: path.to_owned() });
            }
            None => {}
        }
        store.write("study.txt", identity.as_bytes())?;
        Ok(store)
    }

    /// Removes everything that a study wrote, and leaves other files alone.
    pub(super) fn clear(&self) -> Result<(), ReproduceError> {
        remove_within(&self.root, ENTRIES).map_err(io)
    }

    /// Where a job may keep what it needs to go on.
    pub(super) fn work(&self, job: &str, seed: u64) -> PathBuf {
        self.root.join("work").join(stem(job, seed))
    }

    /// The folder itself.
    pub(super) fn root(&self) -> &Path {
        &self.root
    }

    /// What is kept of some jobs, in their order and by ascending seed.
    pub(super) fn kept<'a>(
        &self,
        jobs: impl IntoIterator<Item = &'a str>,
    ) -> Result<Vec<Kept>, ReproduceError> {
        kept_in(&self.root, jobs)
    }

    /// Keeps the rows of a finished job. Its images come first, so that a result has them all.
    pub(super) fn keep(
        &self,
        (job, seed): (&str, u64),
        rows: Vec<Row>,
        seconds: f64,
        provenance: &Provenance,
    ) -> Result<Kept, ReproduceError> {
        let mut kept_rows = Vec::new();
        let mut count = 0;
        for row in rows {
            let mut pictures = Vec::new();
            for image in row.pictures {
                let file = format!("pictures/{}-{count}.png", stem(job, seed));
                count += 1;
                self.write(&file, &encode_png(&image.image))?;
                let CaptionedImage { caption, kind, .. } = image;
                pictures.push(KeptImage { caption, file, kind });
            }
            let Row { table, label, cells, seconds, .. } = row;
            kept_rows.push(KeptRow { table, label, cells, seconds, pictures });
        }
        let work = self.work(job, seed);
        // Rows of one job share its training.
        let said = kept_rows.iter().map(|row| row.seconds).fold(0.0, f64::max);
        let kept = Kept {
            job: job.to_owned(),
            seed,
            rows: kept_rows,
            seconds: seconds.max(said),
            training: RunFolder::at(&work).seconds().unwrap_or(0.0),
            curves: curves(&work),
            version: provenance.version.clone(),
            commit: provenance.commit.clone(),
            cpu: provenance.cpu.clone(),
            machine: provenance.machine.clone(),
            threads: rayon::current_num_threads(),
        };
        let text = serde_json::to_string_pretty(&kept).expect("plain figures serialise");
        self.write(&result(job, seed), (text + "\n").as_bytes())?;
        Ok(kept)
    }

    /// Writes a file, whole or not at all, with the folders above it.
    pub(super) fn write(&self, name: &str, bytes: &[u8]) -> Result<(), ReproduceError> {
        write_within(&self.root, name, bytes).map_err(io)
    }
}

/// What is kept in a folder of some jobs, in their order and by ascending seed.
pub(super) fn kept_in<'a>(
    root: &Path,
    jobs: impl IntoIterator<Item = &'a str>,
) -> Result<Vec<Kept>, ReproduceError> {
    let folder = root.join("results");
    let entries = present(fs::read_dir(&folder)).map_err(|source| io((folder.clone(), source)))?;
    let mut found: Vec<(String, u64)> = Vec::new();
    for entry in entries.into_iter().flatten() {
        let name = entry.map_err(|source| io((folder.clone(), source)))?.file_name();
        found.extend(name.to_str().and_then(named));
    }
    let mut all = Vec::new();
    for job in jobs {
        let mut seeds: Vec<u64> =
            found.iter().filter(|(name, _)| name == job).map(|(_, seed)| *seed).collect();
        seeds.sort_unstable();
        for seed in seeds {
            all.push(read_kept(&root.join(result(job, seed)))?);
        }
    }
    Ok(all)
}

fn read_kept(path: &Path) -> Result<Kept, ReproduceError> {
    let damaged = |problem| ReproduceError::Damaged { path: path.to_owned(), problem };
    let text = read(path.to_owned())?.ok_or_else(|| damaged("it is gone".to_owned()))?;
    serde_json::from_str(&text).map_err(|error| damaged(error.to_string()))
}

/// Job and seed of a result, by the name of its file.
fn named(name: &str) -> Option<(String, u64)> {
    let (job, seed) = name.strip_suffix(".json")?.rsplit_once("-seed-")?;
    Some((job.to_owned(), seed.parse().ok()?))
}

/// The text of a file; none where there is no such file.
pub(super) fn read(path: PathBuf) -> Result<Option<String>, ReproduceError> {
    present(fs::read_to_string(&path)).map_err(|source| io((path, source)))
}

/// What the file system refused, and where.
pub(super) fn io((path, source): (PathBuf, std::io::Error)) -> ReproduceError {
    ReproduceError::Io { path, source }
}

fn stem(job: &str, seed: u64) -> String {
    format!("{job}-seed-{seed}")
}

pub(super) fn result(job: &str, seed: u64) -> String {
    format!("results/{}.json", stem(job, seed))
}

fn is_empty(path: &Path) -> Result<bool, ReproduceError> {
    let entries = fs::read_dir(path);
    let entries = entries.map_err(|source| ReproduceError::Io { path: path.to_owned(), source })?;
    Ok(entries.flatten().all(|entry| is_incidental(&entry.file_name())))
}

/// A folder, made if there is none, without what killed processes left unfinished.
fn locked(path: &Path) -> Result<Lock, ReproduceError> {
    let failed = |source| ReproduceError::Io { path: path.to_owned(), source };
    disk::make_folders(path).map_err(failed)?;
    let lock = lock_folder(path).map_err(|error| match error {
        LockError::Busy(holder) => ReproduceError::Busy { path: path.to_owned(), holder },
        LockError::Io(source) => failed(source),
    })?;
    let within = ["results", "pictures"].map(|name| path.join(name));
    sweep(&lock, within.iter().map(PathBuf::as_path).chain([path]));
    Ok(lock)
}

/// The first line that is another.
pub(super) fn changed(path: &Path, found: &str, expected: &str) -> ReproduceError {
    let (mut was, mut is) = (found.lines(), expected.lines());
    loop {
        let lines = (was.next(), is.next());
        if lines.0 != lines.1 || lines.0.is_none() {
            let text = |line: Option<&str>| line.unwrap_or("nothing").to_owned();
            let (found, expected) = (text(lines.0), text(lines.1));
            return ReproduceError::Changed { path: path.to_owned(), found, expected };
        }
    }
}
