//! Loose photographs with a `cameras.json` of ours.

use std::collections::BTreeMap;
use std::path::Path;

use mesh_core::nalgebra::{Matrix3, Vector3};
use mesh_core::{Camera, Lens};
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::assemble::{
    assemble, camera_of_size, put, put_images, read_image_file, without_extension,
};
use crate::depth::{self, Unit};
use crate::error::{ReadViewsError, WriteViewsError};
use crate::formats::json::{Node, parse};
use crate::mask_file::{mask_file, mask_names};
use crate::options::ReadOptions;
use crate::read::Reading;
use crate::source::{Opened, Source};
use crate::view::{Layout, View};

pub(crate) const CAMERAS: &str = "cameras.json";
const FORMAT: &str = "unsphere-cameras";
/// Hundreds of thousands of views fit.
const JSON_BYTES: u64 = 1 << 28;

/// What each part of the file may have.
const FILE: &[&str] = &["format", "version", "views"];
const VIEW: &[&str] =
    &["image", "mask", "depth", "width", "height", "rotation", "translation", "lens"];
const LENS: &[&str] = &["perspective", "orthographic"];
const PERSPECTIVE: &[&str] = &["fx", "fy", "cx", "cy"];
const ORTHOGRAPHIC: &[&str] = &["sx", "sy", "cx", "cy"];
/// No more unknown fields are named.
const MOST_UNKNOWN: usize = 8;

/// Whether the source has our cameras.
pub(crate) fn recognises(source: &Source) -> bool {
    source.has(CAMERAS)
}

/// One view of the file, checked, before its image is read.
struct Shot {
    image: String,
    masks: Vec<String>,
    depth: Option<String>,
    camera: Camera,
    /// The view's place in the file.
    field: String,
}

/// The views in the order of the file.
pub(crate) fn list<'a>(
    source: &'a Source,
    options: &'a ReadOptions,
) -> Result<Reading<'a>, ReadViewsError> {
    let path = source.locate(CAMERAS);
    let value = parse(&source.open()?.read(CAMERAS, "cameras", JSON_BYTES)?, &path)?;
    let root = Node::root(&value, &path);
    let format = root.need("format")?;
    if format.text()? != FORMAT {
        return Err(format.wrong(format!("{FORMAT:?}")));
    }
    let version = root.need("version")?;
    if version.number()? != 1.0 {
        return Err(version.wrong("1, the only version there is"));
    }
    let mut reading = Reading::new(Layout::Photos, "rotation, translation");
    let mut unknown = Unknown::default();
    unknown.look(&root, FILE)?;
    for node in root.need("views")?.elements()? {
        let shot = Shot::new(&node)?;
        unknown.look_at_view(&node)?;
        let found = source.need(&shot.image, || {
            format!("field `{}.image` of {} names it", shot.field, path.display())
        });
        let name = without_extension(&shot.image).to_owned();
        reading.add(&name, found, options, move |(), opened| shot.read(opened, options))?;
    }
    reading.warnings.extend(unknown.warnings(&path));
    Ok(reading)
}

/// Fields that the format has not: notes of somebody's, or typing mistakes.
#[derive(Default)]
struct Unknown {
    /// By what they may have been meant for and by their name: where the first stands, and how many there are.
    fields: BTreeMap<(&'static [&'static str], String), (String, usize)>,
}

impl Unknown {
    /// Notes the members of an object that are not among those `known`.
    fn look(
        &mut self,
        node: &Node<'_>,
        known: &'static [&'static str],
    ) -> Result<(), ReadViewsError> {
        for (key, member) in node.members()? {
            if known.contains(&key) {
                continue;
            }
            let name = (known, member.field.rsplit('.').next().unwrap_or_default().to_owned());
            // A file may have a name of its own in each view: the first few tell enough.
            if self.fields.len() < MOST_UNKNOWN || self.fields.contains_key(&name) {
                self.fields.entry(name).or_insert((member.field, 0)).1 += 1;
            }
        }
        Ok(())
    }

    /// The same for a view and its lens.
    fn look_at_view(&mut self, view: &Node<'_>) -> Result<(), ReadViewsError> {
        self.look(view, VIEW)?;
        let lens = view.need("lens")?;
        self.look(&lens, LENS)?;
        for (kind, known) in LENS.iter().zip([PERSPECTIVE, ORTHOGRAPHIC]) {
            if let Some(lens) = lens.get(kind) {
                self.look(&lens, known)?;
            }
        }
        Ok(())
    }

    /// A sentence for each name.
    fn warnings(self, path: &Path) -> impl Iterator<Item = String> {
        self.fields.into_iter().map(move |((known, _), (first, count))| {
            let others = if count == 1 { String::new() } else { format!(" (and {} more)", count - 1) };
            format!(
                "{}: field `{first}`{others} is unknown and has no effect: correct its name or take it out; known here are {}",
                path.display(),
                known.join(", ")
            )
        })
    }
}

