//! Pascal3D+: photographs of twelve classes with the nearest of a few models and its pose.
//!
//! Xiang, Mottaghi, Savarese, "Beyond PASCAL: A Benchmark for 3D Object Detection in the Wild"
//! (WACV 2014); the projection is that of the authors' `project_3d.m`.

mod sets;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use mesh_core::nalgebra::{Rotation3, Vector3};
use mesh_core::{ByteImage, Camera, Lens, TriMesh};
use rayon::prelude::*;

use crate::assemble::{ImageFile, assemble, read_image_file};
use crate::counted::counted_are;
use crate::dataset::{Catalog, Dataset, Entry, Truth};
use crate::error::ReadViewsError;
use crate::formats::mat::{Mat, Node};
use crate::layouts::album::{Album, fitted, model};
use crate::options::ReadOptions;
use crate::source::{Opened, Source, names_of};
use crate::view::{Layout, View, Views};

const ANNOTATIONS: &str = "Annotations";
/// Where images come from: the second half of a folder's name, and what its images end in.
const SOURCES: [(&str, &str); 2] = [("imagenet", "JPEG"), ("pascal", "jpg")];
/// Where VOC's masks of single objects are, from the root of the release.
const VOC_MASKS: [&str; 2] = ["PASCAL/VOCdevkit/VOC2012/SegmentationObject", "SegmentationObject"];
/// No record of an image is longer, nor the models of a class.
const RECORD_BYTES: u64 = 1 << 24;
const MODELS_BYTES: u64 = 1 << 28;

/// Pascal3D+ on disk: the objects are what is annotated in the images, one view each.
///
/// The world is that of the models: +z up, the front at -y. Boxes, flags and viewpoints are in
/// [`Pascal3d::annotation`]. Only the images of VOC's segmentation have masks; the others are
/// read with the mask source `whole` or `backdrop`. Objects in one image, `2008_000021/1` and `2008_000021/2`, are in one subset; where
/// `Image_sets` has the release's lists, those are the subsets: what they have for validation is for tests.
#[derive(Debug)]
pub struct Pascal3d {
    catalog: Catalog,
    source: Source,
    annotations: Vec<Pascal3dAnnotation>,
}

/// What Pascal3D+ says about one object in an image.
#[derive(Clone, Debug, PartialEq)]
pub struct Pascal3dAnnotation {
    /// The image, relative to the root.
    pub image: String,
    /// `aeroplane`, `bicycle`, ..
    pub class: String,
    /// Width and height of the image, pixels, where the record says them.
    pub size: Option<[usize; 2]>,
    /// The object's box: left, top, right, bottom, pixels from the image's top-left corner.
    pub bounds: [f64; 4],
    /// Which of the class's models is nearest, from 0.
    pub model: usize,
    /// Whether the image's border cuts the object.
    pub truncated: bool,
    /// Whether something hides part of the object.
    pub occluded: bool,
    /// Whether VOC calls the object difficult.
    pub difficult: bool,
    /// Where the camera is.
    pub viewpoint: Viewpoint,
    /// The visible anchor points by name, pixels from the image's top-left corner.
    pub anchors: BTreeMap<String, [f64; 2]>,
    /// The object's place in the record, from 0; VOC numbers its masks so.
    pub place: usize,
    file: PathBuf,
    field: String,
}

/// A viewpoint in the terms of Pascal3D+.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// Degrees around +z, from -y towards +x.
    pub azimuth: f64,
    /// Degrees above the model's ground.
    pub elevation: f64,
    /// Roll of the camera, degrees: the image turns counter-clockwise by it.
    pub theta: f64,
    /// Distance from the model's origin.
    pub distance: f64,
    /// Focal length; with the next it makes pixels. Always 1.
    pub focal: f64,
    /// Pixels per unit of the focal length. Always 3000.
    pub viewport: f64,
    /// Where the camera's axis meets the image, as MATLAB counts: the first pixel's centre is
    /// at (1, 1).
    pub principal: [f64; 2],
}

impl Viewpoint {
    /// The camera for an image of this size, in the world of the model.
    ///
    /// With `C = d (cos e sin a, -cos e cos a, sin e)` and
    /// `R = Rz(theta) Rx(-(90 - e)) Rz(-a)`, a point is at `R (X - C)`, x right, y up, looking
    /// along -z; the focal length is `focal * viewport` pixels.
    pub fn camera(&self, width: usize, height: usize) -> Camera {
        let about = |axis: Vector3<f64>, degrees: f64| {
            Rotation3::new(axis * degrees.to_radians()).into_inner()
        };
        let rotation = about(Vector3::z(), self.theta)
            * about(Vector3::x(), self.elevation - 90.0)
            * about(Vector3::z(), -self.azimuth);
        let f = self.focal * self.viewport;
        // MATLAB's (1, 1) is the first pixel's centre, ours is at (0.5, 0.5).
        let [cx, cy] = self.principal.map(|p| p - 0.5);
        Camera {
            rotation,
            // R C is (0, 0, d): the camera looks at the origin, and its roll leaves the axis alone.
            translation: Vector3::new(0.0, 0.0, -self.distance),
            lens: Lens::Perspective { fx: f, fy: f, cx, cy },
            width,
            height,
        }
    }

