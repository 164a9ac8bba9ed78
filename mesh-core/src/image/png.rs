//! PNG, by the crate `png`.

use std::io::Cursor;
use std::path::Path;

use png::{BitDepth, ColorType, Compression, Decoder, Encoder, Filter, Transformations};

use super::decoded::Decoded;
use super::error::{too_large, too_many, undecodable};
use super::exif::Orientation;
use super::{ByteImage, ImageError};
use crate::Limits;

/// How a file begins.
pub(super) const SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";
/// What else than pixels a file may unpack to: colour profiles are compressed, and not used here.
const BESIDE: usize = 8 << 20;
/// Deflate makes at most 1032 bytes of one.
const DEFLATE_RATIO: u64 = 1032;

pub(super) fn decode(bytes: &[u8], name: &Path, limits: &Limits) -> Result<Decoded, ImageError> {
    let failed = undecodable(name);
    let mut most = BESIDE + 4 * bytes.len();
    if let Some([width, height]) = size(bytes) {
        too_many(name, (width as usize, height as usize), 0, limits)?;
        // The decoder counts a row as memory beside the pixels.
        most += 8 * width as usize;
    }
    let mut decoder = Decoder::new_with_limits(Cursor::new(bytes), png::Limits { bytes: most });
    decoder.set_transformations(Transformations::EXPAND);
    decoder.set_ignore_text_chunk(true);
    let mut reader = decoder.read_info().map_err(&failed)?;
    let info = reader.info();
    let (width, height) = (info.width as usize, info.height as usize);
    // Palettes and single bits grow up to 32-fold when unpacked into colours.
    let small = info.color_type == ColorType::Indexed || (info.bit_depth as u8) < 8;
    let orientation = info.exif_metadata.as_deref().and_then(Orientation::of);
    let (color, depth) = reader.output_color_type();
    let length = reader.output_buffer_size();
    let claimed = length.map_or(u64::MAX, |length| length as u64);
    let packed = if small { claimed / 32 } else { claimed / 4 };
    let possible = (bytes.len() as u64).saturating_mul(DEFLATE_RATIO);
    too_large(name, (width, height), packed, possible, bytes.len())?;
    too_many(name, (width, height), claimed, limits)?;
    let mut data = vec![0; length.unwrap_or_default()];
    reader.next_frame(&mut data).map_err(&failed)?;
    let decoded = Decoded {
        height,
        width,
        channels: color.samples(),
        deep: depth == BitDepth::Sixteen,
        data,
        orientation: orientation.unwrap_or_default(),
    };
    Ok(decoded)
}

/// Columns and rows, by the header.
fn size(bytes: &[u8]) -> Option<[u32; 2]> {
    let number = |at: usize| Some(u32::from_be_bytes(bytes.get(at..at + 4)?.try_into().ok()?));
    Some([number(16)?, number(20)?])
}

/// Packed for speed rather than size. The image is not empty, and of 1 to 4 channels.
pub(super) fn encode(image: &ByteImage) -> Vec<u8> {
    let color = match image.channels {
        1 => ColorType::Grayscale,
        2 => ColorType::GrayscaleAlpha,
        3 => ColorType::Rgb,
        4 => ColorType::Rgba,
        n => panic!("encode_png: {n} channels, expected 1 to 4"),
    };
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, image.width as u32, image.height as u32);
    encoder.set_color(color);
    encoder.set_compression(Compression::Fast);
    encoder.set_filter(Filter::Adaptive);
    let writer = encoder.write_header();
    let written = writer.and_then(|mut writer| {
        writer.write_image_data(&image.data)?;
        writer.finish()
    });
    written.expect("a checked image into memory");
    bytes
}
