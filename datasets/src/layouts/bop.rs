//! Scenes of the BOP benchmarks, which BlenderProc's `BopWriter` also writes.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use mesh_core::{Camera, DepthMap, decode_depth_png_with};

use crate::assemble::{IMAGE_BYTES, ImageFile, assemble, read_image_file};
use crate::counted::counted_are;
use crate::dataset::{Catalog, Dataset, Entry, Subset, Truth};
use crate::error::ReadViewsError;
use crate::formats::json::{Node, parse};
use crate::layouts::album::{chosen, model};
use crate::mask_file::mask_file;
use crate::options::ReadOptions;
use crate::read::{Reading, read_pending};
use crate::source::{Opened, Source, names_of};
use crate::view::{Layout, View, Views};

const CAMERAS: &str = "scene_camera.json";
const POSES: &str = "scene_gt.json";
const INFO: &str = "scene_gt_info.json";
/// Scenes of thousands of images with dozens of objects fit.
const JSON_BYTES: u64 = 1 << 30;
/// The benchmarks do not ask for an object of which less than this share is seen.
const LEAST_VISIBLE: f64 = 0.1;
const IMAGE_EXTENSIONS: [&str; 4] = ["png", "jpg", "jpeg", "JPG"];

/// A BOP dataset, split or scene: every object of every split, with all images that show it.
///
/// The world of an object's views is the frame of its model, in millimetres, so that all images
/// of it fit together whatever scene they are from. Entries are named by `obj_id`, their category
/// is the split. An image that shows two instances is two views. Masks are `mask_visib`, what is
/// seen of the object and not what hides it; instances of which less than a tenth is seen are
/// left out. Principal points count from the centre of the first pixel, as OpenCV's do.
#[derive(Debug)]
pub struct Bop {
    catalog: Catalog,
    source: Source,
    /// For each entry its views.
    shots: Vec<Vec<Shot>>,
    /// The folder with the models.
    models: Option<PathBuf>,
}

/// One instance of an object in one image.
#[derive(Debug)]
struct Shot {
    /// The folder of the scene, with its slash, from the path that was opened.
    scene: String,
    image: u64,
    /// Where the instance stands in the image's list, which names its mask.
    instance: usize,
    /// What the view is called.
    name: String,
    intrinsics: [f64; 9],
    /// Millimetres for each unit of the depth file.
    depth_scale: f64,
    rotation: [f64; 9],
    translation: [f64; 3],
}

/// Whether the folder is a scene, a split or a dataset, or holds BlenderProc's containers.
pub(crate) fn recognises(path: &Path) -> bool {
    !scenes(path).is_empty() || container(path).is_some()
}

/// The folders of scenes at the path or up to two levels below, with their split.
fn scenes(path: &Path) -> Vec<(String, String)> {
    let has = |folder: &str| path.join(folder).join(CAMERAS).is_file();
    if has("") {
        return vec![(String::new(), String::new())];
    }
    let mut found = Vec::new();
    for outer in folders(path) {
        if has(&outer) {
            found.push((String::new(), format!("{outer}/")));
            continue;
        }
        for inner in folders(&path.join(&outer)) {
            if has(&format!("{outer}/{inner}")) {
                found.push((outer.clone(), format!("{outer}/{inner}/")));
            }
        }
    }
    found
}

/// Names of the folders in a folder, sorted.
fn folders(path: &Path) -> Vec<String> {
    let mut names = names_of(path).unwrap_or_default();
    names.retain(|name| path.join(name).is_dir());
    names
}

/// The first of BlenderProc's containers in the folder.
fn container(path: &Path) -> Option<PathBuf> {
    let names = Source::folder(path).root_names().ok()?;
    names
        .iter()
        .find(|name| Path::new(name).extension().is_some_and(|e| e == "hdf5"))
        .map(|name| path.join(name))
}

/// The refusal of BlenderProc's other format.
pub(crate) fn no_hdf5(path: &Path) -> ReadViewsError {
    let expected = "a BOP scene: let BlenderProc write one, `bproc.writer.write_bop(..)` in place \
                    of `bproc.writer.write_hdf5(..)`";
    ReadViewsError::field(path, "container", "HDF5, which is not read", expected)
}

