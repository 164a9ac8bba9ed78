//! Pixel2Mesh's training samples (`.dat`) and its ellipsoid (`info_ellipsoid.dat`).
//!
//! A sample is a pickle, as Python 2 wrote it: in the original an array `[N, 6]` of points and
//! normals, with the image in a `.png` of the same name; in the PyTorch ports a list of the
//! image, bytes `[H, W, 3]` over white, and that array. Points are in the camera's frame (x right,
//! y up, looking along -z), of the object times [`SCALE`], which brings its distance from 1.75 times
//! the metadata's ratio to the ratio. [`Sample`] has them as they are in the file; as truth they are
//! in ShapeNet's own lengths, as those of every other layout. So every sample is an entry of its own,
//! `<model>/<view>`, with one view whose camera stands at the origin.
//!
//! Where an image has no alpha the mask is what is not white. Some ports keep the channels in
//! the order of OpenCV, which no file says.

mod ellipsoid;
mod sample;

use std::path::{Component, Path, PathBuf};

use mesh_core::{ByteImage, Camera, nalgebra::Matrix3, nalgebra::Vector3};

pub use ellipsoid::{Ellipsoid, EllipsoidLevel, Support};
pub use sample::{Sample, read_sample, write_sample};

use crate::assemble::{ImageFile, assemble, read_image_file};
use crate::backdrop::mask_from_backdrop;
use crate::content::{cut, numbered};
use crate::dataset::{Catalog, Dataset, Entry, Truth};
use crate::error::ReadViewsError;
use crate::layouts::r2n2::R2n2Lens;
use crate::mask::mask_from_alpha;
use crate::options::{MaskSource, ReadOptions};
use crate::read::{Pending, Reading, read_pending};
use crate::source::Source;
use crate::view::{Layout, Views};

/// What the points of samples are ShapeNet's lengths times (Pixel2Mesh, `3_camera_transform.py`).
pub const SCALE: f64 = 0.57;
/// No list of samples is longer than this: the published ones have some 5 MB.
const LIST_BYTES: u64 = 1 << 28;
/// What a line of a list takes: a path and an entry, and both again while their lists grow.
const ENTRY: usize = 400;

/// Pixel2Mesh's samples: a list of them, a folder of them, or one.
#[derive(Clone, Debug)]
pub struct Pixel2Mesh {
    catalog: Catalog,
    files: Vec<PathBuf>,
    lens: R2n2Lens,
}

impl Pixel2Mesh {
    /// Lists samples: a text file with the name of a `.dat` a line (in its folder, the one above,
    /// or `data_tf` or `data` there), a folder with `.dat` files, or one such file.
    ///
    /// # Errors
    /// Where there is none, or a line of a list is not a name of one below its folder.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, ReadViewsError> {
        let path = path.as_ref();
        let metadata = std::fs::metadata(path).map_err(|e| ReadViewsError::new(path, e))?;
        let files = if metadata.is_dir() {
            let mut names = Source::folder(path).root_names()?;
            names.retain(|name| is_sample(name) && name != ellipsoid::FILE);
            names.into_iter().map(|name| path.join(name)).collect()
        } else if path.file_name().is_some_and(|n| is_sample(&n.to_string_lossy())) {
            vec![path.to_owned()]
        } else {
            listed(path)?
        };
        if files.is_empty() {
            return Err(ReadViewsError::field(path, "samples", "none", "files that end in .dat"));
        }
        let entries = files.iter().map(|file| entry(file)).collect();
        let catalog = Catalog { entries, ..Catalog::new(Layout::Pixel2Mesh, path) };
        Ok(Self { catalog, files, lens: R2n2Lens::default() })
    }

    /// The same samples seen through another lens: [`R2n2Lens::Pixel2Mesh250`] is that of the
    /// original, [`R2n2Lens::Pixel2Mesh248`] that of the ports. The default is the true one.
    #[must_use]
    pub fn with_lens(self, lens: R2n2Lens) -> Self {
        Self { lens, ..self }
    }

    /// The sample as it is in the file.
    ///
    /// # Errors
    /// If the file cannot be read or is not a sample.
    /// # Panics
    /// If the object does not exist.
    pub fn sample(&self, object: usize) -> Result<Sample, ReadViewsError> {
        read_sample(&self.files[object])
    }
}

