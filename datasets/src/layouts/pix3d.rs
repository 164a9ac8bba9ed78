//! Pix3D: photographs of furniture with the model that was seen, its pose and its mask.
//!
//! Two files of annotations are read: `pix3d.json` as it is shipped, and the COCO-like
//! `pix3d_s1_train.json` and its kin of Mesh R-CNN. Sun et al., "Pix3D" (CVPR 2018);
//! Gkioxari et al., "Mesh R-CNN" (ICCV 2019).

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use mesh_core::{Camera, VoxelGrid};

use crate::assemble::{assemble, read_image_file};
use crate::content::over;
use crate::dataset::{Catalog, Dataset, Entry, Subset, Truth};
use crate::error::ReadViewsError;
use crate::formats::json::{Node, parse};
use crate::formats::mat::Mat;
use crate::layouts::album::{Album, Photo, chosen, fitted, model};
use crate::mask_file::named_mask;
use crate::options::ReadOptions;
use crate::source::{Opened, Source};
use crate::view::{Layout, View, Views};

/// The annotations as they are shipped.
const WHOLE: &str = "pix3d.json";
/// Mesh R-CNN's: split by image (`s1`) and by model (`s2`).
const SPLITS: [[&str; 2]; 2] =
    [["pix3d_s2_train.json", "pix3d_s2_test.json"], ["pix3d_s1_train.json", "pix3d_s1_test.json"]];
/// Their masks have another size than the images; Mesh R-CNN leaves them out too.
const MISMATCHED: [&str; 2] = ["img/table/1749.jpg", "img/table/0045.png"];
/// Width of the sensor that focal lengths in millimetres are for.
const SENSOR: f64 = 32.0;
/// Longer than any file of annotations.
const JSON_BYTES: u64 = 1 << 29;
/// Longer than any file of voxels.
const VOXEL_BYTES: u64 = 1 << 26;
/// More cells than any model has along an axis.
const VOXEL_SIDE: usize = 1024;

/// Pix3D on disk: the objects are its models, their views the photographs of each.
///
/// The world is that of the model, with +x to the left, +y up and +z inward of the object seen
/// from its front. Boxes, flags and focal lengths are in [`Pix3d::annotations`].
#[derive(Debug)]
pub struct Pix3d {
    catalog: Catalog,
    source: Source,
    /// The annotations of each object.
    objects: Vec<Vec<Pix3dAnnotation>>,
}

/// What Pix3D says about one photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct Pix3dAnnotation {
    /// The image, relative to the root, as all paths are.
    pub image: String,
    /// Its mask.
    pub mask: String,
    /// The model, an OBJ file.
    pub model: String,
    /// The model's voxels, a MAT file.
    pub voxels: Option<String>,
    /// What is shown: `chair`, `sofa`, ..
    pub category: String,
    /// Width and height of the image, pixels.
    pub size: [usize; 2],
    /// The object's box: left, top, right, bottom, pixels from the image's top-left corner.
    pub bounds: [f64; 4],
    /// Focal length, pixels.
    pub focal: f64,
    /// Rotation of the model into the camera, by rows; camera axes x left, y up, z forward.
    pub rotation: [[f64; 3]; 3],
    /// Translation of the model into the camera.
    pub translation: [f64; 3],
    /// Whether the image's border cuts the object.
    pub truncated: bool,
    /// Whether something hides much of the object.
    pub occluded: bool,
    /// Whether something hides a little of the object.
    pub slightly_occluded: bool,
    /// The subset, where the annotations come from a file of a split.
    pub subset: Option<Subset>,
    /// The file and the place in it, for messages.
    file: PathBuf,
    field: String,
}

impl Pix3dAnnotation {
    /// The camera of the photograph, in the world of the model.
    ///
    /// A model point is at `p = rotation X + translation`, x to the left, y up, z away from the
    /// camera, and lands at `(W/2 - f x/z, H/2 - f y/z)`: PyTorch3D's axes.
    pub fn camera(&self) -> Camera {
        let r = self.rotation;
        // PyTorch3D multiplies row vectors from the right.
        let transposed = std::array::from_fn(|i| std::array::from_fn(|j| r[j][i]));
        let [w, h] = self.size;
        let center = [w as f64 / 2.0, h as f64 / 2.0];
        let focal = [self.focal; 2];
        Camera::from_pytorch3d_screen(transposed, self.translation, focal, center, w, h)
    }

