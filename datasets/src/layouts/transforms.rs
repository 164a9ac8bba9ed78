//! NeRF's and nerfstudio's `transforms.json`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use mesh_core::{Camera, Distortion, Lens};
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::assemble::{ImageFile, assemble, camera_of_size, put, put_images, read_image_file};
use crate::counted::counted_are;
use crate::dataset::Subset;
use crate::depth::{self, Unit};
use crate::error::{ReadViewsError, WriteViewsError};
use crate::formats::json::{Node, parse};
use crate::mask_file::{mask_file, mask_names, named_mask};
use crate::options::ReadOptions;
use crate::read::Reading;
use crate::source::{Opened, Source};
use crate::undistort::{Lenses, straightened};
use crate::view::{Layout, View};

/// The one file of instant-ngp and nerfstudio, or the three of NeRF-synthetic.
const WHOLE: &str = "transforms.json";
const SPLITS: [&str; 3] = ["transforms_train.json", "transforms_val.json", "transforms_test.json"];
/// Longer than any file of poses, shorter than what would fill the memory.
const JSON_BYTES: u64 = 1 << 28;
/// What `file_path` may leave away.
const EXTENSIONS: [&str; 6] = ["", ".png", ".jpg", ".jpeg", ".PNG", ".JPG"];

/// The files of poses among names: the whole one, or those of the split that are there.
pub(crate) fn files_among(names: &[String]) -> Vec<String> {
    let has = |wanted: &&str| names.iter().any(|name| name == wanted);
    let whole: Vec<&str> = [WHOLE].into_iter().filter(has).collect();
    let found = if whole.is_empty() { SPLITS.into_iter().filter(has).collect() } else { whole };
    found.into_iter().map(String::from).collect()
}

/// The frames of all files, in their order.
pub(crate) fn list<'a>(
    source: &'a Source,
    files: &[String],
    options: &'a ReadOptions,
) -> Result<Reading<'a>, ReadViewsError> {
    let mut opened = source.open()?;
    let mut reading = Reading::new(Layout::Transforms, "transform_matrix");
    let mut lenses = Lenses::default();
    let mut left_out = 0;
    for file in files {
        let path = source.locate(file);
        let value = parse(&opened.read(file, "poses", JSON_BYTES)?, &path)?;
        let root = Node::root(&value, &path);
        reading.warnings.extend(applied(&root));
        let parts = Parts::new(&root, file, files)?;
        for node in root.need("frames")?.elements()? {
            let frame = Frame::new(&root, &node)?;
            let part = parts.of(&frame.image);
            if part == Some(Subset::Validation) {
                left_out += 1;
                continue;
            }
            let (name, image) = (frame.name.clone(), frame.image_in(source));
            if let Some(distortion) = frame.distortion.filter(|_| image.is_ok()) {
                lenses.count(distortion.to_string());
            }
            let at = reading.pending.len();
            reading.add(&name, image, options, move |image, opened| {
                frame.read(opened, image, options)
            })?;
            // A frame whose image is missing may not have been added.
            if part == Some(Subset::Test) && reading.pending.len() > at {
                reading.test.push(at);
            }
        }
    }
    reading.warnings.extend(lenses.sentence(options));
    if left_out > 0 {
        let count = counted_are(left_out, "validation view");
        reading.warnings.push(format!("{count} left out: others are kept for tests"));
    }
    Ok(reading)
}

/// What is said of a world that nerfstudio turned and scaled, against that of the model it made the poses from.
fn applied(root: &Node<'_>) -> Option<String> {
    let same = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
    // What is no matrix is nothing that poses were multiplied with; they are read in any case.
    let turned = root
        .get("applied_transform")
        .and_then(|node| node.matrix().ok())
        .is_some_and(|matrix| matrix[..3] != same);
    let scaled = root.get("applied_scale").and_then(|node| node.number().ok());
    let fields = [
        turned.then_some("applied_transform"),
        scaled.filter(|scale| *scale != 1.0).map(|_| "applied_scale"),
    ];
    let fields: Vec<&str> = fields.into_iter().flatten().collect();
    (!fields.is_empty()).then(|| {
        format!(
            "{}: its poses have been moved by {}: a mesh lies in the world of this file and not in that of the COLMAP \
             model that it was made from; to lay it over that, apply the inverse",
            root.file().display(),
            fields.join(" and ")
        )
    })
}