    fn read(node: &Node<'_>) -> Result<Self, ReadViewsError> {
        let number = |key: &str| node.need(key)?.number();
        let or = |key: &str, value: f64| node.get(key).map_or(Ok(value), |n| n.number());
        Ok(Self {
            azimuth: number("azimuth")?,
            elevation: number("elevation")?,
            theta: number("theta")?,
            distance: number("distance")?,
            focal: or("focal", 1.0)?,
            viewport: or("viewport", 3000.0)?,
            principal: [number("px")?, number("py")?],
        })
    }
}

impl Pascal3dAnnotation {
    /// The camera of the image, of which the record may leave the size open.
    fn camera(&self, image: &ImageFile) -> Result<Camera, ReadViewsError> {
        let [w, h] = self.size.unwrap_or([image.pixels.width, image.pixels.height]);
        fitted(self.viewpoint.camera(w, h), image, &self.file, &self.field)
    }

    fn read(
        &self,
        name: &str,
        opened: &mut Opened<'_>,
        options: &ReadOptions,
    ) -> Result<View, ReadViewsError> {
        let image = read_image_file(opened, &self.image, "image")?;
        let camera = self.camera(&image)?;
        let wanted = options.reads_mask_files();
        let mask = wanted.then(|| self.mask(opened)).transpose()?;
        assemble(name.to_owned(), image, mask.into(), camera, None, options)
    }

    /// The object's own colour in VOC's image of objects.
    fn mask(&self, opened: &mut Opened<'_>) -> Result<(PathBuf, ByteImage), ReadViewsError> {
        let source = opened.source();
        let file = Path::new(&self.image).with_extension("png");
        let name = file.file_name().and_then(|n| n.to_str()).unwrap_or_default();
        let masks = VOC_MASKS.iter().map(|folder| format!("{folder}/{name}"));
        // Images of ImageNet have none, and VOC's folder has none of theirs.
        let Some(mask) = { masks }.find(|mask| source.has(mask)) else {
            let expected = "an entry in VOC's SegmentationObject, or the mask source `whole`";
            let at = source.locate(&self.image);
            return Err(ReadViewsError::field(at, "mask", "none in Pascal3D+", expected));
        };
        let objects = read_image_file(opened, &mask, "mask")?;
        let (c, color) = (objects.pixels.channels, voc_color(self.place + 1));
        let data = objects.pixels.data.chunks_exact(c).map(|pixel| match pixel {
            // An index that a tool has written as grey.
            [gray] | [gray, _] => usize::from(*gray) == self.place + 1,
            _ => pixel[..3] == color,
        });
        let data = data.map(|inside| if inside { 255 } else { 0 }).collect();
        let (height, width) = (objects.pixels.height, objects.pixels.width);
        Ok((objects.path, ByteImage { height, width, channels: 1, data }))
    }
}

/// The colour of an object's number in VOC's images: its bits, dealt to red, green, blue in
/// turn, each from the highest bit down.
fn voc_color(number: usize) -> [u8; 3] {
    let mut color = [0u8; 3];
    for bit in 0..8 {
        for (k, channel) in color.iter_mut().enumerate() {
            *channel |= ((number >> (3 * bit + k) & 1) as u8) << (7 - bit);
        }
    }
    color
}

/// What one record gives: its annotations, and how many objects have no viewpoint.
type Record = (Vec<Pascal3dAnnotation>, usize);