    /// One record of `pix3d.json`.
    fn shipped(node: &Node<'_>) -> Result<Self, ReadViewsError> {
        let size = node.need("img_size")?;
        let [w, h] = size.numbers()?;
        let [w, h] = if [w, h].iter().all(|v| *v >= 1.0 && *v < 1e6 && v.fract() == 0.0) {
            [w as usize, h as usize]
        } else {
            return Err(size.wrong("width and height in pixels"));
        };
        let flag = |key: &str| node.get(key).map_or(Ok(false), |n| n.flag());
        Ok(Self {
            image: node.need("img")?.text()?.to_owned(),
            mask: node.need("mask")?.text()?.to_owned(),
            model: node.need("model")?.text()?.to_owned(),
            voxels: node.get("voxel").map(|n| n.text().map(String::from)).transpose()?,
            category: node.need("category")?.text()?.to_owned(),
            size: [w, h],
            bounds: node.need("bbox")?.numbers()?,
            focal: node.need("focal_length")?.positive()? / SENSOR * w as f64,
            rotation: node.need("rot_mat")?.matrix3()?,
            translation: node.need("trans_mat")?.numbers()?,
            truncated: flag("truncated")?,
            occluded: flag("occluded")?,
            slightly_occluded: flag("slightly_occluded")?,
            subset: None,
            file: node.file().to_owned(),
            field: node.field.clone(),
        })
    }

    fn read(&self, opened: &mut Opened<'_>, options: &ReadOptions) -> Result<View, ReadViewsError> {
        let image = read_image_file(opened, &self.image, "image")?;
        let field = format!("{}.rot_mat, trans_mat, focal_length", self.field);
        let camera = fitted(self.camera(), &image, &self.file, &field)?;
        let mask = named_mask(opened, &self.mask, options)?;
        assemble(self.image.clone(), image, mask, camera, None, options)
    }
}

/// Mesh R-CNN's file: images, categories and annotations that refer to them by number.
fn coco(root: &Node<'_>, subset: Option<Subset>) -> Result<Vec<Pix3dAnnotation>, ReadViewsError> {
    let mut images = BTreeMap::new();
    for image in root.need("images")?.elements()? {
        let size = [image.need("width")?.pixels()?, image.need("height")?.pixels()?];
        let name = image.need("file_name")?.text()?.to_owned();
        images.insert(image.need("id")?.number()?.to_bits(), (name, size));
    }
    let mut categories = BTreeMap::new();
    for category in root.need("categories")?.elements()? {
        let name = category.need("name")?.text()?.to_owned();
        categories.insert(category.need("id")?.number()?.to_bits(), name);
    }
    let mut out = Vec::new();
    for node in root.need("annotations")?.elements()? {
        if node.get("iscrowd").map_or(Ok(false), |n| n.flag())? {
            continue;
        }
        let id = node.need("image_id")?;
        let (image, size) = images
            .get(&id.number()?.to_bits())
            .ok_or_else(|| id.wrong("the id of one of the images"))?;
        let id = node.need("category_id")?;
        let category = categories
            .get(&id.number()?.to_bits())
            .ok_or_else(|| id.wrong("the id of one of the categories"))?;
        let intrinsics = node.need("K")?;
        let [focal, ..]: [f64; 3] = intrinsics.numbers()?;
        if focal <= 0.0 {
            return Err(intrinsics.wrong("[focal length above 0, cx, cy], pixels"));
        }
        let [left, top, width, height]: [f64; 4] = node.need("bbox")?.numbers()?;
        out.push(Pix3dAnnotation {
            image: image.clone(),
            mask: node.need("segmentation")?.text()?.to_owned(),
            model: node.need("model")?.text()?.to_owned(),
            voxels: node.get("voxel").map(|n| n.text().map(String::from)).transpose()?,
            category: category.clone(),
            size: *size,
            bounds: [left, top, left + width, top + height],
            focal,
            rotation: node.need("rot_mat")?.matrix3()?,
            translation: node.need("trans_mat")?.numbers()?,
            truncated: false,
            occluded: false,
            slightly_occluded: false,
            subset,
            file: node.file().to_owned(),
            field: node.field.clone(),
        });
    }
    Ok(out)
}

