//! COLMAP's sparse model with its images, of any version up to 4.

mod binary;
mod model;
mod rig;
mod text;
mod write;

use std::path::{Path, PathBuf};

use mesh_core::DepthMap;

use crate::assemble::{IMAGE_BYTES, assemble, camera_of_size, read_image_file, without_extension};
use crate::dataset::{Catalog, Dataset};
use crate::error::ReadViewsError;
use crate::layouts::single::SingleObject;
use crate::mask_file::{mask_file, mask_names};
use crate::natural;
use crate::options::ReadOptions;
use crate::read::Reading;
use crate::source::{Opened, Source};
use crate::undistort::{Lenses, straightened};
use crate::view::{Layout, View, Views};

pub use model::ColmapPoint;
pub use write::{ColmapForm, write_colmap};

use model::{Model, ModelImage, robust_bounds};
use rig::Rigs;

/// The first model of the mapper.
const FIRST: &str = "sparse/0/";
/// Models of tens of thousands of images fit.
const MODEL_BYTES: u64 = 1 << 33;

/// A sparse model and where its files are.
#[derive(Debug)]
pub(crate) struct Project {
    /// The folder of the model, with its slash: `sparse/0/`, `sparse/`, or nothing.
    folder: String,
    form: ColmapForm,
    /// The folder that `images/` and `masks/` are in, with its slash, or nothing.
    base: String,
    /// The folder of the images, with its slash.
    images: String,
    model: Model,
    /// Another model of more images, its folder and how many.
    larger: Option<(String, usize)>,
    /// Images whose own pose is not that of their frame and rig.
    moved: usize,
}

/// Where the model is, its form, and in which folders its images may be.
type Found = (&'static str, ColmapForm);

/// The model among the files of a source: binary before text, as COLMAP does.
pub(crate) fn recognises(source: &Source) -> Option<Found> {
    [FIRST, "sparse/", ""].into_iter().find_map(|folder| {
        [ColmapForm::Binary, ColmapForm::Text].into_iter().find_map(|form| {
            let has = |noun: &str| source.has(&format!("{folder}{noun}.{}", form.extension()));
            (has("cameras") && has("images")).then_some((folder, form))
        })
    })
}

impl Project {
    /// Reads cameras and images; the points wait until they are asked for.
    pub(crate) fn read(source: &Source, (folder, form): Found) -> Result<Self, ReadViewsError> {
        let mut opened = source.open()?;
        let mut model = Model::default();
        for noun in ["cameras", "images"] {
            let name = format!("{folder}{noun}.{}", form.extension());
            let path = source.locate(&name);
            let bytes = opened.read(&name, noun, MODEL_BYTES)?;
            match (noun, form) {
                ("cameras", ColmapForm::Binary) => binary::cameras(&bytes, &path, &mut model)?,
                ("cameras", ColmapForm::Text) => text::cameras(&bytes, &path, &mut model)?,
                (_, ColmapForm::Binary) => binary::images(&bytes, &path, &mut model)?,
                (_, ColmapForm::Text) => text::images(&bytes, &path, &mut model)?,
            }
        }
        let moved = place(&mut opened, (folder, form), &mut model)?;
        model.images.sort_by(|a, b| natural::compare(&a.name, &b.name));
        let (base, images) = images(source, folder, &model);
        let larger = larger(&mut opened, folder, model.images.len());
        Ok(Self { folder: folder.to_owned(), form, base, images, model, larger, moved })
    }

    fn file(&self, source: &Source, noun: &str) -> PathBuf {
        source.locate(&format!("{}{noun}.{}", self.folder, self.form.extension()))
    }

    /// The views, in the natural order of the images' names.
    pub(crate) fn list<'a>(
        &'a self,
        source: &'a Source,
        options: &'a ReadOptions,
    ) -> Result<Reading<'a>, ReadViewsError> {
        let mut reading = Reading::new(Layout::Colmap, "QW QX QY QZ TX TY TZ");
        let mut lenses = Lenses::default();
        for image in &self.model.images {
            let name = format!("{}{}", self.images, image.name);
            let found = source.need(&name, || {
                format!("image {} of {} names it", image.id, self.file(source, "images").display())
            });
            if let Some(lens) = self.model.distorted(image).filter(|_| found.is_ok()) {
                lenses.count(lens);
            }
            reading.add(without_extension(&image.name), found, options, move |(), opened| {
                self.read_view(opened, image, &name, options)
            })?;
        }
        reading.warnings.extend(lenses.sentence(options));
        if let Some((folder, count)) = &self.larger {
            reading.warnings.push(format!(
                "{folder} has a model of {count} images, {} of {}: to read that one, open its folder",
                self.folder.trim_end_matches('/'),
                self.model.images.len()
            ));
        }
        if self.moved > 0 {
            let extension = self.form.extension();
            reading.warnings.push(format!(
                "rigs.{extension} and frames.{extension} place {} of {} images elsewhere than images.{extension} does; \
                 as for COLMAP, theirs are the poses",
                self.moved,
                self.model.images.len()
            ));
        }
        Ok(reading)
    }

    fn read_view(
        &self,
        opened: &mut Opened<'_>,
        image: &ModelImage,
        name: &str,
        options: &ReadOptions,
    ) -> Result<View, ReadViewsError> {
        let source = opened.source();
        let files = [self.file(source, "cameras"), self.file(source, "images")];
        let (camera, distortion) = self.model.camera(image, [&files[0], &files[1]])?;
        let file = read_image_file(opened, name, "image")?;
        let field = format!("camera {} WIDTH, HEIGHT", image.camera);
        let camera = camera_of_size(camera, &file, &files[0], &field)?;
        let stem = without_extension(&image.name);
        let masks = mask_names(&format!("{}masks", self.base), &image.name);
        let mask = mask_file(opened, &masks, options)?;
        let depth = if options.depth { self.depth(opened, image)? } else { None };
        let view = assemble(stem.to_owned(), file, mask, camera, depth, options)?;
        let field = format!("camera {} MODEL, {}", image.camera, image.name);
        straightened(view, distortion.as_ref(), options, (&files[0], &field))
    }

    /// COLMAP's own dense depth, where it has been computed.
    fn depth(
        &self,
        opened: &mut Opened<'_>,
        image: &ModelImage,
    ) -> Result<Option<(PathBuf, DepthMap)>, ReadViewsError> {
        let names = ["geometric", "photometric"]
            .map(|kind| format!("{}stereo/depth_maps/{}.{kind}.bin", self.base, image.name));
        let source = opened.source();
        let Some(name) = names.iter().find(|name| source.has(name)) else { return Ok(None) };
        let path = source.locate(name);
        let bytes = opened.read(name, "depth", IMAGE_BYTES)?;
        let depth = depth_map(&bytes).ok_or_else(|| {
            let found = format!("{} bytes that begin otherwise", bytes.len());
            let expected = "WIDTH&HEIGHT&1& and as many 32-bit floats";
            ReadViewsError::field(&path, "depth", found, expected)
        })?;
        Ok(Some((path, depth)))
    }
}

