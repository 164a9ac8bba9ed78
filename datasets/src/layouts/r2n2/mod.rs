//! ShapeNet with 3D-R2N2's renderings, read and written.
//!
//! ```
//! use datasets::r2n2::{self, R2n2, Rendering};
//! use datasets::{Dataset, ReadOptions, Truth};
//! use mesh_core::{ByteImage, R2n2View, primitives};
//!
//! // A white square in the middle of each image, and a ball that is said to be it.
//! let mut rgba = ByteImage::new(64, 64, 4);
//! for k in 0..64 * 64 {
//!     if (16..48).contains(&(k / 64)) && (16..48).contains(&(k % 64)) {
//!         rgba.data[4 * k..4 * k + 4].fill(255);
//!     }
//! }
//! let rendering = |azimuth: f64| Rendering {
//!     rgba: rgba.clone(),
//!     camera: R2n2View { azimuth, elevation: 27.0, distance_ratio: 0.8 },
//!     depth: None,
//!     normals: None,
//! };
//! let views = [rendering(0.0), rendering(120.0), rendering(240.0)];
//! let truth = Truth { mesh: Some(primitives::icosphere(2)), ..Truth::default() };
//!
//! let root = tempfile::tempdir()?;
//! r2n2::write_object(root.path(), "02958343", "ball", &views, &truth)?;
//! let dataset = R2n2::open(root.path())?;
//! assert_eq!((dataset.entries()[0].name.as_str(), dataset.entries()[0].views), ("ball", 3));
//! let read = dataset.views(0, Some(&[2]), &ReadOptions::default(), &|_, _| {})?;
//! assert_eq!(read.views[0].name, "02");
//! assert_eq!(dataset.truth(0)?.mesh, truth.mesh);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Files
//!
//! Below a root, for every object `<synset>/<model>`, of which only the first is needed:
//!
//! | file | what |
//! |---|---|
//! | `ShapeNetRendering/../rendering/{00..23}.png` | RGBA, 137 x 137, alpha is the silhouette |
//! | `ShapeNetRendering/../rendering/renderings.txt` | the images' names, one a line; may be missing |
//! | `ShapeNetRendering/../rendering/rendering_metadata.txt` | per image azimuth, elevation, 0, distance ratio, field of view |
//! | `ShapeNetRendering/../rendering/NN_depth.exr`, `NN_normal.png` | ours: planar depth; normals in the camera's frame, `round(127.5 (n + 1))` |
//! | `ShapeNetRendering/../model_normal.xyz` | points and their normals, six numbers a line |
//! | `ShapeNetVox32/../model.binvox` | the solid |
//! | `ShapeNetCore.v1/../model.obj` | the surface; also `../models/model_normalized.obj`, also without the first folder, also beside `rendering` |
//! | `*splits*.json` or `{train,val,test}.lst` | the split, see [`Splits`] |
//!
//! The world is that of the models, +Y up, unscaled. The field of view in the metadata, 25, is
//! wrong: see [`R2n2Lens`]. Colours where alpha is 0 are not clean, so images are always put
//! over [`ReadOptions::background`](crate::ReadOptions).

mod find;
mod lens;
mod metadata;
mod points;
mod splits;
mod write;

use std::path::{Path, PathBuf};

use mesh_core::{ByteImage, io::binvox};
use rayon::prelude::*;

use crate::assemble::{assemble, read_image_file};
use crate::dataset::{Catalog, Dataset, Entry, Truth};
use crate::depth::{self, Unit};
use crate::error::{ReadViewsError, ViewsProblem};
use crate::layouts::album::model;
use crate::mask_file::MaskFile;
use crate::options::ReadOptions;
use crate::read::{Pending, Reading, read_pending};
use crate::source::Source;
use crate::view::{Layout, Views};
use metadata::{Line, Lines};

pub(crate) use find::recognises;
pub use lens::R2n2Lens;
pub use splits::{ObjectSplit, Splits, write_splits};
pub use write::{Rendering, is_complete, write_object};

/// The folder of the images, below that of the object.
const RENDERING: &str = "rendering";
/// The points with normals, below the folder of the object.
const POINTS: &str = "model_normal.xyz";
/// Where files stand below the root.
const RENDERINGS: &str = "ShapeNetRendering";
const VOXELS: &str = "ShapeNetVox32";
const MESHES: &str = "ShapeNetCore.v1";

/// Objects of ShapeNet as 3D-R2N2 rendered them, or ours in that layout.
#[derive(Clone, Debug)]
pub struct R2n2 {
    catalog: Catalog,
    /// Where the other folders are, where it is known.
    root: Option<PathBuf>,
    /// The folder of each object, beside its entry.
    folders: Vec<PathBuf>,
    splits: Splits,
    /// The views of each object that its subset has, where those are not all.
    listed: Vec<Option<Vec<usize>>>,
    lens: R2n2Lens,
}

