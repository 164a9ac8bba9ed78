//! Tables and pages from results alone, without training.

use std::path::{Path, PathBuf};

use crate::error::ReproduceError;
use crate::output::write;
use crate::pages::Pages;
use crate::progress::Ended;
use crate::results::{FILE, Results};
use crate::run::Reproduced;
use crate::study::Study;

/// Writes a study's `table.md` and `report.html` into a folder, from the results at a path: a `results.json`, or the folder
/// that has one. Images are shown that are in `pictures` beside it; the committed file has none.
///
/// # Errors
/// If the file cannot be read or is of another study, or the folder cannot be written.
pub fn remake(study: &dyn Study, from: &Path, out: &Path) -> Result<Reproduced, ReproduceError> {
    let path: PathBuf = if from.is_dir() { from.join(FILE) } else { from.to_owned() };
    let results = Results::read(&path)?;
    if results.study != study.name() {
        let problem = format!("it is of {}, expected {}", results.study, study.name());
        return Err(ReproduceError::NoResults { path, problem });
    }
    let root = path.parent().unwrap_or_else(|| Path::new(""));
    let pages = Pages::of(study, &results, root);
    write(&pages, out)?;
    Ok(Reproduced::of(pages, Ended::Completed, 0.0))
}
