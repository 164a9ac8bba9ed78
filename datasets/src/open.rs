//! Opening whatever is there: every layout is recognised here.

use std::path::{Path, PathBuf};

use crate::dataset::{Dataset, Entry};
use crate::error::ReadViewsError;
use crate::layouts::bop::{self, Bop};
use crate::layouts::cub::Cub;
use crate::layouts::generated::{self, Generated};
use crate::layouts::mcmr::Mcmr;
use crate::layouts::pascal3d::Pascal3d;
use crate::layouts::pix3d::Pix3d;
use crate::layouts::pixel2mesh::{self, Pixel2Mesh};
use crate::layouts::r2n2::{self, R2n2};
use crate::layouts::single::SingleObject;
use crate::options::ReadOptions;
use crate::unknown_layout::unknown;
use crate::view::Views;

/// Opens a dataset of whatever layout is at the path; nothing large is read.
///
/// Folders, zips and files with the views of a single object are datasets of one.
///
/// # Errors
/// If no layout fits, with all that was looked for, or the files that list the objects are
/// damaged.
pub fn open(path: &Path) -> Result<Box<dyn Dataset>, ReadViewsError> {
    open_with(path, &ReadOptions::default())
}

/// The same for photographs without cameras, whose [`ReadOptions::turntable`] gives them some.
///
/// # Errors
/// As [`open`].
pub fn open_with(path: &Path, options: &ReadOptions) -> Result<Box<dyn Dataset>, ReadViewsError> {
    // Lists of photographs are JSON too, so they are asked before transforms.json is supposed. A
    // turntable is asked for by name; what else is there does not matter then.
    if options.turntable.is_none()
        && let Some((_, open)) = MANY.iter().find(|(recognises, _)| recognises(path))
    {
        return open(path);
    }
    match SingleObject::find(path, options)? {
        Some(single) => Ok(Box::new(single)),
        None => Err(several(path, options).unwrap_or_else(|| unknown(path))),
    }
}