/// Which frames are for what, by the names of files or by nerfstudio's lists.
struct Parts {
    /// That of the whole file, where it is one of the three.
    file: Option<Subset>,
    /// Names of images with theirs.
    lists: BTreeMap<String, Subset>,
    /// Whether some frames are for tests, which validation then gives way to.
    has_test: bool,
}

impl Parts {
    fn new(root: &Node<'_>, file: &str, files: &[String]) -> Result<Self, ReadViewsError> {
        let mut lists = BTreeMap::new();
        for (key, subset) in [
            ("train_filenames", Subset::Train),
            ("val_filenames", Subset::Validation),
            ("test_filenames", Subset::Test),
        ] {
            let names = root.get(key).map(|node| node.elements()).transpose()?;
            for name in names.into_iter().flatten() {
                lists.insert(plain(name.text()?), subset);
            }
        }
        let of = [Subset::Train, Subset::Validation, Subset::Test];
        let which = SPLITS.iter().position(|name| *name == file).map(|k| of[k]);
        let has = |name: &str| files.iter().any(|file| file == name);
        let trains = lists.values().any(|s| *s == Subset::Train) || has(SPLITS[0]);
        let has_test = lists.values().any(|s| *s == Subset::Test) || has(SPLITS[2]);
        // A file of tests alone is all that there is.
        let which = which.filter(|_| trains);
        Ok(Self { file: which, lists, has_test })
    }

    /// What a frame is for: nothing is said of most.
    fn of(&self, image: &str) -> Option<Subset> {
        let said = self.lists.get(&plain(image)).copied().or(self.file);
        said.map(|subset| match subset {
            Subset::Validation if !self.has_test => Subset::Test,
            subset => subset,
        })
    }
}

/// A name as lists and frames both have it, on whatever system they were written.
fn plain(name: &str) -> String {
    name.replace('\\', "/").trim_start_matches("./").to_owned()
}

/// What the JSON says about one frame, checked, before its image is read.
struct Frame {
    /// The JSON file.
    file: std::path::PathBuf,
    /// The frame's place in it.
    field: String,
    name: String,
    image: String,
    mask: Option<String>,
    depth: Option<String>,
    /// What a number of the depth file stands for, where that is said.
    depth_unit: Option<f64>,
    pose: [[f64; 4]; 4],
    focal: Focal,
    principal: [Option<f64>; 2],
    distortion: Option<Distortion>,
    /// The size that the intrinsics are for.
    size: [Option<usize>; 2],
}

/// How the focal length is given.
#[derive(Clone, Copy)]
enum Focal {
    /// Pixels along x, and along y where it differs.
    Pixels(f64, Option<f64>),
    /// Full angles of view, radians: along x, and along y where it differs.
    Angle(f64, Option<f64>),
    /// The one along y alone.
    AngleY(f64),
}

impl Focal {
    fn of<'n>(
        field: &impl Fn(&str) -> Option<Node<'n>>,
        frame: &Node<'_>,
    ) -> Result<Self, ReadViewsError> {
        let positive = |key: &str| field(key).map(|node| node.positive()).transpose();
        let angle = |key: &str| -> Result<Option<f64>, ReadViewsError> {
            let Some(node) = field(key) else { return Ok(None) };
            let angle = node.positive()?;
            if angle < std::f64::consts::PI {
                Ok(Some(angle))
            } else {
                Err(node.wrong("an angle in radians, below pi"))
            }
        };
        if let Some(fx) = positive("fl_x")? {
            return Ok(Self::Pixels(fx, positive("fl_y")?));
        }
        match (angle("camera_angle_x")?, angle("camera_angle_y")?) {
            (Some(x), y) => Ok(Self::Angle(x, y)),
            (None, Some(y)) => Ok(Self::AngleY(y)),
            (None, None) => Err(ReadViewsError::field(
                frame.file(),
                format!("{}.fl_x", frame.field),
                "nothing, also not at the top level",
                "fl_x in pixels, or camera_angle_x or camera_angle_y in radians",
            )),
        }
    }

    /// Focal lengths along x and y, in pixels of an image of `[w, h]`.
    fn pixels(self, [w, h]: [usize; 2]) -> (f64, f64) {
        let focal = |size: usize, angle: f64| size as f64 / (2.0 * (angle / 2.0).tan());
        match self {
            Self::Pixels(fx, fy) => (fx, fy.unwrap_or(fx)),
            Self::Angle(x, y) => (focal(w, x), y.map_or_else(|| focal(w, x), |y| focal(h, y))),
            // Pixels are taken for square.
            Self::AngleY(y) => (focal(h, y), focal(h, y)),
        }
    }
}