/// Whether this is a folder of samples, or one of them.
pub(crate) fn recognises(path: &Path) -> bool {
    let named = |path: &Path| {
        path.file_name()
            .map(|n| n.to_string_lossy())
            .is_some_and(|n| is_sample(&n) && n != ellipsoid::FILE)
    };
    let mut entries = std::fs::read_dir(path).into_iter().flatten().flatten();
    (path.is_file() && named(path)) || entries.any(|entry| named(&entry.path()))
}

fn is_sample(name: &str) -> bool {
    Path::new(name).extension().is_some_and(|extension| extension == "dat")
}

/// The files that a list names.
fn listed(path: &Path) -> Result<Vec<PathBuf>, ReadViewsError> {
    let folder = path.parent().unwrap_or_else(|| Path::new(""));
    let source = Source::folder(folder);
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let bytes = source.open()?.read(&name, "list of samples", LIST_BYTES)?;
    // Places are made of the names of folders, which may be longer than a line.
    let each = ENTRY + 4 * folder.as_os_str().len();
    let above = folder.join("..");
    let places = [folder.to_owned(), above.join("data_tf"), above.join("data"), above];
    let mut files = Vec::new();
    for (i, line) in numbered(&bytes.text(each, path)?) {
        // A list may not reach for other files of the machine.
        let below = Path::new(line)
            .components()
            .all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
        if !is_sample(line) || !below {
            let expected = "the name of a .dat below the list's folder";
            return Err(ReadViewsError::field(path, format!("line {i}"), cut(line), expected));
        }
        let there = places.iter().map(|place| place.join(line)).find(|file| file.is_file());
        files.push(there.unwrap_or_else(|| folder.join(line)));
    }
    Ok(files)
}

/// `<synset>_<model>_<view>.dat`, or `<synset>/<model>/rendering/<view>.dat`.
fn entry(file: &Path) -> Entry {
    let text = |path: Option<&Path>| {
        path.and_then(Path::file_name).map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
    };
    let stem = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let folder = file.parent();
    let (category, name) = if text(folder) == "rendering" {
        let model = folder.and_then(Path::parent);
        (text(model.and_then(Path::parent)), format!("{}/{stem}", text(model)))
    } else {
        let parts: Vec<&str> = stem.split('_').collect();
        match parts.as_slice() {
            [synset, model @ .., view] if !model.is_empty() => {
                ((*synset).to_owned(), format!("{}/{view}", model.join("_")))
            }
            _ => (String::new(), stem),
        }
    };
    Entry { category, name, views: 1, subset: None }
}

impl Dataset for Pixel2Mesh {
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
        let file = &self.files[object];
        let folder = file.parent().unwrap_or_else(|| Path::new(""));
        let source = Source::folder(folder);
        let mut pending: Vec<Pending<'_>> = Vec::new();
        for &view in which.unwrap_or(&[0]) {
            assert!(view == 0, "views: view {view} of a sample, which has one");
            let name = self.catalog.entries[object].name.as_str();
            let name = name.rsplit('/').next().unwrap_or(name);
            pending.push(Pending::new(name, move |opened| {
                let image = if let Some(pixels) = read_sample(file)?.picture {
                    ImageFile::new(file.clone(), pixels)
                } else {
                    let png = file.with_extension("png");
                    let name = png.file_name().unwrap_or_default().to_string_lossy().into_owned();
                    read_image_file(opened, &name, "image of the sample")?
                };
                let (width, height) = (image.pixels.width, image.pixels.height);
                let camera = Camera {
                    rotation: Matrix3::identity(),
                    translation: Vector3::zeros(),
                    lens: self.lens.intrinsics(25.0, width, height),
                    width,
                    height,
                };
                let auto = options.mask == MaskSource::Auto;
                let mask = (auto && mask_from_alpha(&image.pixels).is_none())
                    .then(|| (file.clone(), not_white(&image.pixels)));
                assemble(name.to_owned(), image, mask.into(), camera, None, options)
            }));
        }
        let (layout, warnings, poses) = (Layout::Pixel2Mesh, Vec::new(), "points");
        read_pending(
            file,
            &source,
            Reading { pending, warnings, ..Reading::new(layout, poses) },
            options,
            progress,
        )
    }

    fn truth(&self, object: usize) -> Result<Truth, ReadViewsError> {
        let mut points = self.sample(object)?.points;
        for p in &mut points.positions {
            *p = p.map(|x| (f64::from(x) / SCALE) as f32);
        }
        Ok(Truth { points: Some(points), ..Truth::default() })
    }
}

fn not_white(image: &ByteImage) -> ByteImage {
    mask_from_backdrop(&image.to_rgb(), Some([255; 3]), 2)
}