/// Reads the views of one object from whatever is there: a folder, a zip archive, a JSON file.
///
/// The layout is recognised by what is there; the crate's documentation lists them all. In a
/// dataset of many objects [`ReadOptions::object`] says which one. `progress` is told how many
/// views are done, of how many, from any thread.
///
/// # Memory
/// Four bytes a pixel for all views, and a few decoded images while it reads.
/// # Errors
/// The first view, in the order of the layout, that cannot be read, whatever the number of
/// threads; then what no single view shows: masks empty in every view, cameras that look
/// elsewhere than at the object. Every error names the file and the field.
pub fn read_views(
    path: &Path,
    options: &ReadOptions,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Views, ReadViewsError> {
    let dataset = open_with(path, options)?;
    let object = choose(path, dataset.entries(), options.object.as_deref())?;
    dataset.views(object, None, options, progress)
}

/// A layout of many objects: whether it is at a path, and what opens it there.
type Many = (fn(&Path) -> bool, fn(&Path) -> Result<Box<dyn Dataset>, ReadViewsError>);

/// All of them, in the order in which they are asked.
const MANY: [Many; 8] = [
    (r2n2::recognises, |path| Ok(Box::new(R2n2::open(path)?))),
    (generated::recognises, |path| Ok(Box::new(Generated::open(path)?))),
    (pixel2mesh::recognises, |path| Ok(Box::new(Pixel2Mesh::open(path)?))),
    (Pix3d::recognises, |path| Ok(Box::new(Pix3d::open(path)?))),
    (Pascal3d::recognises, |path| Ok(Box::new(Pascal3d::open(path)?))),
    (Cub::recognises, |path| Ok(Box::new(Cub::open(path)?))),
    (Mcmr::recognises, |path| Ok(Box::new(Mcmr::open(path)?))),
    (bop::recognises, |path| Ok(Box::new(Bop::open(path)?))),
];

/// The index of the wanted object, by its name or `category/name`; a dataset of one may leave it
/// open. `path` is what was opened, for messages.
///
/// # Errors
/// If there is no such object, or several and none is wanted, or several have the name.
pub fn choose(
    path: &Path,
    entries: &[Entry],
    wanted: Option<&str>,
) -> Result<usize, ReadViewsError> {
    let some = |limit: usize| {
        let names: Vec<String> = entries.iter().take(limit).map(Entry::full_name).collect();
        let more = if entries.len() > limit { ", .." } else { "" };
        format!("{}{more}", names.join(", "))
    };
    let Some(wanted) = wanted else {
        if entries.len() == 1 {
            return Ok(0);
        }
        let found = format!("{} objects", entries.len());
        let expected = format!("the name of one of them: {}", some(8));
        return Err(ReadViewsError::field(path, "object", found, expected));
    };
    // A full name means one alone, also where it is the bare name of another.
    if let Some(object) = entries.iter().position(|entry| entry.full_name() == wanted) {
        return Ok(object);
    }
    let mut named = (0..entries.len()).filter(|&i| entries[i].name == wanted);
    let error = |found: String, expected: String| {
        Err(ReadViewsError::field(path, "object", found, expected))
    };
    let Some(first) = named.next() else {
        let expected = format!("one of the {}: {}", entries.len(), some(8));
        return error(format!("{wanted:?}"), expected);
    };
    let others: Vec<String> = named.take(8).map(|i| entries[i].full_name()).collect();
    if others.is_empty() {
        return Ok(first);
    }
    let found = format!("{wanted:?}, which several have");
    error(found, format!("one of {}, {}", entries[first].full_name(), others.join(", ")))
}

/// Folders that are looked into for views of their own.
const LOOKED_INTO: usize = 64;

/// The error that names folders, each with the views of one object, beside one another in the folder that was opened.
fn several(path: &Path, options: &ReadOptions) -> Option<ReadViewsError> {
    let names = crate::source::Source::folder(path).root_names().ok()?;
    let inner = names.iter().map(|name| path.join(name)).filter(|inner| inner.is_dir());
    let one = |inner: &PathBuf| matches!(SingleObject::find(inner, options), Ok(Some(_)));
    let found: Vec<PathBuf> = inner.take(LOOKED_INTO).filter(one).collect();
    let [first, _, ..] = found.as_slice() else { return None };
    let expected = format!(
        "one of them, as {}; a list of folders is for `unsphere fit --batch`",
        first.display()
    );
    let found = format!("{} folders, each with views of its own", found.len());
    Some(ReadViewsError::field(path, "folder", found, expected))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn folders_of_objects_beside_one_another_are_named() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["chair", "lamp", "notes"] {
            let inner = folder.path().join(name);
            std::fs::create_dir(&inner).unwrap();
            let file = if name == "notes" { "readme.txt" } else { "transforms.json" };
            std::fs::write(inner.join(file), r#"{"frames": []}"#).unwrap();
        }
        let error = open(folder.path()).unwrap_err().to_string();
        assert!(error.contains("2 folders, each with views of its own"), "{error}");
        assert!(error.contains("chair") && error.contains("--batch"), "{error}");
        std::fs::remove_dir_all(folder.path().join("lamp")).unwrap();
        let error = open(folder.path()).unwrap_err().to_string();
        assert!(error.contains("no known layout"), "{error}");
    }

    #[test]
    fn objects_are_chosen_by_name() {
        let entry = |category: &str, name: &str| Entry {
            category: category.into(),
            name: name.into(),
            ..Entry::default()
        };
        let entries = [entry("car", "a"), entry("car", "b"), entry("bus", "b")];
        let choose = |n: usize, wanted| choose("x".as_ref(), &entries[..n], wanted);
        assert_eq!(choose(1, None).unwrap(), 0);
        assert_eq!(choose(2, Some("b")).unwrap(), 1);
        let several = choose(3, Some("b")).unwrap_err().to_string();
        assert!(several.contains("car/b, bus/b"), "{several}");
        assert_eq!(choose(3, Some("bus/b")).unwrap(), 2);
        let error = choose(3, None).unwrap_err().to_string();
        assert!(error.contains("3 objects") && error.contains("car/a, car/b"), "{error}");
        assert_eq!(choose(3, Some("c")).unwrap_err().field_name(), Some("object"));
    }
}