fn read_record(source: &Source, folder: &str, name: &str) -> Result<Record, ReadViewsError> {
    let path = format!("{ANNOTATIONS}/{folder}/{name}");
    let file = source.locate(&path);
    let bytes = source.open()?.read(&path, "annotation", RECORD_BYTES)?;
    let mat = Mat::read(&bytes, &file)?;
    let record = mat.need("record", &file)?;
    let class = folder.rsplit_once('_').map_or(folder, |(class, _)| class);
    let size = match record.get("imgsize").filter(|n| !n.is_empty()) {
        Some(node) => {
            let [w, h, ..] = node.vector::<3>()?;
            let whole = |v: f64| (1.0..1e6).contains(&v) && v.fract() == 0.0;
            if !(whole(w) && whole(h)) {
                return Err(node.found(format!("{w}x{h}"), "width, height, channels in pixels"));
            }
            Some([w as usize, h as usize])
        }
        None => None,
    };
    let stem = name.strip_suffix(".mat").unwrap_or(name);
    let (mut out, mut without) = (Vec::new(), 0);
    for (place, object) in record.need("objects")?.elements()?.into_iter().enumerate() {
        if object.need("class")?.text()? != class {
            continue;
        }
        let viewpoint = object.get("viewpoint").filter(|n| n.get("distance").is_some());
        let viewpoint = match viewpoint.map(|node| Viewpoint::read(&node)).transpose()? {
            // Nobody has aligned a model with these, only said roughly from where they are seen.
            None | Some(Viewpoint { distance: 0.0, .. }) => {
                without += 1;
                continue;
            }
            Some(viewpoint) => viewpoint,
        };
        let [left, top, right, bottom] = object.need("bbox")?.vector()?;
        let cad = object.need("cad_index")?;
        let index = cad.number()?;
        if index < 1.0 || index.fract() != 0.0 {
            return Err(cad.found(index.to_string(), "the number of a model, from 1"));
        }
        let flag = |key: &str| object.get(key).map_or(Ok(false), |n| Ok(n.number()? != 0.0));
        out.push(Pascal3dAnnotation {
            image: image_of(source, folder, stem),
            class: class.to_owned(),
            size,
            // From MATLAB's first and last pixel to the box's edges.
            bounds: [left - 1.0, top - 1.0, right, bottom],
            model: index as usize - 1,
            truncated: flag("truncated")?,
            occluded: flag("occluded")?,
            difficult: flag("difficult")?,
            viewpoint,
            anchors: anchors(&object)?,
            place,
            file: file.clone(),
            field: format!("{}.viewpoint", object.field),
        });
    }
    Ok((out, without))
}

/// The image's name, which ends as its source has it.
fn image_of(source: &Source, folder: &str, stem: &str) -> String {
    let own = SOURCES.iter().find(|(name, _)| folder.ends_with(name)).map_or("jpg", |(_, e)| e);
    let name = |extension: &str| format!("Images/{folder}/{stem}.{extension}");
    let others = ["JPEG", "jpg", "jpeg", "png"];
    let found = [own].into_iter().chain(others).find(|extension| source.has(&name(extension)));
    name(found.unwrap_or(own))
}

fn anchors(object: &Node<'_>) -> Result<BTreeMap<String, [f64; 2]>, ReadViewsError> {
    let mut out = BTreeMap::new();
    let Some(anchors) = object.get("anchors") else { return Ok(out) };
    for key in anchors.keys() {
        let location = anchors.get(key).and_then(|anchor| anchor.get("location"));
        // What is not seen has no location.
        if let Some(location) = location.filter(|n| !n.is_empty()) {
            out.insert(key.clone(), location.vector::<2>()?.map(|v| v - 0.5));
        }
    }
    Ok(out)
}

/// What an object in an image is called: where there are several, they are views of one object for whoever deals subsets, since no image
/// may be in two.
fn object_name(stem: &str, place: Option<usize>) -> String {
    place.map_or_else(|| stem.to_owned(), |place| format!("{stem}/{}", place + 1))
}

/// The folders of annotations: `<class>_imagenet` and `<class>_pascal`.
fn folders(path: &Path) -> Vec<String> {
    let mut names = names_of(&path.join(ANNOTATIONS)).unwrap_or_default();
    names.retain(|name| {
        let source = name.rsplit_once('_').map(|(_, source)| source);
        SOURCES.iter().any(|(known, _)| source == Some(known))
    });
    names
}

impl Pascal3d {
    /// Whether the path is a folder with the annotations of Pascal3D+.
    pub(crate) fn recognises(path: &Path) -> bool {
        !folders(path).is_empty()
    }

