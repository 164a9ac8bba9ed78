//! From the files of one view to a [`View`]: shared by all layouts.

use std::path::{Path, PathBuf};

use mesh_core::io::write_atomic;
use mesh_core::{ByteImage, Camera, DepthMap, StoredImage, encode_depth, encode_png};

use crate::backdrop::Backdrop;
use crate::error::{ReadViewsError, ViewsProblem, WriteViewsError};
use crate::mask::{brightest, clean_mask, invert, mask_from_alpha};
use crate::mask_file::{MaskFile, mask_of_folder};
use crate::natural;
use crate::options::{MaskSource, ReadOptions};
use crate::source::{Brightest, Opened, Source};
use crate::view::View;

/// No image of a view may be a larger file than this.
pub(crate) const IMAGE_BYTES: u64 = 1 << 28;

/// A decoded image and where it came from.
pub(crate) struct ImageFile {
    pub(crate) path: PathBuf,
    pub(crate) pixels: ByteImage,
    /// Whether the pixels are as they are stored, whatever EXIF says of them.
    pub(crate) is_stored: bool,
    /// Whether the EXIF orientation makes columns of the stored rows.
    pub(crate) is_lying: bool,
    /// Where values of masks are noted.
    pub(crate) brightest: Brightest,
}

impl ImageFile {
    /// Pixels of a file that has no orientation.
    pub(crate) fn new(path: PathBuf, pixels: ByteImage) -> Self {
        Self { path, pixels, is_stored: false, is_lying: false, brightest: Brightest::default() }
    }
}

/// Reads and decodes an image, turned upright where the source's pixels are not counted as they are stored.
pub(crate) fn read_image_file(
    opened: &mut Opened<'_>,
    name: &str,
    field: &str,
) -> Result<ImageFile, ReadViewsError> {
    let path = opened.source().locate(name);
    let bytes = opened.read(name, field, IMAGE_BYTES)?;
    let image = decoded(&bytes, &path, opened)?;
    let (is_stored, is_lying) = (opened.source().has_stored_pixels(), image.is_lying());
    let image = if is_stored { image } else { image.upright() };
    let brightest = opened.source().brightest().clone();
    Ok(ImageFile { path, pixels: image.into_bytes(), is_stored, is_lying, brightest })
}

/// Reads and decodes an image whose numbers may be labels, else like [`read_image_file`].
pub(crate) fn read_labels(
    opened: &mut Opened<'_>,
    name: &str,
    field: &str,
) -> Result<(PathBuf, ByteImage), ReadViewsError> {
    let path = opened.source().locate(name);
    let bytes = opened.read(name, field, IMAGE_BYTES)?;
    let image = decoded(&bytes, &path, opened)?;
    let image = if opened.source().has_stored_pixels() { image } else { image.upright() };
    let image = image.into_labels();
    opened.source().brightest().note(brightest(&image));
    Ok((path, image))
}

fn decoded(bytes: &[u8], path: &Path, opened: &Opened<'_>) -> Result<StoredImage, ReadViewsError> {
    StoredImage::decode(bytes, path, opened.limits())
        .map_err(|error| ReadViewsError::new(path, error))
}

/// A file's name without its extension, with its folders.
pub(crate) fn without_extension(name: &str) -> &str {
    match name.rsplit_once('.') {
        Some((stem, end)) if !stem.is_empty() && !end.contains('/') => stem,
        _ => name,
    }
}

/// A file's name without its folders and its extension.
pub(crate) fn plain_stem(name: &str) -> &str {
    let stem = without_extension(name);
    stem.rsplit('/').next().unwrap_or(stem)
}

/// The images of a folder, or of the root where it is called "", in the natural order of their names.
pub(crate) fn images_in(source: &Source, folder: &str) -> Result<Vec<String>, ReadViewsError> {
    let names = match folder {
        "" => source.root_names()?,
        _ => source.names_in(folder).into_iter().map(|name| format!("{folder}/{name}")).collect(),
    };
    let is_image = |name: &String| {
        let end = name.rsplit_once('.').map_or("", |(_, end)| end);
        ["png", "jpg", "jpeg"].iter().any(|known| end.eq_ignore_ascii_case(known))
    };
    let mut names: Vec<String> = names.into_iter().filter(is_image).collect();
    names.sort_by(|a, b| natural::compare(a, b));
    Ok(names)
}

