//! Finding the objects below whatever folder the user has pointed at.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::{RENDERING, RENDERINGS, metadata};
use crate::error::ReadViewsError;
use crate::source::names_of;
use crate::unknown_layout;

/// What there is below a folder.
pub(super) struct Found {
    /// Where the folders of voxels, meshes and splits are, if the objects stand below one.
    pub(super) root: Option<PathBuf>,
    /// In the order of their categories and names.
    pub(super) objects: Vec<Object>,
}

pub(super) struct Object {
    pub(super) category: String,
    pub(super) name: String,
    pub(super) folder: PathBuf,
}

impl Found {
    /// The categories that have a name, and their folders.
    pub(super) fn categories(&self) -> BTreeMap<String, PathBuf> {
        let of = |o: &Object| Some((o.category.clone(), o.folder.parent()?.to_owned()));
        self.objects.iter().filter(|o| !o.category.is_empty()).filter_map(of).collect()
    }
}

/// Whether there are renderings in or below the folder: an object, a category, or a root.
pub(crate) fn recognises(path: &Path) -> bool {
    // One object of each level is enough; nothing is listed as a whole.
    let first_child = |folder: &Path, wanted: &dyn Fn(&Path) -> bool| {
        std::fs::read_dir(folder)
            .is_ok_and(|entries| entries.flatten().any(|entry| wanted(&entry.path())))
    };
    let category = |folder: &Path| first_child(folder, &is_object);
    path.join(metadata::FILE).is_file()
        || is_object(path)
        || category(path)
        || [path.to_owned(), path.join(RENDERINGS)].iter().any(|f| first_child(f, &category))
}

fn is_object(folder: &Path) -> bool {
    folder.join(RENDERING).join(metadata::FILE).is_file()
}

/// All objects in or below the folder.
pub(super) fn objects(path: &Path) -> Result<Found, ReadViewsError> {
    // `.` has no name, and no parents.
    let folder = std::fs::canonicalize(path).map_err(|e| ReadViewsError::new(path, e))?;
    let name = |folder: &Path| {
        folder.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
    };
    // The folder of the images stands for its object.
    let folder = match folder.parent() {
        Some(object) if folder.join(metadata::FILE).is_file() && is_object(object) => {
            object.to_owned()
        }
        _ => folder,
    };
    if is_object(&folder) {
        let category = folder.parent().map(name).filter(|n| is_synset(n)).unwrap_or_default();
        let root = folder.parent().and_then(Path::parent).and_then(root_above);
        let object = Object { category, name: name(&folder), folder };
        return Ok(Found { root, objects: vec![object] });
    }
    let in_category = |category: &Path| -> Result<Vec<Object>, ReadViewsError> {
        Ok(folders_in(category)?
            .into_iter()
            .filter(|folder| is_object(folder))
            .map(|folder| Object { category: name(category), name: name(&folder), folder })
            .collect())
    };
    let objects = in_category(&folder)?;
    if !objects.is_empty() {
        let root = folder.parent().and_then(root_above);
        return Ok(Found { root, objects });
    }
    let inner = folder.join(RENDERINGS);
    let renderings = if inner.is_dir() { inner } else { folder };
    let mut objects = Vec::new();
    for category in folders_in(&renderings)? {
        objects.extend(in_category(&category)?);
    }
    if objects.is_empty() {
        let found = format!("no folder below it holds {RENDERING}/{}", metadata::FILE);
        return Err(unknown_layout::looked_for(path, found));
    }
    // Without the usual name, categories stand in the root itself.
    let root = root_above(&renderings).unwrap_or(renderings);
    Ok(Found { root: Some(root), objects })
}

/// The root, if this is the folder of all renderings.
fn root_above(renderings: &Path) -> Option<PathBuf> {
    let named = renderings.file_name().is_some_and(|n| n == RENDERINGS);
    if named { renderings.parent().map(Path::to_owned) } else { None }
}

/// WordNet's offsets, as ShapeNet names its categories.
fn is_synset(name: &str) -> bool {
    name.len() == 8 && name.bytes().all(|b| b.is_ascii_digit())
}

/// The folders in a folder, sorted by name. Names that are not text belong to no object.
fn folders_in(folder: &Path) -> Result<Vec<PathBuf>, ReadViewsError> {
    let names = names_of(folder).map_err(|e| ReadViewsError::new(folder, e))?;
    Ok(names.into_iter().map(|name| folder.join(name)).filter(|path| path.is_dir()).collect())
}