    /// Opens the folder of the release, in which `Annotations`, `Images` and `CAD` are. All
    /// records are read and checked, in parallel; images are not.
    ///
    /// # Errors
    /// If there are no annotations, or one cannot be read; the first in their order.
    pub fn open(path: &Path) -> Result<Self, ReadViewsError> {
        let source = Source::folder(path);
        let (mut files, mut subsets) = (Vec::new(), BTreeMap::new());
        for folder in folders(path) {
            subsets.insert(folder.clone(), sets::read(&source, &folder)?);
            let at = path.join(ANNOTATIONS).join(&folder);
            let names = Source::folder(&at).root_names()?;
            let records = names.into_iter().filter(|name| name.strip_suffix(".mat").is_some());
            files.extend(records.map(|name| (folder.clone(), name)));
        }
        if files.is_empty() {
            let wanted_by = "Pascal3D+ has its records in it, in <class>_imagenet and \
                             <class>_pascal";
            return Err(ReadViewsError::missing(path.join(ANNOTATIONS), wanted_by));
        }
        let records: Vec<Result<Record, ReadViewsError>> =
            files.par_iter().map(|(folder, name)| read_record(&source, folder, name)).collect();
        let (mut entries, mut annotations, mut without) = (Vec::new(), Vec::new(), Vec::new());
        for ((folder, file), record) in files.iter().zip(records) {
            let (found, left_out) = record?;
            if left_out > 0 {
                without.push((format!("{folder}/{file}"), left_out));
            }
            let stem = file.strip_suffix(".mat").unwrap_or(file);
            let several = found.len() > 1;
            for annotation in found {
                entries.push(Entry {
                    category: annotation.class.clone(),
                    name: object_name(stem, several.then_some(annotation.place)),
                    views: 1,
                    subset: subsets.get(folder).and_then(|images| images.get(stem)).copied(),
                });
                annotations.push(annotation);
            }
        }
        let mut warnings = Vec::new();
        if let [(first, _), ..] = without.as_slice() {
            let count: usize = without.iter().map(|(_, count)| count).sum();
            warnings.push(format!(
                "{} left out: no model is aligned (distance 0), the first is in {first}",
                counted_are(count, "object")
            ));
        }
        if annotations.is_empty() {
            let found = "none with a viewpoint";
            return Err(ReadViewsError::field(path, "objects", found, "at least one"));
        }
        let catalog = Catalog { entries, warnings, ..Catalog::new(Layout::Pascal3d, path) };
        Ok(Self { catalog, source, annotations })
    }

    /// The annotation of an object.
    ///
    /// # Panics
    /// If the object does not exist.
    pub fn annotation(&self, object: usize) -> &Pascal3dAnnotation {
        &self.annotations[object]
    }

    /// A model out of `CAD/<class>.mat`.
    fn model_in_mat(&self, class: &str, index: usize) -> Result<Option<TriMesh>, ReadViewsError> {
        let name = format!("CAD/{class}.mat");
        if !self.source.has(&name) {
            return Ok(None);
        }
        let file = self.source.locate(&name);
        let mat = Mat::read(&self.source.open()?.read(&name, "models", MODELS_BYTES)?, &file)?;
        let models = mat.need(class, &file)?;
        let all = models.elements()?;
        let model = all
            .get(index)
            .ok_or_else(|| models.wrong(format!("a model of number {}", index + 1)))?;
        let (vertices, count, 3) = model.need("vertices")?.table()? else {
            return Err(model.need("vertices")?.wrong("rows of x, y, z"));
        };
        let positions =
            (0..count).map(|i| std::array::from_fn(|k| vertices.at(k * count + i) as f32));
        let mesh = TriMesh::new(positions.collect(), model.need("faces")?.triangles(count)?);
        if let Some(at) = mesh.positions.iter().position(|p| !p.iter().all(|v| v.is_finite())) {
            let found = format!("{:?}", mesh.positions[at]);
            return Err(model.need("vertices")?.found(found, "finite numbers"));
        }
        Ok(Some(mesh))
    }
}

impl Dataset for Pascal3d {
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
        let album = Album { catalog: &self.catalog, source: &self.source, poses: "viewpoint" };
        album.read_single((name, &annotation.image), which, options, progress, |opened| {
            annotation.read(name, opened, options)
        })
    }

    /// The nearest model of the class, which is not the very object: `CAD/<class>/<number>.off`,
    /// else out of `CAD/<class>.mat`.
    fn truth(&self, object: usize) -> Result<Truth, ReadViewsError> {
        let Pascal3dAnnotation { class, model: index, .. } = &self.annotations[object];
        let off = self.source.locate(&format!("CAD/{class}/{:02}.off", index + 1));
        let mesh = match model(&off)? {
            Some(mesh) => Some(mesh),
            None => self.model_in_mat(class, *index)?,
        };
        Ok(Truth { mesh, ..Truth::default() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_in_one_image_are_dealt_together() {
        let entry = |name: String| Entry { name, category: "car".into(), ..Entry::default() };
        let [first, second] = [0, 1].map(|place| entry(object_name("2008_000021", Some(place))));
        assert_ne!(first.name, second.name);
        assert_eq!(first.object(), second.object());
        assert_eq!(entry(object_name("2008_000021", None)).object(), first.object());
    }
}
