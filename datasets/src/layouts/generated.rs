//! Datasets that `unsphere data generate` made with one folder for each object.
//!
//! `objects.json` lists the objects; `<category>/<name>/` has the views of one, in kaolin's layout
//! or with a `transforms.json`, and its mesh; `splits.json` says what they are for.

use std::path::{Path, PathBuf};

use crate::dataset::{Catalog, Dataset, Entry, Subset, Truth};
use crate::error::ReadViewsError;
use crate::formats::json::{Node, parse};
use crate::layouts::album::model;
use crate::layouts::single::SingleObject;
use crate::options::ReadOptions;
use crate::source::Source;
use crate::view::{Layout, Views};

const OBJECTS: &str = "objects.json";
const SPLITS: &str = "splits.json";
/// A million objects take less.
const MOST_BYTES: u64 = 1 << 30;
/// `unsphere data generate` makes no more of an object: what is claimed beyond is not counted to.
const MOST_VIEWS: usize = 10_000;

/// Objects of our own making.
#[derive(Clone, Debug)]
pub struct Generated {
    catalog: Catalog,
}

/// Whether the folder was written by `unsphere data generate`.
pub(crate) fn recognises(path: &Path) -> bool {
    path.join(OBJECTS).is_file() && path.join("dataset.toml").is_file()
}

impl Generated {
    /// Lists the objects; no view is read.
    ///
    /// # Errors
    /// If a list is damaged, names no object, or names one outside the folder or with more views than are made.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, ReadViewsError> {
        let path = path.as_ref();
        let source = Source::folder(path);
        let mut opened = source.open()?;
        let file = source.locate(OBJECTS);
        let objects = parse(&opened.read(OBJECTS, "objects", MOST_BYTES)?, &file)?;
        let splits_file = source.locate(SPLITS);
        let splits = if source.has(SPLITS) {
            Some(parse(&opened.read(SPLITS, "splits", MOST_BYTES)?, &splits_file)?)
        } else {
            None
        };
        let splits = splits.as_ref().map(|value| Node::root(value, &splits_file));
        let mut entries = Vec::new();
        for object in Node::root(&objects, &file).elements()? {
            let [category, name] =
                [folder_name(&object, "category")?, folder_name(&object, "name")?];
            let views = count(&object.need("views")?)?;
            let listed = |(subset, _): &(&str, Subset)| {
                splits.as_ref()?.get(subset)?.get(&category)?.get(&name)
            };
            let mut subsets = Subset::NAMES.into_iter();
            let subset = subsets.find(|subset| listed(subset).is_some()).map(|(_, subset)| subset);
            entries.push(Entry { category, name, views, subset });
        }
        let Some(first) = entries.first() else {
            return Err(ReadViewsError::field(file, "objects", "none", "at least one"));
        };
        let transforms = path.join(&first.category).join(&first.name).join("transforms.json");
        let layout = if transforms.is_file() { Layout::Transforms } else { Layout::KaolinFolder };
        Ok(Self { catalog: Catalog { entries, ..Catalog::new(layout, path) } })
    }

    fn folder(&self, object: usize) -> PathBuf {
        let Entry { category, name, .. } = &self.catalog.entries[object];
        self.catalog.root.join(category).join(name)
    }
}

/// How many views an object is said to have.
fn count(views: &Node<'_>) -> Result<usize, ReadViewsError> {
    let count = views.index()?;
    if (1..=MOST_VIEWS).contains(&count) {
        return Ok(count);
    }
    Err(views
        .wrong(format!("1 to {MOST_VIEWS}, of which each has its files in the object's folder")))
}

/// A field that names a folder, and nothing outside of the dataset.
fn folder_name(object: &Node<'_>, field: &str) -> Result<String, ReadViewsError> {
    let node = object.need(field)?;
    let name = node.text()?;
    if name.is_empty() || name == "." || name == ".." || name.contains(['/', '\\', '\0']) {
        return Err(node.wrong("the name of a folder"));
    }
    Ok(name.to_owned())
}

impl Dataset for Generated {
    fn catalog(&self) -> &Catalog {
        &self.catalog
    }