/// The camera for the image that is there, which may be a smaller copy of the one it was
/// found with, but of the same shape.
pub(crate) fn camera_of_size(
    camera: Camera,
    image: &ImageFile,
    file: &Path,
    field: &str,
) -> Result<Camera, ReadViewsError> {
    let (width, height) = (image.pixels.width, image.pixels.height);
    let (w, h) = (camera.width, camera.height);
    if (w, h) == (width, height) {
        return Ok(camera);
    }
    check_shape([w, h], image, file, field)?;
    Ok(camera.resized(width, height))
}

/// Refuses an image that is no resized copy of one of `[width, height]`.
pub(crate) fn check_shape(
    [w, h]: [usize; 2],
    image: &ImageFile,
    file: &Path,
    field: impl Into<String>,
) -> Result<(), ReadViewsError> {
    let (width, height) = (image.pixels.width, image.pixels.height);
    if is_same_shape([w, h], [width, height]) {
        return Ok(());
    }
    let mut expected = format!("the shape of {}, {width}x{height}", image.path.display());
    // The other reading of the orientation would do, and is not what the layout says.
    if image.is_lying && is_same_shape([w, h], [height, width]) {
        expected += if image.is_stored {
            "; turned as its EXIF orientation says it would fit: COLMAP counts stored pixels, so turn these (magick mogrify -auto-orient)"
        } else {
            ", turned as its EXIF orientation says; as it is stored it would fit: remove the tag (exiftool -Orientation= FILE)"
        };
    }
    Err(ReadViewsError::field(file, field, format!("{w}x{h}"), expected))
}

/// Whether the second of two sizes is that of a resized copy of the first, of which each side was rounded.
fn is_same_shape([w, h]: [usize; 2], [width, height]: [usize; 2]) -> bool {
    w.saturating_mul(height).abs_diff(h.saturating_mul(width)) <= w.max(h)
}

/// The mask at the size of its image: masks are made of smaller copies where memory is short, and images are thinned out.
///
/// # Errors
/// If neither can be a resized copy of the other.
fn mask_of_size(
    (at, mask): (PathBuf, ByteImage),
    image: &ImageFile,
) -> Result<ByteImage, ReadViewsError> {
    let [of_mask, of_image] = [&mask, &image.pixels].map(|found| [found.width, found.height]);
    if of_mask == of_image {
        return Ok(mask);
    }
    if mask.data.is_empty() || !is_same_shape(of_mask.max(of_image), of_mask.min(of_image)) {
        return Err(of_another_size(&at, "mask size", of_mask, image));
    }
    let mut mask = mask.resized(image.pixels.height, image.pixels.width);
    // As views are averaged down.
    mask.data.iter_mut().for_each(|m| *m = if *m >= 128 { 255 } else { 0 });
    Ok(mask)
}

/// The depth at the size of its image, each pixel from the nearest: sensors and networks have fewer pixels than cameras.
///
/// # Errors
/// If neither can be a resized copy of the other.
fn depth_of_size(
    (at, depth): (PathBuf, DepthMap),
    image: &ImageFile,
) -> Result<DepthMap, ReadViewsError> {
    let (of_depth, of_image) =
        ([depth.width, depth.height], [image.pixels.width, image.pixels.height]);
    if of_depth == of_image {
        return Ok(depth);
    }
    if depth.data.is_empty() || !is_same_shape(of_depth.max(of_image), of_depth.min(of_image)) {
        return Err(of_another_size(&at, "depth size", of_depth, image));
    }
    Ok(depth.resized(image.pixels.height, image.pixels.width))
}

