//! CUB-200-2011 with the cache of CMR: birds, their masks, keypoints and weak-perspective cameras.
//!
//! Wah et al., "The Caltech-UCSD Birds-200-2011 Dataset"; Kanazawa, Tulsiani, Efros, Malik,
//! "Learning Category-Specific Mesh Reconstruction from Image Collections" (ECCV 2018), whose
//! structure from motion gives a scale, a shift and a rotation to each image.

use std::path::{Path, PathBuf};

use mesh_core::nalgebra::Matrix3;
use mesh_core::{ByteImage, Camera, TriMesh};

use crate::assemble::{assemble, read_image_file};
use crate::counted::counted_are;
use crate::dataset::{Catalog, Dataset, Entry, Subset};
use crate::error::ReadViewsError;
use crate::formats::mat::{Mat, Node};
use crate::layouts::album::{Album, fitted};
use crate::options::ReadOptions;
use crate::source::{Opened, Source};
use crate::view::{Layout, View, Views};

/// Where the cache may be, from the folder that is opened.
const CACHES: [&str; 5] = ["", "cachedir/cub", "cub", "UCMR_CUB_data/cub", "cmr/cachedir/cub"];
/// Where the images may be, from that folder, the cache and the folders around it.
const PICTURES: [&str; 2] = ["CUB_200_2011/images", "CUB_200_2011/CUB_200_2011/images"];
/// No annotations of a split are longer.
const CACHE_BYTES: u64 = 1 << 30;
/// How many parts of a bird have a name.
const PARTS: usize = 15;

/// CUB on disk: the objects are the birds, one image each.
///
/// The world is that of CMR's structure from motion. Boxes, keypoints and poses are in
/// [`Cub::annotation`], the mean bird in [`Cub::mean_shape`].
#[derive(Debug)]
pub struct Cub {
    catalog: Catalog,
    images: Source,
    annotations: Vec<CubAnnotation>,
    /// The splits' files, which hold the masks, one bit a pixel.
    files: Vec<(PathBuf, Mat)>,
    mean_shape: Option<CubMeanShape>,
}

/// What CUB and CMR's cache say about one image.
#[derive(Clone, Debug, PartialEq)]
pub struct CubAnnotation {
    /// The image, relative to `CUB_200_2011/images`.
    pub image: String,
    /// The bird's kind, from 1.
    pub class: usize,
    /// The bird's box: left, top, right, bottom, pixels from the image's top-left corner.
    pub bounds: [f64; 4],
    /// The visible parts, pixels from the image's top-left corner.
    pub parts: [Option<[f64; 2]>; PARTS],
    /// Pixels per unit of the model.
    pub scale: f64,
    /// Where the model's origin lands, as the file has it: the first pixel's centre at (0, 0).
    pub shift: [f64; 2],
    /// Rotation of the model into the camera, by rows; x right, y down.
    pub rotation: [[f64; 3]; 3],
    /// Which file, and which image in it.
    place: (usize, usize),
    /// The file of the pose and the place in it, for messages.
    pose_file: PathBuf,
    pose_field: String,
}

/// The mean of the birds' parts, and the hull around them that CMR begins with.
#[derive(Clone, Debug, PartialEq)]
pub struct CubMeanShape {
    /// The parts, in the order of [`CubAnnotation::parts`].
    pub parts: [[f64; 3]; PARTS],
    /// Triangles of the convex hull, indices of parts from 0.
    pub triangles: Vec<[u32; 3]>,
}

impl CubMeanShape {
    /// The hull as a mesh.
    pub fn mesh(&self) -> TriMesh {
        let positions = self.parts.map(|p| p.map(|v| v as f32)).to_vec();
        TriMesh { positions, faces: self.triangles.clone(), ..TriMesh::default() }
    }
}

impl CubAnnotation {
    /// The camera for an image of this size: `x = s (R X)_{xy} + t`, y down.
    pub fn camera(&self, width: usize, height: usize) -> Camera {
        // CMR's own constructor counts in halves of the image; a square one has the same half on
        // both axes, and the lens is in pixels from then on.
        let half = width.max(height) as f64 / 2.0;
        // The first pixel's centre is at 0 in the file, at 1/2 here.
        let [tx, ty] = self.shift.map(|t| (t + 0.5) / half - 1.0);
        let side = width.max(height);
        let upright = [1.0, 0.0, 0.0, 0.0];
        let mut camera =
            Camera::from_weak_perspective(self.scale / half, tx, ty, upright, side, side);
        camera.rotation *= Matrix3::from_fn(|i, j| self.rotation[i][j]);
        Camera { width, height, ..camera }
    }