impl Bop {
    /// Opens a dataset (`train/000001/scene_camera.json`), a split, or a single scene.
    ///
    /// # Errors
    /// If a scene's JSON is damaged, or no image shows any object.
    pub fn open(path: &Path) -> Result<Self, ReadViewsError> {
        let scenes = scenes(path);
        if scenes.is_empty() {
            if let Some(container) = container(path) {
                return Err(no_hdf5(&container));
            }
            return Err(ReadViewsError::missing(path.join(CAMERAS), "a BOP scene has one"));
        }
        let source = Source::folder(path);
        let mut warnings = Vec::new();
        let mut objects: BTreeMap<(String, u64), Vec<Shot>> = BTreeMap::new();
        let several = scenes.len() > 1;
        for (split, scene) in scenes {
            read_scene(&source, &split, &scene, several, &mut objects, &mut warnings)?;
        }
        if objects.is_empty() {
            let expected = "at least one object in one image";
            return Err(ReadViewsError::field(path.join(POSES), "obj_id", "none", expected));
        }
        let (mut entries, mut shots) = (Vec::new(), Vec::new());
        for ((split, object), views) in objects {
            let subset = subset_of(if split.is_empty() { folder_name(path) } else { &split });
            let (name, views_count) = (object.to_string(), views.len());
            entries.push(Entry { category: split, name, views: views_count, subset });
            shots.push(views);
        }
        let models = ["", "..", "../.."]
            .iter()
            .flat_map(|up| ["models", "models_cad", "models_eval"].map(|m| path.join(up).join(m)))
            .find(|folder| folder.is_dir());
        let catalog = Catalog { entries, warnings, ..Catalog::new(Layout::Bop, path) };
        Ok(Self { catalog, source, shots, models })
    }
}

fn folder_name(path: &Path) -> &str {
    path.file_name().and_then(|name| name.to_str()).unwrap_or_default()
}

/// What a split is for, by its name: `train_pbr`, `val`, `test_primesense`.
fn subset_of(split: &str) -> Option<Subset> {
    let mut names = Subset::NAMES.into_iter();
    names.find(|(name, _)| split.starts_with(name)).map(|(_, subset)| subset)
}

fn read_scene(
    source: &Source,
    split: &str,
    scene: &str,
    several: bool,
    objects: &mut BTreeMap<(String, u64), Vec<Shot>>,
    warnings: &mut Vec<String>,
) -> Result<(), ReadViewsError> {
    let mut opened = source.open()?;
    let mut json = |noun: &str| -> Result<_, ReadViewsError> {
        let name = format!("{scene}{noun}");
        let path = source.locate(&name);
        let value = parse(&opened.read(&name, noun, JSON_BYTES)?, &path)?;
        Ok((path, value))
    };
    let (camera_path, cameras) = json(CAMERAS)?;
    let (pose_path, poses) = json(POSES)?;
    let info = if source.has(&format!("{scene}{INFO}")) { Some(json(INFO)?) } else { None };
    let cameras = Node::root(&cameras, &camera_path);
    let mut images = Vec::new();
    for (key, list) in Node::root(&poses, &pose_path).members()? {
        let image: u64 =
            key.parse().map_err(|_| list.wrong("an image's number as the key of its list"))?;
        images.push((image, key, list));
    }
    images.sort_by_key(|&(image, ..)| image);
    let mut hidden = 0;
    for (image, key, list) in images {
        let camera = cameras.need(key)?;
        let intrinsics = camera.need("cam_K")?.numbers::<9>()?;
        let depth_scale = camera.get("depth_scale").map_or(Ok(1.0), |node| node.positive())?;
        let info = info.as_ref().and_then(|(path, info)| Node::root(info, path).get(key));
        let info = info.map(|list| list.elements()).transpose()?;
        let instances = list.elements()?;
        let mut ids = Vec::with_capacity(instances.len());
        for node in &instances {
            ids.push(whole(&node.need("obj_id")?)?);
        }
        for (instance, node) in instances.iter().enumerate() {
            let seen = info.as_ref().and_then(|info| info.get(instance)?.get("visib_fract"));
            if seen.map_or(Ok(1.0), |node| node.number())? < LEAST_VISIBLE {
                hidden += 1;
                continue;
            }
            let prefix = if several { scene } else { "" };
            let twins = ids.iter().filter(|&&id| id == ids[instance]).count() > 1;
            let suffix = if twins { format!("_{instance:06}") } else { String::new() };
            objects.entry((split.to_owned(), ids[instance])).or_default().push(Shot {
                scene: scene.to_owned(),
                image,
                instance,
                name: format!("{prefix}{image:06}{suffix}"),
                intrinsics,
                depth_scale,
                rotation: node.need("cam_R_m2c")?.numbers::<9>()?,
                translation: node.need("cam_t_m2c")?.numbers::<3>()?,
            });
        }
    }
    if hidden > 0 {
        warnings.push(format!(
            "{} left out in {}: less than a tenth of each is seen",
            counted_are(hidden, "instance"),
            source.locate(scene).display()
        ));
    }
    Ok(())
}