/// The error of a file that has not the size of its image.
fn of_another_size(
    at: &Path,
    field: &str,
    [w, h]: [usize; 2],
    image: &ImageFile,
) -> ReadViewsError {
    let ByteImage { width, height, .. } = image.pixels;
    let expected = format!("the shape of {}, {width}x{height}", image.path.display());
    ReadViewsError::field(at, field, format!("{w}x{h}"), expected)
}

/// Writes a view's `images/NNNN.png`, `masks/NNNN.png` and, where it has depth, `depth/NNNN.exr`: their names.
pub(crate) fn put_images(
    view: &View,
    i: usize,
    folder: &Path,
) -> Result<(String, String, Option<String>), WriteViewsError> {
    let (image, mask) = (format!("images/{i:04}.png"), format!("masks/{i:04}.png"));
    put(&folder.join(&image), &encode_png(&view.color))?;
    put(&folder.join(&mask), &encode_png(&view.mask))?;
    let depth = view.depth.as_ref().map(|depth| (format!("depth/{i:04}.exr"), depth));
    if let Some((name, depth)) = &depth {
        put(&folder.join(name), &encode_depth(depth))?;
    }
    Ok((image, mask, depth.map(|(name, _)| name)))
}

/// Writes one file of a set of views, with its folder.
pub(crate) fn put(path: &Path, bytes: &[u8]) -> Result<(), WriteViewsError> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(|e| WriteViewsError::new(folder, e))?;
    }
    write_atomic(path, |out| out.write_all(bytes)).map_err(|e| WriteViewsError::new(path, e))
}

/// Removes what an earlier set of views left, if there is any.
pub(crate) fn remove(stale: &Path) -> Result<(), WriteViewsError> {
    match std::fs::remove_file(stale) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(WriteViewsError::new(stale, error))
        }
        _ => Ok(()),
    }
}

/// Puts a view together: chooses the mask, composites the colour, brings all to one size.
///
/// `file` is what the layout's mask file says, where there is one and it was asked for. `camera` is for the image's size.
pub(crate) fn assemble(
    name: String,
    image: ImageFile,
    file: MaskFile,
    camera: Camera,
    depth: Option<(PathBuf, DepthMap)>,
    options: &ReadOptions,
) -> Result<View, ReadViewsError> {
    let MaskFile { found, looked_for } = match &options.masks {
        Some(folder) => mask_of_folder(folder, &image, options)?,
        None => file,
    };
    let found = found.map(|found| mask_of_size(found, &image)).transpose()?;
    let depth = depth.map(|depth| depth_of_size(depth, &image)).transpose()?;
    let ImageFile { path, pixels: image, .. } = image;
    let color = image.over(options.background);
    let looked_for = MaskFile { found: None, looked_for }.looked_for();
    let no_mask = || {
        let problem = ViewsProblem::NoMask { looked_for: looked_for.clone() };
        ReadViewsError::new(&path, problem)
    };
    let mut mask = match (options.mask, found) {
        (_, found) if options.masks.is_some() => found.ok_or_else(no_mask)?,
        (MaskSource::Auto | MaskSource::Files, Some(mask)) => mask,
        (MaskSource::Auto | MaskSource::Alpha, _) => mask_from_alpha(&image).ok_or_else(no_mask)?,
        // What is object follows from all views, when they are read.
        (MaskSource::Whole | MaskSource::ColorModel, _) => {
            let (height, width) = (image.height, image.width);
            ByteImage { height, width, channels: 1, data: vec![255; height * width] }
        }
        (MaskSource::Files, None) => return Err(no_mask()),
        (MaskSource::Backdrop { color: backdrop, tolerance }, _) => {
            Backdrop::of(&color, backdrop, tolerance, options.bars)
                .mask(&color)
                .map_err(|problem| ReadViewsError::new(&path, problem))?
        }
    };
    let can_invert =
        matches!(options.mask, MaskSource::Auto | MaskSource::Alpha | MaskSource::Files);
    if options.invert && can_invert {
        invert(&mut mask);
    }
    clean_mask(&mut mask, options);
    let view = View { name, color, mask, camera, depth, crop: None };
    Ok(match options.max_size {
        Some(longest) => view.at_most(longest),
        None => view,
    })
}