/// How a frame's lens bends rays, by nerfstudio's fields or instant-ngp's.
fn distortion<'n>(
    field: &impl Fn(&str) -> Option<Node<'n>>,
) -> Result<Option<Distortion>, ReadViewsError> {
    let coefficient = |key: &str| field(key).map_or(Ok(0.0), |node| node.number());
    let [k1, k2, k3, k4] = ["k1", "k2", "k3", "k4"].map(coefficient);
    let k = [k1?, k2?, k3?, k4?];
    let brown = Distortion::BrownConrady {
        numerator: k,
        denominator: [0.0; 3],
        tangential: [coefficient("p1")?, coefficient("p2")?],
    };
    let model = field("camera_model");
    let is_fisheye = field("is_fisheye").map_or(Ok(false), |node| node.flag())?;
    let name = model.as_ref().map(Node::text).transpose()?.map(str::to_uppercase);
    let distortion = match name.as_deref() {
        Some("OPENCV_FISHEYE") => Distortion::KannalaBrandt { k },
        None if is_fisheye => Distortion::KannalaBrandt { k },
        None
        | Some(
            "OPENCV" | "PERSPECTIVE" | "PINHOLE" | "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL",
        ) => brown,
        Some(_) => {
            let expected = "OPENCV, OPENCV_FISHEYE, PERSPECTIVE, PINHOLE or SIMPLE_PINHOLE";
            return Err(model.expect("it has a name").wrong(expected));
        }
    };
    Ok((!distortion.is_none()).then_some(distortion))
}

impl Frame {
    fn new(root: &Node<'_>, frame: &Node<'_>) -> Result<Self, ReadViewsError> {
        // A frame's own value wins over that of the whole file.
        let field = |key: &str| frame.get(key).or_else(|| root.get(key));
        let distortion = distortion(&field)?;
        let focal = Focal::of(&field, frame)?;
        let positive = |key: &str| field(key).map(|node| node.positive()).transpose();
        let number = |key: &str| field(key).map(|node| node.number()).transpose();
        let pixels = |key: &str| field(key).map(|node| node.pixels()).transpose();
        let text = |key: &str| -> Result<Option<String>, ReadViewsError> {
            frame.get(key).map(|node| node.text().map(String::from)).transpose()
        };
        let image = frame.need("file_path")?.text()?.to_owned();
        let clean = plain(&image);
        let name = match clean.rsplit_once('.') {
            Some((stem, extension)) if !stem.is_empty() && !extension.contains('/') => stem,
            _ => &clean,
        };
        Ok(Self {
            file: root.file().to_owned(),
            field: frame.field.clone(),
            name: name.to_owned(),
            mask: text("mask_path")?,
            depth: text("depth_file_path")?,
            depth_unit: positive("depth_unit_scale_factor")?,
            pose: frame.need("transform_matrix")?.pose()?,
            focal,
            principal: [number("cx")?, number("cy")?],
            distortion,
            size: [pixels("w")?, pixels("h")?],
            image,
        })
    }

    /// The image's name with the extension that `file_path` may have left away.
    fn image_in(&self, source: &Source) -> Result<String, ReadViewsError> {
        EXTENSIONS
            .iter()
            .map(|extension| format!("{}{extension}", self.image))
            .find(|name| source.has(name))
            .ok_or_else(|| {
                let wanted_by =
                    format!("field `{}.file_path` of {} names it", self.field, self.file.display());
                source.missing_view(&self.image, wanted_by)
            })
    }

