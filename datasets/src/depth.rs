//! Depth and label arrays of views.

use std::path::PathBuf;

use mesh_core::{ByteImage, DepthMap, decode_depth_png_with, decode_depth_with};

use crate::assemble::IMAGE_BYTES;
use crate::error::ReadViewsError;
use crate::formats::npy;
use crate::options::ReadOptions;
use crate::source::Opened;

/// What a number of a depth file stands for.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Unit {
    /// A whole one stands for so much, others for themselves.
    OfIntegers(f64),
    /// Each stands for so much, as files of depth are told to.
    OfAll(f64),
}

impl Unit {
    fn of(self, is_integer: bool) -> f32 {
        match self {
            Self::OfIntegers(_) if !is_integer => 1.0,
            Self::OfIntegers(unit) | Self::OfAll(unit) => unit as f32,
        }
    }
}

/// Reads planar depth from the first of `names` that exists, EXR, npy or PNG. Numbers are whole in PNG, and in npy where its type says so.
///
/// What is not finite, not positive or at least 1e9 is background: `+inf`.
pub(crate) fn read(
    opened: &mut Opened<'_>,
    names: &[String],
    unit: Unit,
    options: &ReadOptions,
) -> Result<Option<(PathBuf, DepthMap)>, ReadViewsError> {
    let source = opened.source();
    let mut wanted = names.iter().filter(|_| options.depth);
    let Some(name) = wanted.find(|name| source.has(name)) else { return Ok(None) };
    let path = source.locate(name);
    let ends_in = |wanted: &str| {
        let extension = std::path::Path::new(name).extension();
        extension.is_some_and(|extension| extension.eq_ignore_ascii_case(wanted))
    };
    let (mut depth, unit) = if ends_in("png") {
        let unit = unit.of(true);
        let bytes = opened.read(name, "depth", IMAGE_BYTES)?;
        let depth = decode_depth_png_with(&bytes, &path, unit, opened.limits())
            .map_err(|error| ReadViewsError::new(&path, error))?;
        (depth, 1.0)
    } else if ends_in("exr") {
        let bytes = opened.read(name, "depth", IMAGE_BYTES)?;
        let depth = decode_depth_with(&bytes, &path, opened.limits())
            .map_err(|error| ReadViewsError::new(&path, error))?;
        (depth, unit.of(false))
    } else {
        let bytes = opened.read(name, "depth", IMAGE_BYTES)?;
        let wrong = |e: npy::NpyError| {
            ReadViewsError::field(&path, format!("depth {}", e.field), e.found, e.expected)
        };
        let npy::NpyImage { size: [height, width], data, is_whole } =
            npy::read_image(&bytes).map_err(wrong)?;
        (DepthMap { height, width, data }, unit.of(is_whole))
    };
    for d in &mut depth.data {
        if *d > 0.0 && *d < 1e9 {
            *d *= unit;
        } else {
            *d = f32::INFINITY;
        }
    }
    Ok(Some((path, depth)))
}

/// Reads one number per pixel of the image: `[H, W]` or `[H, W, 1]`.
pub(crate) fn read_npy(
    opened: &mut Opened<'_>,
    name: &str,
    field: &str,
    image: &ByteImage,
) -> Result<Vec<f32>, ReadViewsError> {
    let (height, width) = (image.height, image.width);
    let bytes = opened.read(name, field, most_bytes(image))?;
    let array = npy::read(&bytes, &[&[height, width], &[height, width, 1]]).map_err(|e| {
        ReadViewsError::field(
            opened.source().locate(name),
            format!("{field} {}", e.field),
            e.found,
            e.expected,
        )
    })?;
    Ok(array.data)
}

/// What one array over the image may take: eight bytes a pixel, and a header.
fn most_bytes(image: &ByteImage) -> u64 {
    8 * (image.height * image.width) as u64 + (1 << 20)
}
