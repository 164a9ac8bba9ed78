//! Views and datasets that the user names.

use std::path::Path;

use datasets::{OnInconsistent, ReadOptions, ReadViewsError, Truth, Views, ViewsProblem};
use mesh_core::{UpAxis, counted};
use models::predict::Predictor;
use recon::delivery::apart_from;
use recon::fit::MARGIN;
use recon::inspect::inspect_views_with;
use train::{Configuration, Source};

use crate::args::{Reading, UpOrAuto};
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
        ViewsProblem::Field { ref field, .. } if names_views(options) && field == "views" => {
            named(path, options, error)
        }
        _ => error.into(),
    })
}

fn names_views(options: &ReadOptions) -> bool {
    options.only.is_some() || !options.except.is_empty()
}

/// How views are read where what is far from the object is not kept.
pub(crate) fn around_the_object(reading: &Reading) -> ReadOptions {
    ReadOptions { margin: Some(1.2 * f64::from(MARGIN)), ..reading.options() }
}

/// Adds views that are kept for scores, but for those with cameras that are worked on.
pub(crate) fn add_scored(
    console: Console,
    views: &mut Views,
    path: &Path,
    reading: &ReadOptions,
) -> Result<(), Failure> {
    let fitted = views.len();
    // Names are those of the views that are worked on.
    let others = read_views(
        console,
        path,
        &ReadOptions { only: None, except: Vec::new(), ..reading.clone() },
    )?;
    let all = others.len();
    let apart = apart_from(others.views, &views.views);
    let path = path.display();
    if apart.is_empty() {
        let text = format!(
            "{path}: the cameras of all its views are fitted: none is left to score on; without --score every fifth view \
             is held out"
        );
        return Err(Failure::Input(text));
    }
    let known = all - apart.len();
    views.views.extend(apart);
    views.warnings.extend(others.warnings);
    if known > 0 {
        let has = if known == 1 { "has a camera that is" } else { "have cameras that are" };
        let of = counted(all, "view");
        views
            .warnings
            .push(format!("{path}: {known} of {of} {has} fitted: left out of the scores"));
    }
    views.test = (fitted..views.len()).collect();
    Ok(())
}

/// The axis that is asked for, or what the cameras say.
pub(crate) fn up_axis(console: Console, asked: UpOrAuto, views: &Views) -> UpAxis {
    asked.unwrap_or_else(|| {
        let found = UpAxis::of_cameras(views.views.iter().map(|view| &view.camera));
        if found != UpAxis::Y {
            let text = "is up by the cameras: mesh.glb, the page and the turntable are turned so that they stand upright (--up)";
            console.remark(format_args!("{found} {text}"));
        }
        found
    })
}

/// What views there are, where one is not that a list names.
fn named(path: &Path, options: &ReadOptions, error: ReadViewsError) -> Failure {
    /// Names listed; more are not read.
    const MOST: usize = 12;
    let all =
        ReadOptions { only: None, except: Vec::new(), allow_missing: true, ..options.clone() };
    // What is wrong with all of them is no matter of the list.
    let Ok(views) = datasets::read_views(path, &all, &|_, _| ()) else { return error.into() };
    let names: Vec<&str> = views.views.iter().take(MOST).map(|view| view.name.as_str()).collect();
    let more = if views.len() > MOST { ", .." } else { "" };
    let option = match (&options.only, options.except.as_slice()) {
        (Some(_), []) => "--only",
        (None, _) => "--except",
        (Some(_), _) => "--only, --except",
    };
    Failure::Input(format!("{error} ({option}): there are {}{more}", names.join(", ")))
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
    if path.is_none() && *options != ReadOptions::default() {
        console.warn(
            "no folder is given: the objects that are made in its place are not read, and what is said of how views are \
             read (--mask, --fill-holes, ..) changes nothing",
        );
    }
    let progress = Progress::new(console, "read");
    let (seed, progress) = (config.train.seed, &|done, all| progress.set(done, all));
    S::open(&config.system, &Source { path, options, seed, progress }).map_err(Failure::input)
}