/// The folder and the files of annotations in it, where the path is Pix3D.
fn files(path: &Path) -> Option<(PathBuf, Vec<String>)> {
    let name = path.file_name().and_then(|n| n.to_str()).unwrap_or_default();
    let is_json = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"));
    if name.starts_with("pix3d") && is_json && path.is_file() {
        return Some((path.parent()?.to_owned(), vec![name.to_owned()]));
    }
    let has = |name: &str| path.join(name).is_file();
    if has(WHOLE) {
        return Some((path.to_owned(), vec![WHOLE.to_owned()]));
    }
    let found = SPLITS.iter().find(|split| split.iter().any(|name| has(name)))?;
    let names = found.iter().filter(|name| has(name)).map(|&name| name.to_owned());
    Some((path.to_owned(), names.collect()))
}

impl Pix3d {
    /// Whether the path is a folder with Pix3D's annotations, or one of their files.
    pub(crate) fn recognises(path: &Path) -> bool {
        files(path).is_some()
    }

    /// Opens a folder with `pix3d.json` or Mesh R-CNN's `pix3d_s{1,2}_{train,test}.json`, or one
    /// of these files. The annotations are read and checked, images are not.
    ///
    /// # Errors
    /// If there is no such file, or an annotation is incomplete or cannot be meant.
    pub fn open(path: &Path) -> Result<Self, ReadViewsError> {
        let Some((root, files)) = files(path) else {
            let wanted_by = format!("Pix3D is read by it, or by one named {}", SPLITS[0][0]);
            return Err(ReadViewsError::missing(path.join(WHOLE), wanted_by));
        };
        let source = Source::folder(&root);
        let mut opened = source.open()?;
        let (mut all, mut warnings) = (Vec::new(), Vec::new());
        for name in &files {
            let file = source.locate(name);
            let value = parse(&opened.read(name, "annotations", JSON_BYTES)?, &file)?;
            let root = Node::root(&value, &file);
            if root.get("annotations").is_some() {
                let subset = match name {
                    _ if name.ends_with("_train.json") => Some(Subset::Train),
                    _ if name.ends_with("_test.json") => Some(Subset::Test),
                    _ => None,
                };
                all.extend(coco(&root, subset)?);
            } else {
                for node in root.elements()? {
                    all.push(Pix3dAnnotation::shipped(&node)?);
                }
            }
        }
        let mut by_model: BTreeMap<(String, String), Vec<Pix3dAnnotation>> = BTreeMap::new();
        for annotation in all {
            if MISMATCHED.contains(&annotation.image.as_str()) {
                warnings
                    .push(format!("{} is left out: its mask has another size", annotation.image));
                continue;
            }
            let key = (annotation.category.clone(), object_name(&annotation));
            by_model.entry(key).or_default().push(annotation);
        }
        if by_model.is_empty() {
            return Err(ReadViewsError::field(path, "annotations", "none", "at least one"));
        }
        let (mut entries, mut objects) = (Vec::new(), Vec::new());
        for ((category, name), annotations) in by_model {
            let subset = annotations[0].subset;
            let subset = subset.filter(|_| annotations.iter().all(|a| a.subset == subset));
            entries.push(Entry { category, name, views: annotations.len(), subset });
            objects.push(annotations);
        }
        drop(opened);
        let catalog = Catalog { entries, warnings, ..Catalog::new(Layout::Pix3d, &root) };
        Ok(Self { catalog, source, objects })
    }

    /// The annotations of an object, in the order of its views.
    ///
    /// # Panics
    /// If the object does not exist.
    pub fn annotations(&self, object: usize) -> &[Pix3dAnnotation] {
        &self.objects[object]
    }