impl Shot {
    fn new(node: &Node<'_>) -> Result<Self, ReadViewsError> {
        let image = node.need("image")?.text()?.to_owned();
        let text = |key: &str| node.get(key).map(|n| n.text().map(String::from)).transpose();
        let masks = match text("mask")? {
            Some(mask) => vec![mask],
            None => mask_names("masks", &image),
        };
        let rotation = node.need("rotation")?.matrix3()?;
        let translation = node.need("translation")?.numbers::<3>()?;
        let camera = Camera {
            rotation: Matrix3::from_fn(|i, k| rotation[i][k]),
            translation: Vector3::from(translation),
            lens: lens(&node.need("lens")?)?,
            width: node.need("width")?.pixels()?,
            height: node.need("height")?.pixels()?,
        };
        let field = format!("{}, camera", node.field);
        camera.validate().map_err(ReadViewsError::camera(node.file(), field))?;
        Ok(Self { masks, depth: text("depth")?, camera, field: node.field.clone(), image })
    }

    fn read(&self, opened: &mut Opened<'_>, options: &ReadOptions) -> Result<View, ReadViewsError> {
        let source = opened.source();
        let image = read_image_file(opened, &self.image, "image")?;
        let field = format!("{}.width, height", self.field);
        let camera = camera_of_size(self.camera.clone(), &image, &source.locate(CAMERAS), &field)?;
        if let ([mask], true) = (self.masks.as_slice(), options.reads_mask_files()) {
            source.need(mask, || format!("field `{}.mask` of {CAMERAS} names it", self.field))?;
        }
        let mask = mask_file(opened, &self.masks, options)?;
        let depth = depth::read(opened, self.depth.as_slice(), Unit::OfIntegers(1.0), options)?;
        let name = without_extension(&self.image).to_owned();
        assemble(name, image, mask, camera, depth, options)
    }
}

fn lens(node: &Node<'_>) -> Result<Lens, ReadViewsError> {
    let number = |kind: &Node<'_>, key: &str| kind.need(key)?.number();
    if LENS.iter().all(|kind| node.get(kind).is_some()) {
        return Err(node.wrong("one of `perspective` and `orthographic`"));
    }
    if let Some(p) = node.get("perspective") {
        let (fx, fy) = (number(&p, "fx")?, number(&p, "fy")?);
        return Ok(Lens::Perspective { fx, fy, cx: number(&p, "cx")?, cy: number(&p, "cy")? });
    }
    if let Some(o) = node.get("orthographic") {
        let (sx, sy) = (number(&o, "sx")?, number(&o, "sy")?);
        return Ok(Lens::Orthographic { sx, sy, cx: number(&o, "cx")?, cy: number(&o, "cy")? });
    }
    Err(node.wrong("`perspective` or `orthographic`"))
}

/// Writes views as `images/`, `masks/`, `depth/` and a `cameras.json`, which can say every camera:
///
/// ```json
/// {
///   "format": "unsphere-cameras",
///   "version": 1,
///   "views": [
///     {
///       "image": "images/0000.png",
///       "mask": "masks/0000.png",
///       "depth": "depth/0000.exr",
///       "width": 640, "height": 480,
///       "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
///       "translation": [0, 0, -4],
///       "lens": { "perspective": { "fx": 700, "fy": 700, "cx": 320, "cy": 240 } }
///     }
///   ]
/// }
/// ```
///
/// `rotation` (rows) and `translation` take the world to the camera, whose axes are x right, y up,
/// looking along -z. Pixels count from the top-left corner of the image as it is seen, after the
/// orientation that EXIF notes. `lens` is `perspective`, or `orthographic` with `sx`, `sy`, `cx`,
/// `cy` in pixels per unit and pixels. Names are relative to the file. `mask` may be left away
/// (then `masks/<stem>.png` or .jpg, or alpha), `depth` too. An image of another size but the
/// same shape is a resized copy. Any other field is ignored, with a warning.
///
/// The folder is made where it does not exist; files of the same name are replaced, each
/// atomically, the JSON last. Depth is EXR.
///
/// # Errors
/// If a file cannot be written.
pub fn write_photos(views: &[View], folder: &Path) -> Result<(), WriteViewsError> {
    let shots: Vec<Result<Value, WriteViewsError>> = views
        .par_iter()
        .enumerate()
        .map(|(i, view)| {
            let (image, mask, depth) = put_images(view, i, folder)?;
            let camera = &view.camera;
            let lens = match camera.lens {
                Lens::Perspective { fx, fy, cx, cy } => {
                    json!({ "perspective": { "fx": fx, "fy": fy, "cx": cx, "cy": cy } })
                }
                Lens::Orthographic { sx, sy, cx, cy } => {
                    json!({ "orthographic": { "sx": sx, "sy": sy, "cx": cx, "cy": cy } })
                }
            };
            let rows: [[f64; 3]; 3] =
                std::array::from_fn(|i| std::array::from_fn(|k| camera.rotation[(i, k)]));
            let translation: [f64; 3] = camera.translation.into();
            let mut shot = json!({
                "image": image, "mask": mask,
                "width": camera.width, "height": camera.height,
                "rotation": rows, "translation": translation, "lens": lens,
            });
            if let Some(name) = depth {
                shot["depth"] = Value::from(name);
            }
            Ok(shot)
        })
        .collect();
    let shots = shots.into_iter().collect::<Result<Vec<_>, _>>()?;
    let text = json!({ "format": FORMAT, "version": 1, "views": shots }).to_string();
    put(&folder.join(CAMERAS), text.as_bytes())
}
