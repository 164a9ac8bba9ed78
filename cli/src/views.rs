//! Views and datasets that the user names.

use std::path::Path;

use datasets::{OnInconsistent, ReadOptions, ReadViewsError, Truth, Views, ViewsProblem};
use models::predict::Predictor;
use recon::inspect::inspect_views_with;
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
    let read = datasets::read_views(path, options, &|done, all| progress.set(done, all));
    read.map_err(|error| match error.problem {
        ViewsProblem::SeesNothing { .. } => explained(path, options, error),
        ViewsProblem::Field { ref field, .. } if options.only.is_some() && field == "views" => {
            named(path, options, error)
        }
        _ => error.into(),
    })
}

/// What views there are, where one is not that a list names.
fn named(path: &Path, options: &ReadOptions, error: ReadViewsError) -> Failure {
    /// Names listed; more are not read.
    const MOST: usize = 12;
    let all = ReadOptions { only: None, allow_missing: true, ..options.clone() };
    // What is wrong with all of them is no matter of the list.
    let Ok(views) = datasets::read_views(path, &all, &|_, _| ()) else { return error.into() };
    let names: Vec<&str> = views.views.iter().take(MOST).map(|view| view.name.as_str()).collect();
    let more = if views.len() > MOST { ", .." } else { "" };
    Failure::Input(format!("{error} (--only): there are {}{more}", names.join(", ")))
}

/// Why cameras do not see what the masks show, if the views tell.
fn explained(path: &Path, options: &ReadOptions, error: ReadViewsError) -> Failure {
    let lenient = ReadOptions { on_inconsistent: OnInconsistent::Accept, ..options.clone() };
    let reasons =
        datasets::read_views(path, &lenient, &|_, _| ()).map(|views| diagnosis(&views, options));
    match reasons {
        Ok(reasons) if !reasons.is_empty() => {
            Failure::Input(format!("{error}; it seems that {}", reasons.join("; ")))
        }
        _ => error.into(),
    }
}

/// What looks wrong with cameras and masks that were read with options, a sentence each; about a second for a hundred views.
pub(crate) fn diagnosis(views: &Views, options: &ReadOptions) -> Vec<String> {
    diagnosis_beside(views, options, &[])
}

/// [`diagnosis`] without the problems of these names, of which something is said already.
pub(crate) fn diagnosis_beside(views: &Views, options: &ReadOptions, said: &[&str]) -> Vec<String> {
    // Beside what is held already, which is less.
    let whole = views.whole_within(options.memory_limit / 2);
    let found = inspect_views_with(&whole, &Truth::default(), options);
    let new = found.problems.into_iter().filter(|problem| !said.contains(&problem.kind));
    new.map(|problem| problem.message).collect()
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