    fn voxels(&self, name: &str) -> Result<VoxelGrid, ReadViewsError> {
        let file = self.source.locate(name);
        let bytes = self.source.open()?.read(name, "voxels", VOXEL_BYTES)?;
        let mat = Mat::read(&bytes, &file)?;
        let node = mat.need("voxel", &file)?;
        let array = node.numbers()?;
        let &[a, b, c] = array.dims.as_slice() else {
            return Err(node.wrong("three axes"));
        };
        if array.len() == 0 || [a, b, c].iter().any(|&n| n > VOXEL_SIDE) {
            return Err(node.wrong(format!("1 to {VOXEL_SIDE} cells along each axis")));
        }
        // The file's values may be bits, and deflated: a cell of the grid takes a byte.
        let taken = bytes.budget().take((a * b * c) as u64);
        taken.map_err(|limit| over(&file, "voxel", limit))?;
        // The file's axes are left, outward, up; the model's left, up, inward.
        let dims = [a, c, b];
        let occupied = |[x, y, z]: [usize; 3]| array.at((y * b + (b - 1 - z)) * a + x) > 0.0;
        let mut grid = VoxelGrid::new(dims, ([0.0; 3], [1.0; 3]));
        let (mut low, mut high) = (dims, [0; 3]);
        for z in 0..b {
            for y in 0..c {
                for x in 0..a {
                    if occupied([x, y, z]) {
                        let at = grid.index([x, y, z]);
                        grid.bits[at] = true;
                        for (k, i) in [x, y, z].into_iter().enumerate() {
                            low[k] = low[k].min(i);
                            high[k] = high[k].max(i);
                        }
                    }
                }
            }
        }
        place(&mut grid, low, high);
        Ok(grid)
    }
}

/// Puts the grid where Mesh R-CNN puts it (`read_voxel`): the middle of the occupied box at the
/// origin, the farthest occupied cell's middle at distance 1/2.
fn place(grid: &mut VoxelGrid, low: [usize; 3], high: [usize; 3]) {
    let middle: [f64; 3] = std::array::from_fn(|k| (low[k] + high[k]) as f64 / 2.0);
    let mut farthest = 0.0f64;
    let [nx, ny, _] = grid.dims;
    for (i, _) in grid.bits.iter().enumerate().filter(|(_, bit)| **bit) {
        let cell = [i % nx, i / nx % ny, i / (nx * ny)];
        let square = |k: usize| (cell[k] as f64 - middle[k]).powi(2);
        farthest = farthest.max(square(0) + square(1) + square(2));
    }
    // A single cell has no extent; it becomes a cube of side 1.
    let scale = if farthest > 0.0 { 2.0 * farthest.sqrt() } else { 1.0 };
    grid.cell = [(1.0 / scale) as f32; 3];
    grid.origin = middle.map(|m| ((-0.5 - m) / scale) as f32);
}

/// The model's path without what all have: `IKEA_BERNHARD/model` of
/// `model/chair/IKEA_BERNHARD/model.obj`.
fn object_name(annotation: &Pix3dAnnotation) -> String {
    let path = annotation.model.trim_start_matches("./");
    let path = path.strip_prefix("model/").unwrap_or(path);
    let inside = path.strip_prefix(&annotation.category).and_then(|p| p.strip_prefix('/'));
    let path = inside.unwrap_or(path);
    path.strip_suffix(".obj").unwrap_or(path).to_owned()
}

impl Dataset for Pix3d {
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
        let annotations = &self.objects[object];
        let source = &self.source;
        let photos = chosen(annotations.len(), which).into_iter().map(|i| {
            let annotation = &annotations[i];
            let read = Box::new(move |opened: &mut Opened<'_>| annotation.read(opened, options));
            Photo { name: &annotation.image, image: &annotation.image, read }
        });
        let album = Album { catalog: &self.catalog, source, poses: "rot_mat, trans_mat" };
        album.read(photos.collect(), options, progress)
    }

    /// The model, and its voxels in the place that Mesh R-CNN gives them: centred, within a sphere
    /// of radius 1/2.
    fn truth(&self, object: usize) -> Result<Truth, ReadViewsError> {
        let annotation = &self.objects[object][0];
        if !self.source.is_inside(&annotation.model) {
            let wanted_by = format!("field `{}.model` names it", annotation.field);
            return Err(self.source.missing(&annotation.model, wanted_by));
        }
        let mesh = model(&self.source.locate(&annotation.model))?;
        let voxels = match &annotation.voxels {
            Some(name) if self.source.has(name) => Some(self.voxels(name)?),
            _ => None,
        };
        Ok(Truth { mesh, voxels, points: None })
    }
}