    fn views(
        &self,
        object: usize,
        which: Option<&[usize]>,
        options: &ReadOptions,
        progress: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<Views, ReadViewsError> {
        let folder = self.folder(object);
        let single = SingleObject::find(&folder, options)?.ok_or_else(|| {
            let wanted_by = format!("{OBJECTS} lists it; generate the dataset again");
            ReadViewsError::missing(&folder, wanted_by)
        })?;
        let views = single.views(0, which, options, progress)?;
        let (found, listed) = (single.entries()[0].views, self.catalog.entries[object].views);
        if which.is_none() && found < listed && !options.allow_missing {
            let found = format!("{found} of the {listed} that {OBJECTS} lists");
            let expected =
                "all: put the others back, generate the dataset again, or allow missing views";
            return Err(ReadViewsError::field(folder, "views", found, expected));
        }
        Ok(views)
    }

    fn truth(&self, object: usize) -> Result<Truth, ReadViewsError> {
        let folder = self.folder(object);
        let mesh = match model(&folder.join("mesh.ply"))? {
            Some(mesh) => Some(mesh),
            None => model(&folder.join("mesh.glb"))?,
        };
        Ok(Truth { mesh, ..Truth::default() })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::{View, write_transforms};
    use mesh_core::{ByteImage, Camera, primitives};

    #[test]
    fn objects_are_found_and_faults_are_named() {
        let place = tempfile::tempdir().unwrap();
        let root = place.path();
        let views: Vec<View> = (0..3)
            .map(|i| {
                let eye = [f64::from(i), 1.0, 4.0];
                let mut mask = ByteImage::new(16, 20, 1);
                mask.data[8 * 20 + 7..8 * 20 + 13].fill(255);
                View {
                    crop: None,
                    name: i.to_string(),
                    color: ByteImage::new(16, 20, 3),
                    mask,
                    camera: Camera::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 0.6, 20, 16),
                    depth: None,
                }
            })
            .collect();
        let object = root.join("lamp/0000");
        write_transforms(&views, &object).unwrap();
        let mesh = primitives::icosphere(1);
        mesh_core::write_mesh(object.join("mesh.ply"), &mesh).unwrap();
        assert!(!recognises(root));
        std::fs::write(root.join("dataset.toml"), "").unwrap();
        let list = |text: &str| std::fs::write(root.join(OBJECTS), text).unwrap();
        list(r#"[{"category": "lamp", "name": "0000", "views": 3}]"#);
        std::fs::write(root.join(SPLITS), r#"{"val": {"lamp": {"0000": [0, 1, 2]}}}"#).unwrap();
        assert!(recognises(root));
        let read = crate::open(root).unwrap();
        assert_eq!((read.layout(), read.entries().len()), (Layout::Transforms, 1));
        assert_eq!(read.entries()[0].subset, Some(Subset::Validation));
        let two = read.views(0, Some(&[2, 0]), &ReadOptions::default(), &|_, _| {}).unwrap();
        assert_eq!((two.len(), &two.views[1].mask), (2, &views[0].mask));
        assert_eq!(read.truth(0).unwrap().mesh.unwrap().positions, mesh.positions);

        let error = |text: &str| {
            list(text);
            Generated::open(root).unwrap_err().to_string()
        };
        assert!(error("[]").contains("objects"));
        assert!(error("[{\"category\": \"..\"}]").contains("category"));
        let outside = r#"[{"category": "lamp", "name": "a/b", "views": 3}]"#;
        assert!(error(outside).contains("name"));
        let claimed = r#"[{"category": "lamp", "name": "0000", "views": 900000000}]"#;
        assert!(error(claimed).contains("objects.json: field `[0].views`: found 900000000"));
        list(r#"[{"category": "lamp", "name": "0001", "views": 3}]"#);
        let gone = Generated::open(root).unwrap();
        let error = gone.views(0, None, &ReadOptions::default(), &|_, _| {}).unwrap_err();
        assert!(error.to_string().contains("0001"), "{error}");
    }

    #[test]
    fn a_view_that_was_lost_is_an_error_of_its_object() {
        let place = tempfile::tempdir().unwrap();
        let root = place.path();
        let camera = Camera::look_at([0.0, 1.0, 4.0], [0.0; 3], [0.0, 1.0, 0.0], 0.6, 20, 16);
        let (color, mask) = (ByteImage::new(16, 20, 3), ByteImage::new(16, 20, 1));
        let view = View { name: String::new(), color, mask, camera, depth: None, crop: None };
        crate::write_kaolin(&[view.clone(), view], &root.join("lamp/0000")).unwrap();
        std::fs::write(root.join("dataset.toml"), "").unwrap();
        let list = r#"[{"category": "lamp", "name": "0000", "views": 3}]"#;
        std::fs::write(root.join(OBJECTS), list).unwrap();
        let options = ReadOptions { mask: crate::MaskSource::Whole, ..ReadOptions::default() };
        let read = |which: Option<&[usize]>, options: &ReadOptions| {
            Generated::open(root).unwrap().views(0, which, options, &|_, _| {})
        };
        assert_eq!(read(Some(&[1, 0]), &options).unwrap().len(), 2);
        let lenient = ReadOptions { allow_missing: true, ..options.clone() };
        assert_eq!(read(None, &lenient).unwrap().len(), 2);
        for (which, options, said) in [
            (Some(&[0, 2][..]), &options, "found 2, of which none is view 2"),
            (Some(&[2][..]), &lenient, "put back what is missing"),
            (None, &options, "found 2 of the 3 that objects.json lists"),
        ] {
            let error = read(which, options).unwrap_err().to_string();
            assert!(error.contains("0000") && error.contains(said), "{error}");
        }
    }
}