/// The folder beside `sparse/0` whose model has most images, where that is more than `own`, and how many: the mapper begins
/// a new one where images do not join, and the first need not be the largest.
fn larger(opened: &mut Opened<'_>, folder: &str, own: usize) -> Option<(String, usize)> {
    const MOST: usize = 100;
    let source = opened.source();
    let mut found = (folder == FIRST).then(|| (String::new(), own))?;
    for place in (1..MOST).map(|k| format!("sparse/{k}")) {
        let forms = [ColmapForm::Binary, ColmapForm::Text];
        let name = |form: ColmapForm| format!("{place}/images.{}", form.extension());
        let Some(form) = forms.into_iter().find(|form| source.has(&name(*form))) else { break };
        // What is wrong with a model that is not read does not matter.
        let Ok(bytes) = opened.read(&name(form), "images", MODEL_BYTES) else { continue };
        let (mut model, path) = (Model::default(), source.locate(&name(form)));
        let read = match form {
            ColmapForm::Binary => binary::images(&bytes, &path, &mut model),
            ColmapForm::Text => text::images(&bytes, &path, &mut model),
        };
        if read.is_ok() && model.images.len() > found.1 {
            found = (place, model.images.len());
        }
    }
    (found.1 > own).then_some(found)
}

/// Places the images as rigs and frames say, where the model has files of both; how many had another pose.
fn place(
    opened: &mut Opened<'_>,
    (folder, form): Found,
    model: &mut Model,
) -> Result<usize, ReadViewsError> {
    let source = opened.source();
    let names = ["rigs", "frames"].map(|noun| format!("{folder}{noun}.{}", form.extension()));
    if !names.iter().all(|name| source.has(name)) {
        return Ok(0);
    }
    let mut rigs = Rigs::default();
    let files = [source.locate(&names[0]), source.locate(&names[1])];
    let bytes = opened.read(&names[0], "rigs", MODEL_BYTES)?;
    match form {
        ColmapForm::Binary => binary::rigs(&bytes, &files[0], &mut rigs)?,
        ColmapForm::Text => text::rigs(&bytes, &files[0], &mut rigs)?,
    }
    let bytes = opened.read(&names[1], "frames", MODEL_BYTES)?;
    match form {
        ColmapForm::Binary => binary::frames(&bytes, &files[1], &mut rigs)?,
        ColmapForm::Text => text::frames(&bytes, &files[1], &mut rigs)?,
    }
    rigs.place(&mut model.images, &files[1])
}

