//! The form into which MCMR brings Pascal3D+: one file of annotations and one mask an object.
//!
//! Simoni, Pini, Vezzani, Cucchiara, "Multi-Category Mesh Reconstruction From Image Collections"
//! (3DV 2021); the files are those that its `preprocess.py` writes.

use std::path::{Path, PathBuf};

use mesh_core::nalgebra::Vector3;
use mesh_core::{Camera, CameraError};
use rayon::prelude::*;

use crate::assemble::{assemble, read_image_file};
use crate::content::numbered;
use crate::counted::counted_are;
use crate::dataset::{Catalog, Dataset, Entry, Subset};
use crate::error::ReadViewsError;
use crate::formats::json::Node;
use crate::formats::yaml;
use crate::layouts::album::{Album, fitted};
use crate::mask_file::named_mask;
use crate::options::ReadOptions;
use crate::source::{Opened, Source, names_of};
use crate::view::{Layout, View, Views};

const ANNOTATIONS: &str = "annotations";
/// The lists of a class, named `<class>_<this>.txt`.
const SPLITS: [(&str, Subset); 3] =
    [("train", Subset::Train), ("eval", Subset::Validation), ("test", Subset::Test)];
/// Folders of masks, the most trusted first. What a network painted is no truth to test on.
const MASKS: [&str; 5] = ["masks_VOC", "masks_hariharan", "masks_cmr", "masks_pointrend", "masks"];
const PAINTED: [&str; 2] = ["masks_pointrend", "masks"];
/// No annotation of an object is longer, nor a list of them.
const ANNOTATION_BYTES: u64 = 1 << 20;
const LIST_BYTES: u64 = 1 << 26;
/// What a line of a list takes while its annotation is read.
const LINE: usize = 1000;

/// MCMR's form of Pascal3D+ on disk: the objects are what is annotated, one image each.
///
/// The world is that of Pascal3D+'s models: +z up, the front at -y. Boxes, flags and keypoints
/// are in [`Mcmr::annotation`].
#[derive(Debug)]
pub struct Mcmr {
    catalog: Catalog,
    source: Source,
    annotations: Vec<McmrAnnotation>,
}

/// What one file of annotations says.
#[derive(Clone, Debug, PartialEq)]
pub struct McmrAnnotation {
    /// The image, relative to the root.
    pub image: String,
    /// The mask, relative to the root: the first of VOC's, Hariharan's, CMR's, PointRend's and
    /// Mask R-CNN's that is there; for what is tested on, only the first three count.
    pub mask: String,
    /// `aeroplane`, `bicycle`, ..
    pub class: String,
    /// Width and height of the image, pixels.
    pub size: [usize; 2],
    /// Which of the class's models is nearest, from 0.
    pub model: usize,
    /// Whether something hides part of the object.
    pub occluded: bool,
    /// Whether the image's border cuts the object.
    pub truncated: bool,
    /// Whether VOC calls the object difficult.
    pub difficult: bool,
    /// The object's box: left, top, right, bottom, pixels from the image's top-left corner.
    pub bounds: [f64; 4],
    /// The keypoints of the class, where they are visible, pixels from the image's top-left
    /// corner. MCMR's own loader leaves objects out of which at most 3 are.
    pub keypoints: Vec<Option<[f64; 2]>>,
    /// By rows; the principal point is Pascal3D+'s, the first pixel's centre at (1, 1).
    pub intrinsic: [[f64; 3]; 3],
    /// Rotation and translation of the world into the camera, by rows; x right, y down, z forward.
    pub extrinsic: [[f64; 4]; 3],
    file: PathBuf,
}

impl McmrAnnotation {
    /// The camera of the whole image.
    ///
    /// MCMR drops the roll (`theta`) of Pascal3D+; all else is the same camera.
    ///
    /// # Errors
    /// If the intrinsic matrix has skew.
    pub fn camera(&self) -> Result<Camera, CameraError> {
        let e = self.extrinsic;
        let rotation = std::array::from_fn(|i| std::array::from_fn(|j| e[i][j]));
        let mut intrinsic = self.intrinsic;
        // MATLAB's (1, 1) is the first pixel's centre, ours is at (0.5, 0.5).
        intrinsic[0][2] -= 0.5;
        intrinsic[1][2] -= 0.5;
        let translation = [e[0][3], e[1][3], e[2][3]];
        Camera::from_opencv(rotation, translation, intrinsic, self.size[0], self.size[1])
    }

