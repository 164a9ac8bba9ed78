//! Results that several processes made, put into one folder.

#[cfg(test)]
mod tests;

use std::fs;
use std::path::{Path, PathBuf};

use crate::error::ReproduceError;
use crate::order::Order;
use crate::output::write_all;
use crate::pages::Pages;
use crate::progress::Ended;
use crate::results::Results;
use crate::run::{Reproduced, identity, same_build};
use crate::store::{Kept, Store, changed, io, kept_in, read, result};
use crate::study::Study;

/// A result, and the folder that it is in.
type Found<'a> = (&'a Path, Kept);

/// Puts the finished jobs of several folders into another, and writes the tables of all of them there. `order` says of what
/// scale and data they are; nothing is trained, and the trainings stay where they are.
///
/// # Errors
/// If a folder's results are of other settings, another scale or other data than this program makes, of another version or commit
/// than the first, or two folders have different results of one job and seed. The error names the file and what differs; nothing
/// is written then.
pub fn merge(
    study: &dyn Study,
    folders: &[PathBuf],
    out: &Path,
    order: &Order<'_>,
) -> Result<Reproduced, ReproduceError> {
    let plan = study.plan(order.scale);
    let identity = identity(study, &plan.settings, order);
    let mut all: Vec<Found<'_>> = Vec::new();
    // What is merged already counts like the others.
    let merged = out.join("study.txt").exists() && !order.force;
    for folder in merged.then_some(out).into_iter().chain(folders.iter().map(PathBuf::as_path)) {
        match read(folder.join("study.txt"))? {
            Some(text) if text == identity => {}
            Some(text) => return Err(unlike(folder, out, &text, &identity)),
            None => return Err(ReproduceError::Taken { path: folder.to_owned() }),
        }
        for kept in kept_in(folder, plan.ids())? {
            add(&mut all, (folder, kept))?;
        }
    }
    let place = |(_, kept): &Found<'_>| (plan.ids().position(|id| id == kept.job), kept.seed);
    all.sort_by_key(place);
    let store = Store::open(out, &identity, order.force)?;
    for (folder, kept) in all.iter().filter(|(folder, _)| *folder != out) {
        copy(folder, kept, &store)?;
    }
    let kept = store.kept(plan.ids())?;
    let claims = study.claims();
    let left = plan.jobs.iter().map(|job| {
        let is_there = |seed: u64| kept.iter().any(|k| k.job == job.id && k.seed == seed);
        let seeds = order.seeds.of(order.scale, job.is_claimed(&claims));
        seeds.into_iter().filter(|&seed| !is_there(seed)).count()
    });
    let left = left.sum();
    let results = Results::of(study.name(), &plan.settings, order, &kept, left);
    let pages = Pages::of(study, &results, store.root());
    write_all(&pages, store.root())?;
    Ok(Reproduced::of(pages, Ended::Completed, 0.0))
}

/// Of what is merged already `--force` can drop the results, of a share nobody's option does.
fn unlike(folder: &Path, out: &Path, found: &str, expected: &str) -> ReproduceError {
    match changed(folder, found, expected) {
        ReproduceError::Changed { path, found, expected } if folder != out => {
            ReproduceError::OtherShare { path, found, expected }
        }
        error => error,
    }
}

/// With one more, which must be of the same build, and the same bytes where it is there already.
fn add<'a>(all: &mut Vec<Found<'a>>, (folder, kept): Found<'a>) -> Result<(), ReproduceError> {
    let path = |folder: &Path| folder.join(result(&kept.job, kept.seed));
    if let Some((_, first)) = all.first() {
        same_build(&path(folder), &kept, [&first.version, &first.commit])?;
    }
    let same = |other: &&Found<'_>| other.1.job == kept.job && other.1.seed == kept.seed;
    if let Some((other, _)) = all.iter().find(same) {
        let (first, second) = (path(other), path(folder));
        if read(first.clone())? != read(second.clone())? {
            return Err(ReproduceError::Twice { first, second });
        }
        return Ok(());
    }
    all.push((folder, kept));
    Ok(())
}

/// A result with its images, these first.
fn copy(folder: &Path, kept: &Kept, store: &Store) -> Result<(), ReproduceError> {
    let pictures = kept.rows.iter().flat_map(|row| &row.pictures).map(|image| &image.file);
    for file in pictures.chain([&result(&kept.job, kept.seed)]) {
        let path = folder.join(file);
        let bytes = fs::read(&path).map_err(|source| io((path, source)))?;
        store.write(file, &bytes)?;
    }
    Ok(())
}