    /// Where each part goes when the image is mirrored: left and right change places.
    ///
    /// CMR's `kp_perm`, from 0: part `i` of a mirrored bird is part `MIRRORED[i]` of the bird.
    pub const MIRRORED: [usize; PARTS] = [0, 1, 2, 3, 4, 5, 10, 11, 12, 9, 6, 7, 8, 13, 14];

    fn new(
        image: &Node<'_>,
        pose: &Node<'_>,
        place: (usize, usize),
    ) -> Result<Self, ReadViewsError> {
        let bbox = image.need("bbox")?;
        let edge = |key: &str| bbox.need(key)?.number();
        let class = match image.get("class_id") {
            Some(node) => {
                let number = node.number()?;
                if !(number >= 0.0 && number.fract() == 0.0) {
                    return Err(node.found(number.to_string(), "a class's number"));
                }
                number as usize
            }
            None => 0,
        };
        let scale = pose.need("scale")?;
        if scale.number()? <= 0.0 {
            return Err(scale.found(scale.number()?.to_string(), "a number above 0"));
        }
        Ok(Self {
            image: image.need("rel_path")?.text()?.replace('\\', "/"),
            class,
            // From MATLAB's first and last pixel to the box's edges.
            bounds: [edge("x1")? - 1.0, edge("y1")? - 1.0, edge("x2")?, edge("y2")?],
            parts: parts(&image.need("parts")?)?,
            scale: scale.number()?,
            shift: pose.need("trans")?.vector()?,
            rotation: pose.need("rot")?.matrix3()?,
            place,
            pose_file: pose.file().to_owned(),
            pose_field: pose.field.clone(),
        })
    }

    fn read(
        &self,
        name: &str,
        mask: &Node<'_>,
        opened: &mut Opened<'_>,
        options: &ReadOptions,
    ) -> Result<View, ReadViewsError> {
        let image = read_image_file(opened, &self.image, "image")?;
        let (array, height, width) = mask.table()?;
        let camera = self.camera(width, height);
        let camera = fitted(camera, &image, &self.pose_file, &self.pose_field)?;
        let mask = options.reads_mask_files().then(|| {
            let inside = |i: usize, j: usize| array.at(j * height + i) > 0.0;
            let data = (0..height).flat_map(|i| (0..width).map(move |j| (i, j)));
            let data = data.map(|(i, j)| if inside(i, j) { 255 } else { 0 }).collect();
            (mask.file().to_owned(), ByteImage { height, width, channels: 1, data })
        });
        assemble(name.to_owned(), image, mask.into(), camera, None, options)
    }
}

/// Rows x, y, visible; MATLAB's first pixel has its centre at (1, 1).
fn parts(node: &Node<'_>) -> Result<[Option<[f64; 2]>; PARTS], ReadViewsError> {
    let (array, 3, PARTS) = node.table()? else {
        return Err(node.wrong(format!("3x{PARTS} numbers")));
    };
    let part = |k: usize| {
        let at = [array.at(3 * k) - 0.5, array.at(3 * k + 1) - 0.5];
        (array.at(3 * k + 2) > 0.0 && at.iter().all(|v| v.is_finite())).then_some(at)
    };
    Ok(std::array::from_fn(part))
}

fn mean_shape(file: &Path, mat: &Mat) -> Result<Option<CubMeanShape>, ReadViewsError> {
    let (Some(shape), Some(hull)) = (mat.get("S", file), mat.get("conv_tri", file)) else {
        return Ok(None);
    };
    let (array, 3, PARTS) = shape.table()? else {
        return Err(shape.wrong(format!("3x{PARTS} numbers")));
    };
    let parts = std::array::from_fn(|i| std::array::from_fn(|k| array.at(3 * i + k)));
    if !parts.iter().flatten().all(|v: &f64| v.is_finite()) {
        return Err(shape.found("a number that is not finite", "finite numbers"));
    }
    Ok(Some(CubMeanShape { parts, triangles: hull.triangles(PARTS)? }))
}

/// The folder with `data` and `sfm` in it, at the path or where the tools put it.
fn cache(path: &Path) -> Option<PathBuf> {
    let holds = |cache: &PathBuf| {
        Subset::NAMES.iter().any(|(split, _)| cache.join(annotations_of(split)).is_file())
    };
    CACHES.iter().map(|inner| path.join(inner)).find(holds)
}

fn annotations_of(split: &str) -> String {
    format!("data/{split}_cub_cleaned.mat")
}

/// The folder of images, near the path or around the cache; where it should be if it is nowhere.
fn images(path: &Path, cache: &Path) -> PathBuf {
    let around = [path].into_iter().chain(cache.ancestors().take(4));
    let mut places = around.flat_map(|base| PICTURES.iter().map(|inner| base.join(inner)));
    places.find(|place| place.is_dir()).unwrap_or_else(|| path.join(PICTURES[0]))
}

