//! Many objects under one roof: what is there, and each object when it is asked for.

use std::fmt::Debug;
use std::path::{Path, PathBuf};

use mesh_core::{TriMesh, VoxelGrid};

use crate::error::ReadViewsError;
use crate::options::ReadOptions;
use crate::view::{Layout, Views};

/// Objects in a layout on disk. Opening one lists what is there; pixels and points are read when
/// they are asked for, from any thread.
///
/// Every layout is one implementation, and its own type offers what only it knows (boxes,
/// keypoints, rough poses). A folder with the views of a single object is a dataset of one.
pub trait Dataset: Debug + Send + Sync {
    /// What is there, as opening has found it.
    fn catalog(&self) -> &Catalog;

    /// How the files are laid out.
    fn layout(&self) -> Layout {
        self.catalog().layout
    }

    /// The folder or file that was opened.
    fn root(&self) -> &Path {
        &self.catalog().root
    }

    /// The objects, in the order of the layout; at least one.
    fn entries(&self) -> &[Entry] {
        &self.catalog().entries
    }

    /// What a user should know although it stopped nothing, one sentence each.
    fn warnings(&self) -> &[String] {
        &self.catalog().warnings
    }

    /// Reads views of one object: all, or those with the given indices, in the order given.
    ///
    /// `progress` is told how many views are done, of how many, from any thread.
    ///
    /// # Errors
    /// The first view, in the order of the layout, that cannot be read, whatever the number of
    /// threads; one that was counted and is gone is such a view too. Every error names the file and
    /// the field.
    ///
    /// # Panics
    /// If the object does not exist, or a view that its entry does not count.
    fn views(
        &self,
        object: usize,
        which: Option<&[usize]>,
        options: &ReadOptions,
        progress: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<Views, ReadViewsError>;

    /// What the layout knows of the object's true shape, in the world of its cameras.
    ///
    /// # Errors
    /// If a file that is there cannot be read; one that is not there leaves its field empty.
    ///
    /// # Panics
    /// If the object does not exist.
    fn truth(&self, object: usize) -> Result<Truth, ReadViewsError> {
        assert!(object < self.entries().len(), "truth: object {object} does not exist");
        Ok(Truth::default())
    }
}

/// What a [`Dataset`] knows before anything large is read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Catalog {
    /// How the files are laid out.
    pub layout: Layout,
    /// The folder or file that was opened.
    pub root: PathBuf,
    /// The objects, in the order of the layout.
    pub entries: Vec<Entry>,
    /// What a user should know although it stopped nothing, one sentence each.
    pub warnings: Vec<String>,
}

impl Catalog {
    /// Of no objects yet.
    pub fn new(layout: Layout, root: impl Into<PathBuf>) -> Self {
        Self { layout, root: root.into(), entries: Vec::new(), warnings: Vec::new() }
    }
}

/// One object of a [`Dataset`], before anything large is read.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Entry {
    /// What kind of thing it is, as the layout calls it (a synset, a class); empty if it does not.
    pub category: String,
    /// The object's name, unique within its category.
    pub name: String,
    /// How many views it has.
    pub views: usize,
    /// The subset it belongs to by the layout's own split.
    pub subset: Option<Subset>,
}

/// What objects are used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Subset {
    /// Seen in training.
    Train,
    /// Looked at to choose settings and checkpoints.
    Validation,
    /// Looked at once, for the figures that are reported.
    Test,
}

impl Subset {
    /// Every subset by the name that files of splits have for it.
    pub const NAMES: [(&'static str, Self); 3] =
        [("train", Self::Train), ("val", Self::Validation), ("test", Self::Test)];

    /// The name in files of splits: `train`, `val` or `test`.
    pub fn name(self) -> &'static str {
        Self::NAMES[self as usize].0
    }
}

impl Entry {
    /// Category and name of the object: entries whose names agree up to the last `/` are views of one.
    pub fn object(&self) -> [&str; 2] {
        let name = self.name.rsplit_once('/').map_or(self.name.as_str(), |(object, _)| object);
        [&self.category, name]
    }

    /// The same as `category/name`, or the name alone where there is no category.
    pub fn object_name(&self) -> String {
        match self.object() {
            ["", name] => name.to_owned(),
            [category, name] => format!("{category}/{name}"),
        }
    }

    /// `category/name`, or the name alone where there is no category.
    pub fn full_name(&self) -> String {
        match self.category.as_str() {
            "" => self.name.clone(),
            category => format!("{category}/{}", self.name),
        }
    }
}

/// What is known of an object's true shape, in the world of its cameras.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Truth {
    /// The surface.
    pub mesh: Option<TriMesh>,
    /// Points on the surface.
    pub points: Option<SurfacePoints>,
    /// The solid.
    pub voxels: Option<VoxelGrid>,
}

/// Points on a surface with their outward unit normals.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SurfacePoints {
    /// Where they are, `[P]`.
    pub positions: Vec<[f32; 3]>,
    /// Outward unit normals, `[P]`.
    pub normals: Vec<[f32; 3]>,
}