    fn new(root: &Node<'_>, class: &str, mask: String) -> Result<Self, ReadViewsError> {
        let size = root.need("image_size")?;
        let [h, w, _] = size.numbers::<3>()?;
        let whole = |v: f64| (1.0..1e6).contains(&v) && v.fract() == 0.0;
        if !(whole(w) && whole(h)) {
            return Err(size.wrong("height, width, channels in pixels"));
        }
        let cad = root.need("cad_idx")?;
        let model = cad.number()?;
        if !(model >= 0.0 && model.fract() == 0.0) {
            return Err(cad.wrong("the number of a model, from 0"));
        }
        let [left, top, right, bottom] = root.need("bbox")?.numbers()?;
        let keypoints = root.get("kpoints_2d").map(|node| node.rows()).transpose()?;
        let keypoints = keypoints.unwrap_or_default();
        let visible = |k: [f64; 3]| (k[2] > 0.0).then_some([k[0] - 0.5, k[1] - 0.5]);
        let matrix = root.need("extrinsic")?;
        let extrinsic = matrix.matrix()?;
        let image = root.need("image_name")?.text()?;
        let flag = |key: &str| root.get(key).map_or(Ok(false), |n| n.flag());
        Ok(Self {
            image: format!("{class}/images/{image}"),
            mask,
            class: class.to_owned(),
            size: [w as usize, h as usize],
            model: model as usize,
            occluded: flag("occluded")?,
            truncated: flag("truncated")?,
            difficult: flag("difficult")?,
            // From MATLAB's first and last pixel to the box's edges.
            bounds: [(left - 1.0).max(0.0), (top - 1.0).max(0.0), right, bottom],
            keypoints: keypoints.into_iter().map(visible).collect(),
            intrinsic: root.need("intrinsic")?.matrix3()?,
            extrinsic: [extrinsic[0], extrinsic[1], extrinsic[2]],
            file: root.file().to_owned(),
        })
    }

    /// Whether nobody has aligned a model: Pascal3D+ says so with a distance of 0.
    fn has_no_pose(&self) -> bool {
        Vector3::from(self.extrinsic.map(|row| row[3])).norm() == 0.0
    }

    fn read(
        &self,
        name: &str,
        opened: &mut Opened<'_>,
        options: &ReadOptions,
    ) -> Result<View, ReadViewsError> {
        let image = read_image_file(opened, &self.image, "image")?;
        let field = "intrinsic, extrinsic";
        let camera = self.camera().map_err(ReadViewsError::camera(&self.file, field))?;
        let camera = fitted(camera, &image, &self.file, field)?;
        let mask = named_mask(opened, &self.mask, options)?;
        assemble(name.to_owned(), image, mask, camera, None, options)
    }
}

/// The folder of all classes, and the classes: the path, or the path of a single class.
fn classes(path: &Path) -> Option<(PathBuf, Vec<String>)> {
    let is_class = |folder: &Path| {
        let name = folder.file_name().and_then(|n| n.to_str()).unwrap_or_default();
        let listed = |split: &str| folder.join(format!("{name}_{split}.txt")).is_file();
        folder.join(ANNOTATIONS).is_dir()
            && folder.join("images").is_dir()
            && SPLITS.iter().any(|(split, _)| listed(split))
    };
    if is_class(path) {
        let name = path.file_name()?.to_str()?.to_owned();
        let root =
            path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or_else(|| Path::new("."));
        return Some((root.to_owned(), vec![name]));
    }
    let mut names = names_of(path).ok()?;
    names.retain(|name| is_class(&path.join(name)));
    (!names.is_empty()).then(|| (path.to_owned(), names))
}

/// One object that a list names.
struct Listed {
    class: String,
    stem: String,
    subset: Subset,
}

