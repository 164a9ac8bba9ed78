//! kaolin's synthetic views: `{i}_rgb.png`, `{i}_semantic.npy`, `{i}_metadata.json`.
//!
//! Numbers may begin anywhere, since parts of a set are views too, and may have leading zeros; none
//! between the first and the last is missing, and each is written in one way.

use std::collections::BTreeMap;
use std::path::Path;

use mesh_core::{ByteImage, Camera, encode_depth, encode_png};
use rayon::prelude::*;
use serde_json::json;

use crate::assemble::{ImageFile, assemble, check_shape, put, read_image_file, remove};
use crate::depth::{self, Unit};
use crate::error::{ReadViewsError, WriteViewsError};
use crate::formats::json::{Node, parse};
use crate::formats::npy;
use crate::options::{MaskSource, ReadOptions};
use crate::read::{Pending, Reading};
use crate::source::{Opened, Source, names_of};
use crate::view::{Layout, View};
use crate::wanted::Wanted;

const COLOR: &str = "_rgb.png";
const MASK: &str = "_semantic.npy";
const CAMERA: &str = "_metadata.json";
/// Ours, and kaolin's own.
const DEPTHS: [&str; 2] = ["_depth.exr", "_depth_linear.npy"];
/// Width of the sensor that is written, millimetres: the one of kaolin's own samples.
const APERTURE: f64 = 20.955;
/// Where the object lies in the scene: as it is.
const IDENTITY: [[f64; 4]; 4] =
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
/// No metadata is longer than this.
const METADATA_BYTES: u64 = 1 << 24;

/// Whether any of these names belongs to a kaolin view.
pub(crate) fn recognises(names: &[String]) -> bool {
    names.iter().any(|name| index_of(name).is_some())
}

/// The views of a folder or archive, in the order of their numbers.
pub(crate) fn list<'a>(
    source: &'a Source,
    names: &[String],
    options: &'a ReadOptions,
) -> Result<Reading<'a>, ReadViewsError> {
    // Keyed by the number; the text keeps leading zeros.
    let mut indices: BTreeMap<u64, &str> = BTreeMap::new();
    for name in names {
        if let Some((number, text)) = index_of(name) {
            let known = *indices.entry(number).or_insert(text);
            if known != text {
                let found = format!("{text} beside {known}, which are both number {number}");
                let expected = "one name for each view: rename or remove the files of the other";
                return Err(ReadViewsError::field(source.locate(name), "view", found, expected));
            }
        }
    }
    let mut warnings = Vec::new();
    let mut previous: Option<u64> = None;
    for &number in indices.keys() {
        if let Some(gap) = previous.map(|p| p + 1).filter(|&gap| gap != number) {
            if !options.allow_missing {
                let last = indices.keys().next_back().copied().unwrap_or(number);
                let wanted_by = format!("the views go up to {last} without a gap");
                let path = source.locate(&format!("{gap}{COLOR}"));
                return Err(ReadViewsError::missing_view(path, wanted_by));
            }
            warnings.push(format!("views {gap} to {} are missing", number - 1));
        }
        previous = Some(number);
    }
    // Where some views have a mask file, one without has lost it.
    let masks = match options.mask {
        _ if !options.reads_mask_files() => false,
        MaskSource::Files => true,
        MaskSource::Auto => names.iter().any(|n| index_of(n).is_some() && n.ends_with(MASK)),
        _ => false,
    };
    let (mut pending, mut left_out): (Vec<Pending<'a>>, _) = (Vec::new(), Vec::new());
    for text in indices.into_values() {
        let stem = text.to_owned();
        let mut wanted = vec![COLOR, CAMERA];
        if masks {
            wanted.push(MASK);
        }
        let absent = wanted.into_iter().find(|end| !source.has(&format!("{stem}{end}")));
        match absent {
            Some(end) if options.allow_missing => {
                warnings.push(format!("view {stem} is left out: {stem}{end} is missing"));
            }
            Some(_) if !Wanted::of(options).has(&stem) => left_out.push(stem),
            Some(end) => {
                let path = source.locate(&format!("{stem}{end}"));
                let wanted_by = format!("view {stem} has other files");
                return Err(ReadViewsError::missing_view(path, wanted_by));
            }
            None => {
                let name = stem.clone();
                pending.push(Pending::new(name, move |opened| read_view(opened, &stem, options)));
            }
        }
    }
    let layout = if source.is_zip() { Layout::KaolinZip } else { Layout::KaolinFolder };
    Ok(Reading { pending, warnings, left_out, ..Reading::new(layout, "tf_mat") })
}

/// The number in front of a known ending, and its text.
fn index_of(name: &str) -> Option<(u64, &str)> {
    let text = [COLOR, MASK, CAMERA].into_iter().find_map(|end| name.strip_suffix(end))?;
    let digits = !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    // Up to 18 digits, so that the number after it exists too.
    (digits && text.len() <= 18).then(|| text.parse().ok().map(|n| (n, text)))?
}

fn read_view(
    opened: &mut Opened<'_>,
    stem: &str,
    options: &ReadOptions,
) -> Result<View, ReadViewsError> {
    let source = opened.source();
    let name = format!("{stem}{COLOR}");
    let image = read_image_file(opened, &name, "image")?;
    let camera = read_camera(opened, stem, &image)?;
    let mask = format!("{stem}{MASK}");
    let mask = if options.reads_mask_files() && source.has(&mask) {
        Some((source.locate(&mask), read_mask(opened, &mask, &image.pixels)?))
    } else {
        None
    };
    let depths = DEPTHS.map(|end| format!("{stem}{end}"));
    let depth = depth::read(opened, &depths, Unit::OfIntegers(1.0), options)?;
    assemble(stem.to_owned(), image, mask.into(), camera, depth, options)
}