impl Cub {
    /// Whether CMR's cache of CUB is at the path, or where its tools put it.
    pub(crate) fn recognises(path: &Path) -> bool {
        cache(path).is_some()
    }

    /// Opens CMR's cache (the folder with `data` and `sfm`), or a folder with it as `cachedir/cub`,
    /// `cub` or `UCMR_CUB_data/cub`. The images are looked for in `CUB_200_2011/images` there and
    /// in the folders around. Annotations are read and checked, images are not.
    ///
    /// # Memory
    /// The masks of all images, one bit a pixel: 140 MB for the whole of CUB.
    /// # Errors
    /// If there is no cache, or an annotation is incomplete or cannot be meant.
    pub fn open(path: &Path) -> Result<Self, ReadViewsError> {
        let Some(cache) = cache(path) else {
            let wanted_by = "CUB with CMR's cache is read by it, or by that of val or test";
            return Err(ReadViewsError::missing(path.join(annotations_of("train")), wanted_by));
        };
        let source = Source::folder(&cache);
        let read = |name: &str| -> Result<(PathBuf, Mat), ReadViewsError> {
            let file = source.locate(name);
            let mat = Mat::read(&source.open()?.read(name, "annotations", CACHE_BYTES)?, &file)?;
            Ok((file, mat))
        };
        let mut out = Self {
            catalog: Catalog::new(Layout::Cub, path),
            images: Source::folder(&images(path, &cache)),
            annotations: Vec::new(),
            files: Vec::new(),
            mean_shape: None,
        };
        for (split, subset) in Subset::NAMES {
            let name = annotations_of(split);
            if !source.has(&name) {
                continue;
            }
            let (file, images) = read(&name)?;
            let (sfm_file, sfm) = read(&format!("sfm/anno_{split}.mat"))?;
            out.add(subset, (&file, &images), (&sfm_file, &sfm))?;
            if out.mean_shape.is_none() {
                out.mean_shape = mean_shape(&sfm_file, &sfm)?;
            }
            out.files.push((file, images));
        }
        if out.annotations.is_empty() {
            return Err(ReadViewsError::field(&cache, "images", "none", "at least one"));
        }
        Ok(out)
    }

    fn add(
        &mut self,
        subset: Subset,
        images: (&Path, &Mat),
        sfm: (&Path, &Mat),
    ) -> Result<(), ReadViewsError> {
        let (images, poses) = (images.1.need("images", images.0)?, sfm.1.need("sfm_anno", sfm.0)?);
        let (all_images, all_poses) = (images.elements()?, poses.elements()?);
        if all_images.len() != all_poses.len() {
            let expected = format!("{}, as many as images", all_images.len());
            return Err(poses.found(format!("{} structs", all_poses.len()), expected));
        }
        let mut empty = 0;
        for (i, (image, pose)) in all_images.iter().zip(&all_poses).enumerate() {
            let (mask, ..) = image.need("mask")?.table()?;
            // CMR leaves these out too.
            if (0..mask.len()).all(|k| mask.at(k) <= 0.0) {
                empty += 1;
                continue;
            }
            let annotation = CubAnnotation::new(image, pose, (self.files.len(), i))?;
            let stem = annotation.image.rsplit_once('.').map_or(&*annotation.image, |(s, _)| s);
            let (category, name) = stem.rsplit_once('/').unwrap_or(("", stem));
            let (category, name) = (category.to_owned(), name.to_owned());
            self.catalog.entries.push(Entry { category, name, views: 1, subset: Some(subset) });
            self.annotations.push(annotation);
        }
        if empty > 0 {
            let file = images.file().display();
            self.catalog
                .warnings
                .push(format!("{} left out of {file}: empty masks", counted_are(empty, "bird")));
        }
        Ok(())
    }

    /// The annotation of an object.
    ///
    /// # Panics
    /// If the object does not exist.
    pub fn annotation(&self, object: usize) -> &CubAnnotation {
        &self.annotations[object]
    }

    /// The mean bird, where the cache has it (`S` and `conv_tri` of the first split that is there).
    pub fn mean_shape(&self) -> Option<&CubMeanShape> {
        self.mean_shape.as_ref()
    }
}

impl Dataset for Cub {
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
        let (file, mat) = &self.files[annotation.place.0];
        let album = Album { catalog: &self.catalog, source: &self.images, poses: "sfm_anno" };
        album.read_single((name, &annotation.image), which, options, progress, |opened| {
            let image = mat.need("images", file)?.element(annotation.place.1)?;
            annotation.read(name, &image.need("mask")?, opened, options)
        })
    }
}