/// The objects of a class, in the order of its lists.
fn listed(source: &Source, class: &str) -> Result<Vec<Listed>, ReadViewsError> {
    let mut out = Vec::new();
    for (split, subset) in SPLITS {
        let name = format!("{class}/{class}_{split}.txt");
        if !source.has(&name) {
            continue;
        }
        let list = source.open()?.read(&name, "list", LIST_BYTES)?;
        for (_, line) in numbered(&list.text(LINE, &source.locate(&name))?) {
            // The lists hold the paths of the machine that made them; the file's name is enough.
            let file = line.rsplit(['/', '\\']).next().unwrap_or_default();
            if !file.is_empty() {
                let stem = file.strip_suffix(".yaml").unwrap_or(file).to_owned();
                out.push(Listed { class: class.to_owned(), stem, subset });
            }
        }
    }
    Ok(out)
}

/// The annotation that a list names; nothing where it has no mask.
fn read_annotation(
    source: &Source,
    listed: &Listed,
) -> Result<Option<McmrAnnotation>, ReadViewsError> {
    let Listed { class, stem, subset } = listed;
    let masks = MASKS.iter().filter(|folder| *subset != Subset::Test || !PAINTED.contains(folder));
    let masks = masks.map(|folder| format!("{class}/{folder}/{stem}.png"));
    let Some(mask) = { masks }.find(|mask| source.has(mask)) else { return Ok(None) };
    let name = format!("{class}/{ANNOTATIONS}/{stem}.yaml");
    let file = source.locate(&name);
    let value = yaml::parse(&source.open()?.read(&name, "annotation", ANNOTATION_BYTES)?, &file)?;
    McmrAnnotation::new(&Node::root(&value, &file), class, mask).map(Some)
}

impl Mcmr {
    /// Whether the path is a folder of such classes, or one of them.
    pub(crate) fn recognises(path: &Path) -> bool {
        classes(path).is_some()
    }

    /// Opens the folder with the classes (`PASCAL_final`), or a single class. All annotations that
    /// the lists name are read and checked, in parallel; images are not.
    ///
    /// # Errors
    /// If there is no such class, or an annotation cannot be read; the first in their order.
    pub fn open(path: &Path) -> Result<Self, ReadViewsError> {
        let Some((root, classes)) = classes(path) else {
            let wanted_by = "MCMR's form of Pascal3D+ has it in the folder of each class, beside \
                             images and <class>_{train,eval,test}.txt";
            return Err(ReadViewsError::missing(path.join(ANNOTATIONS), wanted_by));
        };
        let source = Source::folder(&root);
        let mut all = Vec::new();
        for class in &classes {
            all.extend(listed(&source, class)?);
        }
        let read: Vec<Result<Option<McmrAnnotation>, ReadViewsError>> =
            all.par_iter().map(|listed| read_annotation(&source, listed)).collect();
        let (mut entries, mut annotations) = (Vec::new(), Vec::new());
        let (mut unmasked, mut unposed) = (0, 0);
        for (Listed { class, stem, subset }, annotation) in all.into_iter().zip(read) {
            match annotation? {
                None => unmasked += 1,
                Some(annotation) if annotation.has_no_pose() => unposed += 1,
                Some(annotation) => {
                    let subset = Some(subset);
                    entries.push(Entry { category: class, name: stem, views: 1, subset });
                    annotations.push(annotation);
                }
            }
        }
        let mut warnings = Vec::new();
        if unmasked > 0 {
            warnings.push(format!("{} left out: no mask", counted_are(unmasked, "object")));
        }
        if unposed > 0 {
            warnings.push(format!(
                "{} left out: no model is aligned (distance 0)",
                counted_are(unposed, "object")
            ));
        }
        if annotations.is_empty() {
            let found = "none with a mask and a pose";
            return Err(ReadViewsError::field(path, ANNOTATIONS, found, "at least one"));
        }
        let catalog = Catalog { entries, warnings, ..Catalog::new(Layout::Mcmr, path) };
        Ok(Self { catalog, source, annotations })
    }

    /// The annotation of an object.
    ///
    /// # Panics
    /// If the object does not exist.
    pub fn annotation(&self, object: usize) -> &McmrAnnotation {
        &self.annotations[object]
    }
}

impl Dataset for Mcmr {
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
        let (annotation, name) =
            (&self.annotations[object], self.catalog.entries[object].name.as_str());
        let album = Album { catalog: &self.catalog, source: &self.source, poses: "extrinsic" };
        album.read_single((name, &annotation.image), which, options, progress, |opened| {
            annotation.read(name, opened, options)
        })
    }
}
