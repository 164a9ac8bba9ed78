//! Every fault of a dataset, not only the first.

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;
use serde::Serialize;

use crate::dataset::{Dataset, Entry};
use crate::error::{ReadViewsError, ViewsProblem};
use crate::options::{OnInconsistent, ReadOptions};

/// Something in a dataset that cannot be read or cannot be meant.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Fault {
    /// The object, `category/name`; empty where it is the dataset's.
    pub object: String,
    /// The view's index in the object, where it is a view's.
    pub view: Option<usize>,
    /// The file, where one is known.
    pub file: String,
    /// The field, where one is known.
    pub field: Option<String>,
    /// What is wrong, with file, field, found and expected.
    pub message: String,
}

/// What reading all of a dataset found.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Validation {
    /// How many objects there are.
    pub objects: usize,
    /// How many views were read without fault.
    pub views: usize,
    /// What is wrong, in the order of objects and views.
    pub faults: Vec<Fault>,
    /// What looks odd.
    pub warnings: Vec<Fault>,
}

impl Fault {
    /// The fault of a dataset that cannot even be opened.
    pub fn of_dataset(error: &ReadViewsError) -> Self {
        Self {
            file: error.path.display().to_string(),
            field: error.field_name().map(String::from),
            message: error.to_string(),
            ..Self::default()
        }
    }

    fn said(object: &str, message: &str) -> Self {
        Self { object: object.to_owned(), message: message.to_owned(), ..Self::default() }
    }
}

/// Reads every view and the truth of every object, and lists all that is wrong.
///
/// An object whose views can all be read together costs one reading; another is read view by
/// view. Missing files are faults unless `options` allow them. `progress` is told how many objects
/// are done, of how many, from any thread.
///
/// # Errors
/// If `options` ask for an object that does not exist.
pub fn validate(
    dataset: &dyn Dataset,
    options: &ReadOptions,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Validation, ReadViewsError> {
    let entries = dataset.entries();
    let chosen: Vec<usize> = match &options.object {
        Some(name) => vec![crate::open::choose(dataset.root(), entries, Some(name))?],
        None => (0..entries.len()).collect(),
    };
    let done = AtomicUsize::new(0);
    // One object at a time in each thread: their images do not pile up.
    let parts: Vec<Validation> = chosen
        .par_iter()
        .map(|&object| {
            let part = validate_object(dataset, object, &entries[object], options);
            progress(done.fetch_add(1, Ordering::Relaxed) + 1, chosen.len());
            part
        })
        .collect();
    let mut all = Validation { objects: chosen.len(), ..Validation::default() };
    all.warnings.extend(dataset.warnings().iter().map(|text| Fault::said("", text)));
    for part in parts {
        all.views += part.views;
        all.faults.extend(part.faults);
        all.warnings.extend(part.warnings);
    }
    Ok(all)
}

fn validate_object(
    dataset: &dyn Dataset,
    object: usize,
    entry: &Entry,
    options: &ReadOptions,
) -> Validation {
    let name = entry.full_name();
    let mut found = Validation::default();
    let fault = |error: &ReadViewsError, view: Option<usize>| Fault {
        object: name.clone(),
        view,
        ..Fault::of_dataset(error)
    };
    if let Err(error) = dataset.truth(object) {
        found.faults.push(fault(&error, None));
    }
    let read = |which: Option<&[usize]>, options: &ReadOptions| {
        dataset.views(object, which, options, &|_, _| {})
    };
    let whole = match read(None, options) {
        Ok(views) => {
            found.views = views.len();
            found.warnings.extend(views.warnings.iter().map(|text| Fault::said(&name, text)));
            return found;
        }
        Err(error) => error,
    };
    // What only all views together show is no fault of a file.
    if matches!(whole.problem, ViewsProblem::EmptyMasks { .. } | ViewsProblem::SeesNothing { .. }) {
        found.faults.push(fault(&whole, None));
        return found;
    }
    let lenient = ReadOptions {
        allow_missing: true,
        on_inconsistent: OnInconsistent::Accept,
        ..options.clone()
    };
    let strict = ReadOptions { allow_missing: options.allow_missing, ..lenient.clone() };
    for view in 0..entry.views {
        let error = match read(Some(&[view]), &lenient) {
            Ok(views) => {
                found.views += views.len();
                // What is missing elsewhere is said again with every view.
                let target =
                    if options.allow_missing { &mut found.warnings } else { &mut found.faults };
                for fault in views.warnings.iter().map(|text| Fault::said(&name, text)) {
                    if !target.contains(&fault) {
                        target.push(fault);
                    }
                }
                continue;
            }
            // Left out as missing: the strict reading says what is.
            Err(error) if error.field_name() == Some("views") => {
                read(Some(&[view]), &strict).err().unwrap_or(error)
            }
            Err(error) => error,
        };
        found.faults.push(fault(&error, Some(view)));
    }
    // The first fault may be of the object's list, which the lenient reading passes over.
    if found.faults.is_empty() {
        found.faults.push(fault(&whole, None));
    }
    found
}
