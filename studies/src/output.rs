//! The files of a study that people read.

use std::path::Path;

use train::output::write_within;

use crate::error::ReproduceError;
use crate::markdown::markdown;
use crate::page::page;
use crate::pages::Pages;
use crate::results::FILE;
use crate::store::io;

/// Writes `table.md` and `report.html` into a folder.
pub(crate) fn write(pages: &Pages<'_>, folder: &Path) -> Result<(), ReproduceError> {
    write_within(folder, "table.md", markdown(pages).as_bytes()).map_err(io)?;
    write_within(folder, "report.html", page(pages).as_bytes()).map_err(io)
}

/// And the results that they are made of.
pub(crate) fn write_all(pages: &Pages<'_>, folder: &Path) -> Result<(), ReproduceError> {
    write(pages, folder)?;
    write_within(folder, FILE, pages.results.to_json().as_bytes()).map_err(io)
}