/// A whole number that is not negative.
fn whole(node: &Node<'_>) -> Result<u64, ReadViewsError> {
    let value = node.number()?;
    if value >= 0.0 && value.fract() == 0.0 && value < 1e15 {
        Ok(value as u64)
    } else {
        Err(node.wrong("a whole number"))
    }
}

impl Shot {
    /// The image among `rgb` and `gray`.
    fn image(&self, source: &Source) -> Result<String, ReadViewsError> {
        let names = ["rgb", "gray"].iter().flat_map(|folder| {
            IMAGE_EXTENSIONS.map(|end| format!("{}{folder}/{:06}.{end}", self.scene, self.image))
        });
        let mut names = names.peekable();
        let first = names.peek().cloned().unwrap_or_default();
        names.find(|name| source.has(name)).ok_or_else(|| {
            let wanted_by = format!(
                "image {} of {}{POSES} is kept there, or in gray, as PNG or JPEG",
                self.image, self.scene
            );
            ReadViewsError::missing_view(source.locate(&first), wanted_by)
        })
    }

    fn read(
        &self,
        opened: &mut Opened<'_>,
        image: &str,
        options: &ReadOptions,
    ) -> Result<View, ReadViewsError> {
        let image = read_image_file(opened, image, "image")?;
        let camera = self.camera(opened.source(), &image)?;
        let masks = ["mask_visib", "mask"].map(|folder| {
            format!("{}{folder}/{:06}_{:06}.png", self.scene, self.image, self.instance)
        });
        let mask = mask_file(opened, &masks, options)?;
        let depth = if options.depth { self.depth(opened)? } else { None };
        assemble(self.name.clone(), image, mask, camera, depth, options)
    }

    fn camera(&self, source: &Source, image: &ImageFile) -> Result<Camera, ReadViewsError> {
        let rows = |m: &[f64; 9]| [[m[0], m[1], m[2]], [m[3], m[4], m[5]], [m[6], m[7], m[8]]];
        let mut k = rows(&self.intrinsics);
        // From the centre of the first pixel to its corner.
        k[0][2] += 0.5;
        k[1][2] += 0.5;
        let fails = |file: &str, field: String| {
            ReadViewsError::camera(source.locate(&format!("{}{file}", self.scene)), field)
        };
        let (width, height) = (image.pixels.width, image.pixels.height);
        let camera = Camera::from_opencv(rows(&self.rotation), self.translation, k, width, height)
            .map_err(fails(CAMERAS, format!("{}.cam_K", self.image)))?;
        let field = format!("{}[{}].cam_R_m2c, cam_t_m2c", self.image, self.instance);
        camera.validate().map_err(fails(POSES, field))?;
        Ok(camera)
    }

    fn depth(
        &self,
        opened: &mut Opened<'_>,
    ) -> Result<Option<(PathBuf, DepthMap)>, ReadViewsError> {
        let source = opened.source();
        let name = format!("{}depth/{:06}.png", self.scene, self.image);
        if !source.has(&name) {
            return Ok(None);
        }
        let path = source.locate(&name);
        let bytes = opened.read(&name, "depth", IMAGE_BYTES)?;
        let unit = self.depth_scale as f32;
        let depth = decode_depth_png_with(&bytes, &path, unit, opened.limits())
            .map_err(|error| ReadViewsError::new(&path, error))?;
        Ok(Some((path, depth)))
    }
}

impl Dataset for Bop {
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
        let mut reading = Reading::new(Layout::Bop, "cam_R_m2c, cam_t_m2c");
        let shots = &self.shots[object];
        for shot in chosen(shots.len(), which).into_iter().map(|i| &shots[i]) {
            let image = shot.image(&self.source);
            reading.add(&shot.name, image, options, move |image, opened| {
                shot.read(opened, image, options)
            })?;
        }
        read_pending(&self.catalog.root, &self.source, reading, options, progress)
    }

    /// The model, in millimetres.
    fn truth(&self, object: usize) -> Result<Truth, ReadViewsError> {
        let id: u64 = self.catalog.entries[object].name.parse().unwrap_or(0);
        let Some(models) = &self.models else { return Ok(Truth::default()) };
        let mesh = model(&models.join(format!("obj_{id:06}.ply")))?;
        Ok(Truth { mesh, ..Truth::default() })
    }
}
