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
    /// If a list is damaged, names no object, or names one outside the folder.
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
            let views = object.need("views")?.pixels()?;
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
        single.views(0, which, options, progress)
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
        list(r#"[{"category": "lamp", "name": "0001", "views": 3}]"#);
        let gone = Generated::open(root).unwrap();
        let error = gone.views(0, None, &ReadOptions::default(), &|_, _| {}).unwrap_err();
        assert!(error.to_string().contains("0001"), "{error}");
    }
}