fn read_camera(
    opened: &mut Opened<'_>,
    stem: &str,
    image: &ImageFile,
) -> Result<Camera, ReadViewsError> {
    let name = format!("{stem}{CAMERA}");
    let path = opened.source().locate(&name);
    let value = parse(&opened.read(&name, "camera", METADATA_BYTES)?, &path)?;
    let camera = Node::root(&value, &path).need("camera_properties")?;
    let (width, height) = (image.pixels.width, image.pixels.height);
    if let Some(resolution) = camera.get("resolution") {
        let (w, h) = (resolution.need("width")?.pixels()?, resolution.need("height")?.pixels()?);
        // Resampled images keep their metadata; the lens fits as long as the shape does.
        check_shape([w, h], image, &path, resolution.field)?;
    }
    let tf_mat = camera.need("tf_mat")?;
    let matrix = tf_mat.matrix()?;
    // Row vectors: the translation stands in the last row, and where somebody transposed the matrix
    // it would be lost in silence.
    let column = matrix.map(|row| row[3]);
    let strays = column.iter().zip([0.0, 0.0, 0.0, 1.0]).any(|(a, b)| (a - b).abs() > 1e-6);
    if strays || tf_mat.elements()?.len() != 4 {
        let expected = "4 rows, the translation in the last, each row's end 0, 0, 0, 1";
        return Err(tf_mat.wrong(expected));
    }
    let result = Camera::from_kaolin(
        matrix,
        camera.need("horizontal_aperture")?.positive()?,
        camera.need("focal_length")?.positive()?,
        width,
        height,
    );
    result.validate().map_err(ReadViewsError::camera(&path, tf_mat.field))?;
    Ok(result)
}

/// Any label above zero is the object.
fn read_mask(
    opened: &mut Opened<'_>,
    name: &str,
    image: &ByteImage,
) -> Result<ByteImage, ReadViewsError> {
    let (height, width) = (image.height, image.width);
    let array = depth::read_npy(opened, name, "mask", image)?;
    let data = array.iter().map(|&label| if label > 0.0 { 255 } else { 0 }).collect();
    Ok(ByteImage { height, width, channels: 1, data })
}

/// Writes views in kaolin's layout into a folder, which is made where it does not exist.
///
/// Files of the same name are replaced, each atomically. Views are numbered from 0 in their
/// order; depth, where there is one, becomes `{i}_depth.exr`. What would be read beside them is removed: views of higher numbers, and
/// depth of views that have none now.
///
/// # Errors
/// If a file cannot be written, or a camera cannot be said in this layout: parallel rays, pixels
/// that are not square, a lens off the image's centre.
pub fn write_kaolin(views: &[View], folder: &Path) -> Result<(), WriteViewsError> {
    std::fs::create_dir_all(folder).map_err(|e| WriteViewsError::new(folder, e))?;
    let results: Vec<Result<(), WriteViewsError>> = views
        .par_iter()
        .enumerate()
        .map(|(i, view)| write_view(view, &folder.join(i.to_string())))
        .collect();
    results.into_iter().collect::<Result<(), _>>()?;
    remove_stale(views.len(), folder)
}

/// Removes the views of an earlier set of more, whose numbers go on behind the last one.
fn remove_stale(count: usize, folder: &Path) -> Result<(), WriteViewsError> {
    for name in names_of(folder).map_err(|e| WriteViewsError::new(folder, e))? {
        let Some((number, text)) = index_of(&name) else { continue };
        if number >= count as u64 && text == number.to_string() {
            for end in [COLOR, MASK, CAMERA].into_iter().chain(DEPTHS) {
                remove(&folder.join(format!("{text}{end}")))?;
            }
        }
    }
    Ok(())
}

fn write_view(view: &View, stem: &Path) -> Result<(), WriteViewsError> {
    let file = |end: &str| {
        let mut path = stem.as_os_str().to_owned();
        path.push(end);
        std::path::PathBuf::from(path)
    };
    let metadata_path = file(CAMERA);
    let camera =
        view.camera.to_kaolin(APERTURE).map_err(|e| WriteViewsError::new(&metadata_path, e))?;
    let metadata = json!({
        "camera_properties": {
            "resolution": { "width": view.camera.width, "height": view.camera.height },
            "clipping_range": [0.01, 1_000_000.0],
            "horizontal_aperture": camera.horizontal_aperture,
            "focal_length": camera.focal_length,
            "tf_mat": camera.tf_mat,
        },
        // kaolin's reader asks for the matrix of the first, and fails where there is none.
        "asset_transforms": [["asset", IDENTITY]],
    });
    put(&file(COLOR), &encode_png(&view.color))?;
    let mut labels = Vec::new();
    let shape = [view.mask.height, view.mask.width, 1];
    let mask_path = file(MASK);
    npy::write_i32(&mut labels, &shape, view.mask.data.iter().map(|&m| (m != 0) as i32))
        .map_err(|e| WriteViewsError::new(&mask_path, e))?;
    put(&mask_path, &labels)?;
    if let Some(depth) = &view.depth {
        put(&file(DEPTHS[0]), &encode_depth(depth))?;
    } else {
        DEPTHS.iter().try_for_each(|end| remove(&file(end)))?;
    }
    put(&metadata_path, metadata.to_string().as_bytes())
}