impl R2n2 {
    /// Lists the objects under a root, its `ShapeNetRendering`, one category, or one object.
    ///
    /// Objects are in the order of their categories and names. Of each the metadata is read, no
    /// pixel.
    ///
    /// # Errors
    /// Where there is no such object, or the metadata or the split of one is not as it should be.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, ReadViewsError> {
        let path = path.as_ref();
        let found = find::objects(path)?;
        let lines: Vec<Result<Lines, ReadViewsError>> = found
            .objects
            .par_iter()
            .map(|object| Lines::read(&Source::folder(&object.folder.join(RENDERING))))
            .collect();
        let mut warnings = Vec::new();
        let splits = Splits::read(found.root.as_deref(), &found.categories(), &mut warnings)?;
        let (mut folders, mut entries, mut listed) = (Vec::new(), Vec::new(), Vec::new());
        for (object, lines) in found.objects.into_iter().zip(lines) {
            let views = lines?.0.len();
            let own = splits.views(&object.category, &object.name, views);
            let views = own.as_ref().map_or(views, Vec::len);
            listed.push(own);
            let subset = splits.subset(&object.category, &object.name);
            folders.push(object.folder);
            entries.push(Entry { category: object.category, name: object.name, views, subset });
        }
        let (path, lens) = (path.to_owned(), R2n2Lens::default());
        let catalog = Catalog { entries, warnings, ..Catalog::new(Layout::R2n2, &path) };
        Ok(Self { catalog, root: found.root, folders, splits, listed, lens })
    }

    /// The same objects through another lens.
    #[must_use]
    pub fn with_lens(self, lens: R2n2Lens) -> Self {
        Self { lens, ..self }
    }

    /// The split that stands beside the objects; empty where there is none.
    pub fn splits(&self) -> &Splits {
        &self.splits
    }

    /// The normals that we wrote beside a view, `[H, W, 3]`: `2 value / 255 - 1` in the camera's
    /// frame.
    ///
    /// # Errors
    /// If the file is there and cannot be read.
    /// # Panics
    /// If the object or the view does not exist.
    pub fn normals(&self, object: usize, view: usize) -> Result<Option<ByteImage>, ReadViewsError> {
        let source = Source::folder(&self.folders[object].join(RENDERING));
        let mut lines = Lines::read(&source)?.0;
        let line = lines.swap_remove(self.listed(object, lines.len())[view]);
        let name = format!("{}_normal.png", line.stem());
        if !source.has(&name) {
            return Ok(None);
        }
        let image = read_image_file(&mut source.open()?, &name, "normals")?;
        Ok(Some(image.pixels.to_rgb()))
    }

    /// Which of so many views are an object's: those that the split has for its subset, or all.
    fn listed(&self, object: usize, count: usize) -> Vec<usize> {
        match &self.listed[object] {
            Some(listed) => listed.iter().copied().filter(|&view| view < count).collect(),
            None => (0..count).collect(),
        }
    }

    /// The first of these files that is there.
    fn first_of(candidates: impl IntoIterator<Item = PathBuf>) -> Option<PathBuf> {
        candidates.into_iter().find(|path| path.is_file())
    }

    fn mesh_file(&self, object: usize) -> Option<PathBuf> {
        let Entry { category, name, .. } = &self.catalog.entries[object];
        let endings = ["model.obj", "models/model_normalized.obj"];
        let below = self.root.iter().flat_map(|root| {
            [MESHES, "ShapeNetCore.v2", ""].map(|f| root.join(f).join(category).join(name))
        });
        let folders = below.chain([self.folders[object].clone()]);
        Self::first_of(folders.flat_map(|f| endings.map(|ending| f.join(ending))))
    }

    fn voxel_file(&self, object: usize) -> Option<PathBuf> {
        let Entry { category, name, .. } = &self.catalog.entries[object];
        let below = self.root.iter().map(|root| root.join(VOXELS).join(category).join(name));
        let folders = below.chain([self.folders[object].clone()]);
        Self::first_of(folders.map(|f| f.join("model.binvox")))
    }
}

impl Dataset for R2n2 {
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
        let folder = &self.folders[object];
        let source = Source::folder(&folder.join(RENDERING));
        let lines = Lines::read(&source)?.0;
        let listed = self.listed(object, lines.len());
        let all: Vec<usize> = (0..listed.len()).collect();
        let mut pending: Vec<Pending<'_>> = Vec::new();
        let mut warnings = Vec::new();
        for &view in which.unwrap_or(&all) {
            let count = listed.len();
            assert!(view < count, "views: view {view} of an object with {count}");
            let view = listed[view];
            let line = &lines[view];
            if options.allow_missing && !source.has(&line.image) {
                warnings.push(format!("view {view} is left out: {} is missing", line.image));
                continue;
            }
            let (source, lens) = (&source, self.lens);
            pending.push(Pending::new(line.stem(), move |opened| {
                let image = read_image_file(opened, &line.image, "image")?;
                let camera = lens.camera(line, image.pixels.width, image.pixels.height);
                let field = format!("line {} with {lens:?}", view + 1);
                let file = source.locate(metadata::FILE);
                camera.validate().map_err(ReadViewsError::camera(file, field))?;
                let depths = [format!("{}_depth.exr", line.stem())];
                let depth = depth::read(opened, &depths, Unit::OfIntegers(1.0), options)?;
                assemble(line.stem().to_owned(), image, MaskFile::default(), camera, depth, options)
            }));
        }
        let reading = Reading { pending, warnings, ..Reading::new(Layout::R2n2, metadata::FILE) };
        read_pending(folder, &source, reading, options, progress)
    }

    fn truth(&self, object: usize) -> Result<Truth, ReadViewsError> {
        let mesh = self.mesh_file(object).map(|path| model(&path)).transpose()?.flatten();
        let voxels = self.voxel_file(object).map(|path| {
            let wrong = |error| ReadViewsError::new(&path, ViewsProblem::Mesh(Box::new(error)));
            binvox::read(&path).map_err(wrong)
        });
        let voxels = voxels.transpose()?;
        let points = self.folders[object].join(POINTS);
        let points = if points.is_file() { Some(points::read(&points)?) } else { None };
        Ok(Truth { mesh, points, voxels })
    }
}

impl Line {
    /// The image's name without its ending: what depth and normals are called after.
    fn stem(&self) -> &str {
        self.image.rsplit_once('.').map_or(&self.image, |(stem, _)| stem)
    }
}
