//! What can be wrong with an image file.

use std::path::{Path, PathBuf};

use crate::Limits;

/// Why an image could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImageError {
    /// The file could not be opened or read.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The bytes are not an image of a known format, or are damaged.
    #[error("{}: not a readable image: {what}", path.display())]
    Decode {
        /// The file, or the name given for the bytes.
        path: PathBuf,
        /// What the decoder said.
        what: String,
    },
    /// The header claims an image larger than the file or the memory can hold.
    #[error(
        "{}: the header claims {width} x {height} pixels ({bytes} bytes), more than {limit} bytes \
         that a file of {length} bytes may unpack to",
        path.display()
    )]
    TooLarge {
        /// The file, or the name given for the bytes.
        path: PathBuf,
        /// Claimed columns.
        width: u64,
        /// Claimed rows.
        height: u64,
        /// Bytes that the pixels would take.
        bytes: u64,
        /// Bytes that are allowed.
        limit: u64,
        /// Bytes in the file.
        length: u64,
    },
    /// The header claims more than the [`Limits`] allow.
    #[error(
        "{}: the header claims {width} x {height} pixels{}, the limit is {max_pixels} pixels of 4 bytes: make the image smaller",
        path.display(),
        of_bytes(*bytes)
    )]
    OverLimit {
        /// The file, or the name given for the bytes.
        path: PathBuf,
        /// Claimed columns.
        width: u64,
        /// Claimed rows.
        height: u64,
        /// Bytes that the pixels would take; 0 where there are too many whatever they take.
        bytes: u64,
        /// Pixels that are allowed, each of 4 bytes on average.
        max_pixels: u64,
    },
    /// An EXR file without a channel that could be depth.
    #[error(
        "{}: no depth channel: expected Z, V, depth.V, View Layer.Depth.Z or R, found {found}",
        path.display()
    )]
    NoDepth {
        /// The file.
        path: PathBuf,
        /// The channels that it has.
        found: String,
    },
    /// A picture in colour where depth is expected.
    #[error(
        "{}: a picture in colour, its channels differ, expected depth, one number a pixel: an EXR, PFM or npy file, or a \
         grey PNG of 8 or 16 bits",
        path.display()
    )]
    Colored {
        /// The file, or the name given for the bytes.
        path: PathBuf,
    },
}

fn of_bytes(bytes: u64) -> String {
    if bytes == 0 { String::new() } else { format!(" ({bytes} bytes)") }
}

/// What makes an error of what a decoder says.
pub(super) fn undecodable<E: ToString>(path: &Path) -> impl Fn(E) -> ImageError {
    move |error| ImageError::Decode { path: path.to_owned(), what: error.to_string() }
}

/// Refuses what a file of `length` bytes cannot unpack to.
pub(super) fn too_large(
    path: &Path,
    (width, height): (usize, usize),
    bytes: u64,
    possible: u64,
    length: usize,
) -> Result<(), ImageError> {
    if bytes <= possible {
        return Ok(());
    }
    Err(ImageError::TooLarge {
        path: path.to_owned(),
        width: width as u64,
        height: height as u64,
        bytes,
        limit: possible,
        length: length as u64,
    })
}

/// Refuses what the limits do not allow.
pub(super) fn too_many(
    path: &Path,
    (width, height): (usize, usize),
    bytes: u64,
    limits: &Limits,
) -> Result<(), ImageError> {
    let (width, height) = (width as u64, height as u64);
    let max_pixels = limits.max_pixels;
    if width.saturating_mul(height) <= max_pixels && bytes <= max_pixels.saturating_mul(4) {
        return Ok(());
    }
    Err(ImageError::OverLimit { path: path.to_owned(), width, height, bytes, max_pixels })
}
