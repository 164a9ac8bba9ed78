//! JPEG, by the crate `zune-jpeg`.

use std::path::Path;

use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::{bytestream::ZCursor, colorspace::ColorSpace, options::DecoderOptions};

use super::ImageError;
use super::decoded::Decoded;
use super::error::{too_large, too_many, undecodable};
use super::exif::Orientation;
use crate::Limits;

/// How a file begins.
pub(super) const SIGNATURE: &[u8] = b"\xff\xd8\xff";
/// Scans of a progressive file; each goes over the whole image, and real ones have about ten.
const SCANS: usize = 256;
/// A block of 64 pixels takes at least a bit, once per plane.
const RATIO: u64 = 8192;

/// Grey stays grey; all else becomes RGB.
pub(super) fn decode(bytes: &[u8], name: &Path, limits: &Limits) -> Result<Decoded, ImageError> {
    let possible = (bytes.len() as u64).saturating_mul(RATIO);
    let length = bytes.len();
    let bytes = &bytes[..end(bytes).unwrap_or(length)];
    let scans = bytes.windows(2).filter(|pair| pair == b"\xff\xda");
    if scans.take(SCANS + 1).count() > SCANS {
        return Err(undecodable(name)(format!("more than {SCANS} scans")));
    }
    let options = DecoderOptions::default()
        .set_strict_mode(false)
        .set_max_width(usize::from(u16::MAX))
        .set_max_height(usize::from(u16::MAX));
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(undecodable(name))?;
    let gray = decoder.input_colorspace() == Some(ColorSpace::Luma);
    let (space, channels) = if gray { (ColorSpace::Luma, 1) } else { (ColorSpace::RGB, 3) };
    let (width, height) = decoder.dimensions().unwrap_or_default();
    let claimed = (width * height * channels) as u64;
    too_large(name, (width, height), claimed / 4, possible, length)?;
    too_many(name, (width, height), claimed, limits)?;
    decoder.set_options(options.jpeg_set_out_colorspace(space));
    let orientation = decoder.exif().and_then(|exif| Orientation::of(exif));
    let mut data = vec![0; claimed as usize];
    decoder.decode_into(&mut data).map_err(undecodable(name))?;
    // What is missing would be grey.
    if !has_end(bytes) {
        return Err(undecodable(name)("the JPEG ends too early, copy it again"));
    }
    let orientation = orientation.unwrap_or_default();
    Ok(Decoded { height, width, channels, deep: false, data, orientation })
}

/// Whether the image's own end is there: a thumbnail, within a segment before the first scan, has another, and phones put more
/// pictures and films behind it.
fn has_end(bytes: &[u8]) -> bool {
    let Some(at) = first_scan(bytes) else { return false };
    // A 0xff of the pixels' own is followed by zero.
    bytes[at..].windows(2).any(|pair| pair == b"\xff\xd9")
}

/// Where the first scan begins.
fn first_scan(bytes: &[u8]) -> Option<usize> {
    let mut at = 2;
    while let Some(&[mark, kind, high, low]) = bytes.get(at..at + 4) {
        match (mark, kind) {
            (0xff, 0xda) => break,
            (0xff, 0x01 | 0xd0..=0xd8) => at += 2,
            (0xff, 0x02..=0xfe) => at += 2 + usize::from(u16::from_be_bytes([high, low])),
            // Filling, or what a careless program left between segments.
            _ => at += 1,
        }
    }
    (at <= bytes.len()).then_some(at)
}

/// Where the image ends, behind its scans and what is between them: what follows is none of it, whatever bytes it has.
fn end(bytes: &[u8]) -> Option<usize> {
    let mut at = first_scan(bytes)?;
    while let Some(&[mark, kind]) = bytes.get(at..at + 2) {
        match (mark, kind) {
            (0xff, 0xd9) => return Some(at + 2),
            // Pixels, which have marks of their own, and filling.
            (0xff, 0x00 | 0x01 | 0xd0..=0xd8) => at += 2,
            (0xff, 0x02..=0xfe) => {
                let length = bytes.get(at + 2..at + 4)?;
                at += 2 + usize::from(u16::from_be_bytes([length[0], length[1]]));
            }
            _ => at += 1,
        }
    }
    None
}
