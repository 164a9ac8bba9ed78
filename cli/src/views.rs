//! Views and datasets that the user names.

use std::path::Path;

use datasets::{ReadOptions, Views};
use models::predict::Predictor;
use train::{Configuration, Source};

use crate::console::Console;
use crate::failure::Failure;
use crate::progress::Progress;

/// Reads the views of one object.
pub(crate) fn read_views(
    console: Console,
    path: &Path,
    options: &ReadOptions,
) -> Result<Views, Failure> {
    let progress = Progress::new(console, "read");
    Ok(datasets::read_views(path, options, &|done, all| progress.set(done, all))?)
}

/// Opens what a system learns from or is scored on; without a path it makes its own.
pub(crate) fn open<S: Predictor>(
    console: Console,
    config: &Configuration<S::Config>,
    path: Option<&Path>,
    options: &ReadOptions,
) -> Result<S::Data, Failure> {
    let progress = Progress::new(console, "read");
    let (seed, progress) = (config.train.seed, &|done, all| progress.set(done, all));
    S::open(&config.system, &Source { path, options, seed, progress }).map_err(Failure::input)
}