/// A depth map of COLMAP's: `W&H&1&` and floats by rows; what is not above zero is a hole.
fn depth_map(bytes: &[u8]) -> Option<DepthMap> {
    let mut rest = bytes;
    let mut numbers = [0usize; 3];
    for number in &mut numbers {
        let end = rest.iter().take(12).position(|&b| b == b'&')?;
        *number = std::str::from_utf8(&rest[..end]).ok()?.parse().ok()?;
        rest = &rest[end + 1..];
    }
    let [width, height, channels] = numbers;
    let count = width.checked_mul(height)?.checked_mul(4)?;
    if channels != 1 || count == 0 || rest.len() != count {
        return None;
    }
    let depth = |b: &[u8]| f32::from_le_bytes([b[0], b[1], b[2], b[3]]);
    let data = rest
        .chunks_exact(4)
        .map(depth)
        .map(|d| if d > 0.0 && d < 1e9 { d } else { f32::INFINITY })
        .collect();
    Some(DepthMap { height, width, data })
}

/// The folder with `images/` and `masks/`, and that of the images, each with its slash.
///
/// Where the folder of the model itself was opened, the images are above it.
fn images(source: &Source, folder: &str, model: &Model) -> (String, String) {
    let bases: &[&str] = if folder.is_empty() { &["", "../", "../../"] } else { &[""] };
    let first = model.images.first().map_or("", |image| image.name.as_str());
    let candidates = || bases.iter().flat_map(|base| [(base, "images/"), (base, "")]);
    let found = candidates().find(|(base, images)| source.has(&format!("{base}{images}{first}")));
    let (base, images) = found.unwrap_or((&"", "images/"));
    ((*base).to_owned(), format!("{base}{images}"))
}

/// A COLMAP project: a sparse model with its images, as a dataset of one object.
///
/// Views are those of [`crate::read_views`]; this type also offers the sparse points, which have
/// no normals and so are not a [`crate::Truth`]. In a reconstruction of a scene they are on the
/// whole scene, not only on the object.
#[derive(Debug)]
pub struct Colmap {
    single: SingleObject,
}

impl Colmap {
    /// Opens a folder or zip with `sparse/0/`, `sparse/`, or the model's own files.
    ///
    /// # Errors
    /// If there is no model, or its cameras or images are damaged.
    pub fn open(path: &Path) -> Result<Self, ReadViewsError> {
        match SingleObject::find(path, &ReadOptions::default())? {
            Some(single) if single.colmap().is_some() => Ok(Self { single }),
            _ => {
                let wanted_by = "a COLMAP model is cameras and images, .bin or .txt";
                Err(ReadViewsError::missing(path, wanted_by))
            }
        }
    }

    /// The sparse points, none where the model has no file of them.
    ///
    /// # Errors
    /// If the file of points is damaged.
    pub fn points(&self) -> Result<Vec<ColmapPoint>, ReadViewsError> {
        let (source, project) = self.single.colmap().expect("checked when it was opened");
        let name = format!("{}points3D.{}", project.folder, project.form.extension());
        if !source.has(&name) {
            return Ok(Vec::new());
        }
        let bytes = source.open()?.read(&name, "points3D", MODEL_BYTES)?;
        let path = source.locate(&name);
        match project.form {
            ColmapForm::Binary => binary::points(&bytes, &path),
            ColmapForm::Text => text::points(&bytes, &path),
        }
    }

    /// The box of the sparse points without their strays, low and high; `None` without points.
    ///
    /// # Errors
    /// If the file of points is damaged.
    pub fn bounds(&self) -> Result<Option<[[f64; 3]; 2]>, ReadViewsError> {
        Ok(robust_bounds(&self.points()?))
    }
}

impl Dataset for Colmap {
    fn catalog(&self) -> &Catalog {
        self.single.catalog()
    }

    fn views(
        &self,
        object: usize,
        which: Option<&[usize]>,
        options: &ReadOptions,
        progress: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<Views, ReadViewsError> {
        self.single.views(object, which, options, progress)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn depth_maps_are_rows_of_floats_behind_their_size() {
        let mut bytes = b"3&2&1&".to_vec();
        for d in [1.5f32, 0.0, -1.0, 2.0, f32::NAN, 7.25] {
            bytes.extend_from_slice(&d.to_le_bytes());
        }
        let hole = f32::INFINITY;
        let depth = depth_map(&bytes).unwrap();
        assert_eq!((depth.height, depth.width), (2, 3));
        assert_eq!(depth.data, [1.5, hole, hole, 2.0, hole, 7.25]);
        for end in 0..bytes.len() {
            assert_eq!(depth_map(&bytes[..end]), None);
        }
        assert_eq!(depth_map(b"99999999999&99999999999&1&"), None);
        assert_eq!(depth_map(b"18446744073709551615&2&1&"), None);
    }
}
