//! Reading views: finds the layout, decodes in parallel, checks that the whole makes sense.

use std::path::Path;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

use rayon::prelude::*;

use crate::consistency;
use crate::dataset::Dataset;
use crate::error::{ReadViewsError, ViewsProblem};
use crate::options::{MaskSource, ReadOptions};
use crate::pixel2mesh::{self, Pixel2Mesh};
use crate::r2n2::{self, R2n2};
use crate::source::{Opened, Source};
use crate::view::{Layout, View, Views};
use crate::{kaolin, photo, transforms};

/// One view that waits to be read by whichever thread comes first.
pub(crate) type Pending<'a> =
    Box<dyn Fn(&mut Opened<'_>) -> Result<View, ReadViewsError> + Send + Sync + 'a>;

/// What a layout found before any pixel is read.
pub(crate) struct Reading<'a> {
    pub(crate) layout: Layout,
    pub(crate) pending: Vec<Pending<'a>>,
    pub(crate) warnings: Vec<String>,
    /// The field that holds the poses, for messages.
    pub(crate) poses: &'static str,
}

/// Reads the views of one object from a folder, a zip archive or a `transforms.json`.
///
/// The layout is recognised by what is there: kaolin's synthetic views, in a folder or in a zip
/// as they are shipped, or NeRF's and nerfstudio's `transforms.json` (or the three files of a
/// split). `progress` is told how many views are done, of how many, from any thread.
///
/// # Memory
/// Four bytes a pixel for all views, and a few decoded pictures while it reads.
/// # Errors
/// The first view, in the order of the layout, that cannot be read, whatever the number of
/// threads; then what no single view shows: masks empty in every view, cameras that look
/// elsewhere than at the object. Every error names the file and the field.
pub fn read_views(
    path: &Path,
    options: &ReadOptions,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Views, ReadViewsError> {
    let many = if r2n2::recognises(path) {
        Some(Box::new(R2n2::open(path)?) as Box<dyn Dataset>)
    } else if pixel2mesh::recognises(path) {
        Some(Box::new(Pixel2Mesh::open(path)?) as Box<dyn Dataset>)
    } else {
        photo::find(path)?
    };
    if let Some(dataset) = many {
        return read_only_object(&*dataset, options, progress);
    }
    let (source, json) = locate(path)?;
    let names = source.root_names()?;
    let reading = match json {
        Some(name) => transforms::list(&source, &[name], options)?,
        None if kaolin::recognises(&names) => kaolin::list(&source, &names, options)?,
        None => {
            let files = transforms::files_among(&names);
            if files.is_empty() {
                return Err(unknown(path, &names));
            }
            transforms::list(&source, &files, options)?
        }
    };
    read_pending(path, &source, reading, options, progress)
}

/// The views of a dataset of one object.
fn read_only_object(
    dataset: &dyn Dataset,
    options: &ReadOptions,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Views, ReadViewsError> {
    let [_] = dataset.entries() else {
        let found = format!("{} objects", dataset.entries().len());
        let expected = "one: name its own folder or file";
        return Err(ReadViewsError::field(dataset.root(), "objects", found, expected));
    };
    dataset.views(0, None, options, progress)
}

/// Reads what a layout has listed, in parallel, and checks that the whole makes sense.
///
/// `path` is what the user named, for messages and for [`Views::source`].
pub(crate) fn read_pending(
    path: &Path,
    source: &Source,
    reading: Reading<'_>,
    options: &ReadOptions,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Views, ReadViewsError> {
    let Reading { layout, pending, mut warnings, poses } = reading;
    if pending.is_empty() {
        return Err(ReadViewsError::field(path, "views", "none that is complete", "at least one"));
    }
    let (total, done, bytes) = (pending.len(), AtomicUsize::new(0), AtomicU64::new(0));
    let results: Vec<Result<View, ReadViewsError>> = pending
        .par_iter()
        .map_init(
            || None,
            |opened: &mut Option<Opened<'_>>, read| {
                if opened.is_none() {
                    *opened = Some(source.open()?);
                }
                let opened = opened.as_mut().expect("opened above");
                // Once over the budget the rest is not even decoded.
                check_budget(path, options, bytes.load(Ordering::Relaxed))?;
                let view = read(opened)?;
                let held = view.bytes() as u64;
                check_budget(path, options, bytes.fetch_add(held, Ordering::Relaxed) + held)?;
                progress(done.fetch_add(1, Ordering::Relaxed) + 1, total);
                Ok(view)
            },
        )
        .collect();
    let views = results.into_iter().collect::<Result<Vec<_>, _>>()?;
    if options.mask != MaskSource::Whole {
        consistency::check(path, &views, poses, &mut warnings)?;
    }
    Ok(Views { views, source: path.to_owned(), layout, warnings })
}

fn check_budget(path: &Path, options: &ReadOptions, found: u64) -> Result<(), ReadViewsError> {
    if found <= options.memory_limit {
        return Ok(());
    }
    let field = "all views in memory (read them smaller with `max_size`)".to_owned();
    let problem = ViewsProblem::TooLarge { field, found, limit: options.memory_limit };
    Err(ReadViewsError::new(path, problem))
}

/// The source, and the name of the JSON file where the path is one.
fn locate(path: &Path) -> Result<(Source, Option<String>), ReadViewsError> {
    let metadata = std::fs::metadata(path).map_err(|e| ReadViewsError::new(path, e))?;
    if metadata.is_dir() {
        return Ok((inner_folder(path)?, None));
    }
    let has_extension = |wanted: &str| {
        path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(wanted))
    };
    if has_extension("json") {
        let name = path.file_name().and_then(|n| n.to_str()).unwrap_or_default().to_owned();
        let folder = match path.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        return Ok((Source::folder(folder), Some(name)));
    }
    let mut magic = [0u8; 4];
    let is_zip = std::fs::File::open(path)
        .and_then(|mut file| std::io::Read::read_exact(&mut file, &mut magic))
        .is_ok_and(|()| magic == *b"PK\x03\x04");
    if is_zip || has_extension("zip") {
        return Ok((Source::zip(path)?, None));
    }
    let found = "a file that is neither a zip archive nor .json".to_owned();
    Err(ReadViewsError::new(path, ViewsProblem::UnknownLayout { found }))
}

/// The folder, or the one folder in it where it holds nothing else: what unpacking a zip leaves.
fn inner_folder(path: &Path) -> Result<Source, ReadViewsError> {
    let source = Source::folder(path);
    let names = source.root_names()?;
    if let [only] = names.as_slice() {
        let inner = path.join(only);
        if inner.is_dir() {
            return Ok(Source::folder(&inner));
        }
    }
    Ok(source)
}

fn unknown(path: &Path, names: &[String]) -> ReadViewsError {
    let found = match names {
        [] => "nothing".to_owned(),
        [first] => first.clone(),
        [first, .., last] => format!("{} files from {first} to {last}", names.len()),
    };
    ReadViewsError::new(path, ViewsProblem::UnknownLayout { found })
}