    fn read(
        &self,
        opened: &mut Opened<'_>,
        image: &str,
        options: &ReadOptions,
    ) -> Result<View, ReadViewsError> {
        let image = read_image_file(opened, image, "image")?;
        let camera = self.camera(&image)?;
        let mask = match &self.mask {
            Some(name) if options.reads_mask_files() => {
                opened.source().need(name, || {
                    format!("field `{}.mask_path` of {} names it", self.field, self.file.display())
                })?;
                named_mask(opened, name, options)?
            }
            _ => mask_file(opened, &mask_names("masks", &plain(&self.image)), options)?,
        };
        let unit = match self.depth_unit {
            Some(unit) => Unit::OfAll(unit),
            // nerfstudio's default, millimetres, where numbers are whole. It takes a thousandth of others too, which here are what they
            // say: whoever writes metres as floats means metres.
            None => Unit::OfIntegers(1e-3),
        };
        let depth = depth::read(opened, self.depth.as_slice(), unit, options)?;
        let view = assemble(self.name.clone(), image, mask, camera, depth, options)?;
        let field = format!("{}: k1, k2, ..", self.field);
        straightened(view, self.distortion.as_ref(), options, (&self.file, &field))
    }

    /// The camera for an image of this size.
    fn camera(&self, image: &ImageFile) -> Result<Camera, ReadViewsError> {
        let w = self.size[0].unwrap_or(image.pixels.width);
        let h = self.size[1].unwrap_or(image.pixels.height);
        let (fx, fy) = self.focal.pixels([w, h]);
        let cx = self.principal[0].unwrap_or(w as f64 / 2.0);
        let cy = self.principal[1].unwrap_or(h as f64 / 2.0);
        let camera = Camera::from_opengl(self.pose, fx, fy, cx, cy, w, h);
        let field = format!("{}.transform_matrix", self.field);
        camera.validate().map_err(ReadViewsError::camera(&self.file, field))?;
        // Images are often smaller than what the poses were found with.
        camera_of_size(camera, image, &self.file, &format!("{}.w, h", self.field))
    }
}

/// Writes views as a `transforms.json` with `images/` and `masks/` beside it; see [`write_transforms_split`], of which
/// these views have none.
///
/// # Errors
/// If a file cannot be written, or a camera has parallel rays, which the layout cannot say.
pub fn write_transforms(views: &[View], folder: &Path) -> Result<(), WriteViewsError> {
    write_transforms_split(views, &[], folder)
}

/// Writes views as a `transforms.json` with `images/` and `masks/` beside it, and which of them are kept for tests: `test` has
/// their places in `views`, as [`Views::test`](crate::Views::test). They are nerfstudio's `test_filenames`, and its
/// `val_filenames`, without which it refuses the file; the rest are its `train_filenames`. Without any there are no lists.
///
/// The folder is made where it does not exist; files of the same name are replaced, each
/// atomically, the JSON last. Every frame carries its own intrinsics. Depth is in the unit of the poses; nerfstudio, whose
/// default is thousandths of that, has to be told: `depth_unit_scale_factor=1` of its data parser.
///
/// # Errors
/// If a file cannot be written, or a camera has parallel rays, which the layout cannot say.
pub fn write_transforms_split(
    views: &[View],
    test: &[usize],
    folder: &Path,
) -> Result<(), WriteViewsError> {
    let frames: Vec<Result<Value, WriteViewsError>> = views
        .par_iter()
        .enumerate()
        .map(|(i, view)| {
            let Lens::Perspective { fx, fy, cx, cy } = view.camera.lens else {
                let problem = format!("view {}: parallel rays have no transforms.json", view.name);
                return Err(WriteViewsError::new(&folder.join(WHOLE), problem));
            };
            let (image, mask, depth) = put_images(view, i, folder)?;
            let mut frame = json!({
                "file_path": image,
                "mask_path": mask,
                "transform_matrix": view.camera.to_opengl(),
                "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy,
                "w": view.camera.width, "h": view.camera.height,
            });
            if let Some(name) = depth {
                frame["depth_file_path"] = Value::from(name);
            }
            Ok(frame)
        })
        .collect();
    let frames = frames.into_iter().collect::<Result<Vec<_>, _>>()?;
    let kept: BTreeSet<usize> = test.iter().copied().collect();
    let names = |of_test: bool| -> Vec<Value> {
        let frames = frames.iter().enumerate().filter(|(i, _)| kept.contains(i) == of_test);
        frames.map(|(_, frame)| frame["file_path"].clone()).collect()
    };
    let mut root = json!({ "camera_model": "PINHOLE" });
    if !test.is_empty() {
        root["train_filenames"] = names(false).into();
        root["val_filenames"] = names(true).into();
        root["test_filenames"] = names(true).into();
    }
    root["frames"] = frames.into();
    put(&folder.join(WHOLE), root.to_string().as_bytes())
}
