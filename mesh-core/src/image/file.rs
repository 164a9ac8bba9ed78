//! PNG and JPEG, the only such code in the workspace.

use std::io::Cursor;
use std::path::Path;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::metadata::Orientation;
use image::{
    DynamicImage, ExtendedColorType, GrayAlphaImage, GrayImage, ImageDecoder, ImageEncoder,
    ImageFormat, ImageReader, RgbImage, RgbaImage,
};

use super::error::{too_large, too_many, undecodable};
use super::{ByteImage, DepthMap, ImageError};
use crate::Limits;
use crate::io::{WriteError, regular, write_atomic};

/// What else than pixels a PNG may unpack to: colour profiles are compressed, and not used here.
const BESIDE: u64 = 8 << 20;
/// Scans of a progressive JPEG; each goes over the whole image, and real ones have about ten.
const SCANS: usize = 256;
/// Deflate makes at most 1032 bytes of one.
const DEFLATE_RATIO: u64 = 1032;
/// A block of 64 pixels takes at least a bit, once per plane.
const JPEG_RATIO: u64 = 8192;

/// Reads a PNG or JPEG file: 1 to 4 channels as the file has them, 16 bits rounded to 8.
///
/// The orientation that cameras note in EXIF is applied, so row 0 is the top of the scene.
///
/// # Errors
/// The file cannot be read, is no image, is damaged, or its header claims what cannot be or more
/// pixels than the default [`Limits`] allow.
pub fn read_image(path: impl AsRef<Path>) -> Result<ByteImage, ImageError> {
    read_image_with(path, &Limits::default())
}

/// [`read_image`] within other limits.
///
/// # Errors
/// As [`read_image`].
pub fn read_image_with(path: impl AsRef<Path>, limits: &Limits) -> Result<ByteImage, ImageError> {
    let path = path.as_ref();
    decode_image_with(&read_bytes(path)?, path, limits)
}

/// [`read_image`] for bytes that are already in memory; `name` stands for them in errors.
///
/// # Errors
/// As [`read_image`].
pub fn decode_image(bytes: &[u8], name: impl AsRef<Path>) -> Result<ByteImage, ImageError> {
    decode_image_with(bytes, name, &Limits::default())
}

/// [`decode_image`] within other limits.
///
/// # Errors
/// As [`read_image`].
pub fn decode_image_with(
    bytes: &[u8],
    name: impl AsRef<Path>,
    limits: &Limits,
) -> Result<ByteImage, ImageError> {
    let failed = undecodable(name.as_ref());
    let mut decoder = decoder(bytes, name.as_ref(), limits)?;
    let orientation = decoder.orientation().map_err(&failed)?;
    let (width, height) = decoder.dimensions();
    let color = decoder.color_type();
    let channels = usize::from(color.channel_count());
    let mut data = vec![0; decoder.total_bytes() as usize];
    decoder.read_image(&mut data).map_err(&failed)?;
    if color.bytes_per_pixel() > color.channel_count() {
        halve(&mut data);
    }
    let image = ByteImage { height: height as usize, width: width as usize, channels, data };
    Ok(if orientation == Orientation::NoTransforms { image } else { turned(image, orientation) })
}

/// 16 bits a channel rounded to 8, in place.
fn halve(data: &mut Vec<u8>) {
    let half = data.len() / 2;
    for k in 0..half {
        let value = u32::from(u16::from_ne_bytes([data[2 * k], data[2 * k + 1]]));
        data[k] = ((value + 128) / 257) as u8;
    }
    data.truncate(half);
    data.shrink_to_fit();
}

/// The image as its orientation says it is to be seen.
fn turned(image: ByteImage, orientation: Orientation) -> ByteImage {
    let ByteImage { height, width, channels, data } = image;
    let (w, h) = (width as u32, height as u32);
    let dynamic = match channels {
        1 => GrayImage::from_raw(w, h, data).map(DynamicImage::from),
        2 => GrayAlphaImage::from_raw(w, h, data).map(DynamicImage::from),
        3 => RgbImage::from_raw(w, h, data).map(DynamicImage::from),
        _ => RgbaImage::from_raw(w, h, data).map(DynamicImage::from),
    };
    let mut dynamic = dynamic.expect("as many bytes as pixels times channels");
    dynamic.apply_orientation(orientation);
    let (width, height) = (dynamic.width() as usize, dynamic.height() as usize);
    ByteImage { height, width, channels, data: dynamic.into_bytes() }
}

/// Reads depth from a grey PNG, as nerfstudio (16 bits, millimetres) and BOP keep it.
///
/// A pixel's depth is its value times `unit`; 0 is a hole.
///
/// # Errors
/// As [`read_image`].
pub fn read_depth_png(path: impl AsRef<Path>, unit: f32) -> Result<DepthMap, ImageError> {
    let path = path.as_ref();
    decode_depth_png(&read_bytes(path)?, path, unit)
}

/// [`read_depth_png`] for bytes that are already in memory; `name` stands for them in errors.
///
/// # Errors
/// As [`read_image`].
pub fn decode_depth_png(
    bytes: &[u8],
    name: impl AsRef<Path>,
    unit: f32,
) -> Result<DepthMap, ImageError> {
    decode_depth_png_with(bytes, name, unit, &Limits::default())
}

/// [`decode_depth_png`] within other limits.
///
/// # Errors
/// As [`read_image`].
pub fn decode_depth_png_with(
    bytes: &[u8],
    name: impl AsRef<Path>,
    unit: f32,
    limits: &Limits,
) -> Result<DepthMap, ImageError> {
    let failed = undecodable(name.as_ref());
    let mut decoder = decoder(bytes, name.as_ref(), limits)?;
    let orientation = decoder.orientation().map_err(&failed)?;
    let mut image = DynamicImage::from_decoder(decoder).map_err(&failed)?;
    image.apply_orientation(orientation);
    let (width, height) = (image.width() as usize, image.height() as usize);
    // Widening 8 bits to 16 multiplies by 257; the file's own numbers are wanted.
    let values: Vec<u16> = match image {
        DynamicImage::ImageLuma8(grey) => grey.into_raw().into_iter().map(u16::from).collect(),
        other => other.into_luma16().into_raw(),
    };
    let depth = |v: u16| if v == 0 { f32::INFINITY } else { f32::from(v) * unit };
    Ok(DepthMap { height, width, data: values.into_iter().map(depth).collect() })
}

/// Writes a PNG; the file appears whole or not at all.
///
/// # Errors
/// The file cannot be written.
///
/// # Panics
/// As [`encode_png`].
pub fn write_png(path: impl AsRef<Path>, image: &ByteImage) -> Result<(), WriteError> {
    let bytes = encode_png(image);
    write_atomic(path, |w| w.write_all(&bytes))
}

/// A PNG file in memory, packed for speed rather than size.
///
/// # Panics
/// If the image is empty, has other than 1 to 4 channels, or its data is of another length.
pub fn encode_png(image: &ByteImage) -> Vec<u8> {
    let ByteImage { height, width, channels, ref data } = *image;
    assert!(
        height * width > 0 && data.len() == height * width * channels,
        "encode_png: {width} x {height} pixels of {channels} channels in {} bytes",
        data.len()
    );
    let color = match channels {
        1 => ExtendedColorType::L8,
        2 => ExtendedColorType::La8,
        3 => ExtendedColorType::Rgb8,
        4 => ExtendedColorType::Rgba8,
        n => panic!("encode_png: {n} channels, expected 1 to 4"),
    };
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Adaptive)
        .write_image(data, width as u32, height as u32, color)
        .expect("a checked image into memory");
    bytes
}

pub(super) fn read_bytes(path: &Path) -> Result<Vec<u8>, ImageError> {
    regular(path).map_err(|source| ImageError::Io { path: path.to_owned(), source })
}

/// A decoder of bytes whose header claims no more than the limits allow and the bytes can hold.
fn decoder<'a>(
    bytes: &'a [u8],
    name: &Path,
    limits: &Limits,
) -> Result<impl ImageDecoder + use<'a>, ImageError> {
    let failed = undecodable::<String>(name);
    let mut reader =
        ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(undecodable(name))?;
    let ratio = match reader.format() {
        None => return Err(failed("the first bytes are neither PNG's nor JPEG's".to_owned())),
        Some(ImageFormat::Png) => DEFLATE_RATIO,
        _ => JPEG_RATIO,
    };
    if ratio == JPEG_RATIO {
        let scans = bytes.windows(2).filter(|pair| pair == b"\xff\xda");
        if scans.take(SCANS + 1).count() > SCANS {
            return Err(failed(format!("more than {SCANS} scans")));
        }
    }
    let mut own = image::Limits::default();
    own.max_alloc = Some(BESIDE + 4 * bytes.len() as u64);
    if let (Some(ImageFormat::Png), Some([width, height])) = (reader.format(), png_size(bytes)) {
        too_many(name, (width as usize, height as usize), 0, limits)?;
        // The decoder counts a row as memory beside the pixels.
        own.max_alloc = own.max_alloc.map(|most| most + 8 * u64::from(width));
    }
    reader.limits(own);
    let decoder = reader.into_decoder().map_err(undecodable(name))?;
    let ((width, height), claimed) = (decoder.dimensions(), decoder.total_bytes());
    let (width, height) = (width as usize, height as usize);
    // Palettes and single bits grow up to 32-fold when unpacked into colours.
    let packed = match decoder.original_color_type() {
        ExtendedColorType::L1
        | ExtendedColorType::L2
        | ExtendedColorType::L4
        | ExtendedColorType::Rgb1
        | ExtendedColorType::Rgb2
        | ExtendedColorType::Rgb4 => claimed / 32,
        _ => claimed / 4,
    };
    let possible = (bytes.len() as u64).saturating_mul(ratio);
    too_large(name, (width, height), packed, possible, bytes.len())?;
    too_many(name, (width, height), claimed, limits)?;
    Ok(decoder)
}

/// Columns and rows of a PNG, by its header.
fn png_size(bytes: &[u8]) -> Option<[u32; 2]> {
    let number = |at: usize| Some(u32::from_be_bytes(bytes.get(at..at + 4)?.try_into().ok()?));
    Some([number(16)?, number(20)?])
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use image::codecs::jpeg::JpegEncoder;
    use proptest::prelude::*;

    fn picture(channels: usize) -> ByteImage {
        let data = (0..5 * 7 * channels).map(|i| (i * 37 % 256) as u8).collect();
        ByteImage { height: 5, width: 7, channels, data }
    }

    #[test]
    fn png_keeps_every_byte_of_one_to_four_channels() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        for channels in 1..=4 {
            write_png(&path, &picture(channels)).unwrap();
            assert_eq!(read_image(&path).unwrap(), picture(channels));
        }
    }

    #[test]
    fn sixteen_bits_become_eight_or_depth() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let raw: Vec<u8> = [0_u16, 65535, 1000, 128].iter().flat_map(|v| v.to_ne_bytes()).collect();
        let mut png = Vec::new();
        PngEncoder::new(&mut png).write_image(&raw, 4, 1, ExtendedColorType::L16).unwrap();
        std::fs::write(&path, &png).unwrap();
        assert_eq!(read_image(&path).unwrap().data, [0, 255, 4, 0]);
        let depth = read_depth_png(&path, 0.001).unwrap().data;
        assert_eq!(depth[0], f32::INFINITY);
        assert!((depth[2] - 1.0).abs() < 1e-6);
    }

    /// A JPEG with the left half white, and the given EXIF orientation.
    fn jpeg(orientation: u8) -> Vec<u8> {
        let mut data = vec![0_u8; 16 * 32 * 3];
        for row in data.chunks_exact_mut(32 * 3) {
            row[..16 * 3].fill(255);
        }
        let mut bytes = Vec::new();
        JpegEncoder::new_with_quality(&mut bytes, 95)
            .write_image(&data, 32, 16, ExtendedColorType::Rgb8)
            .unwrap();
        // APP1 after SOI: "Exif", a little-endian TIFF header, one entry: tag 0x112, a short.
        let mut exif = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
        exif.extend([orientation, 0, 0, 0, 0, 0, 0, 0]);
        let length = (exif.len() as u16 + 2).to_be_bytes();
        let app1 = [&[0xff, 0xe1], &length[..], &exif].concat();
        bytes.splice(2..2, app1);
        bytes
    }

    #[test]
    fn the_orientation_of_the_camera_is_applied() {
        let upright = decode_image(&jpeg(1), "a.jpg").unwrap();
        assert_eq!((upright.height, upright.width), (16, 32));
        assert!(upright.pixel(8, 4)[0] > 250 && upright.pixel(8, 28)[0] < 5);
        // 6: to be turned a quarter clockwise, so the left side becomes the top.
        let turned = decode_image(&jpeg(6), "a.jpg").unwrap();
        assert_eq!((turned.height, turned.width), (32, 16));
        assert!(turned.pixel(4, 8)[0] > 250 && turned.pixel(28, 8)[0] < 5);
    }

    #[test]
    fn bad_files_name_themselves() {
        let error = |bytes: &[u8]| decode_image(bytes, "views/7.png").unwrap_err().to_string();
        let png = encode_png(&picture(3));
        assert!(error(&png[..png.len() / 2]).contains("views/7.png"));
        assert!(error(b"not an image").contains("neither PNG"));
        assert!(error(b"").contains("views/7.png"));
        assert!(read_image("none.png").unwrap_err().to_string().contains("none.png"));
    }

    #[test]
    fn a_header_that_claims_terabytes_is_refused() {
        let mut png = encode_png(&picture(3));
        // IHDR: width and height at 16..24, its CRC at 29..33.
        png[16..24].copy_from_slice(&[0, 0x0f, 0xff, 0xff, 0, 0x0f, 0xff, 0xff]);
        let crc = crc32(&png[12..29]).to_be_bytes();
        png[29..33].copy_from_slice(&crc);
        let error = decode_image(&png, "a.png").unwrap_err();
        assert!(matches!(error, ImageError::OverLimit { width: 1_048_575, .. }), "{error}");
    }

    fn crc32(bytes: &[u8]) -> u32 {
        !bytes.iter().fold(!0_u32, |mut crc, &b| {
            crc ^= u32::from(b);
            for _ in 0..8 {
                crc = (crc >> 1) ^ (0xedb8_8320 & 0_u32.wrapping_sub(crc & 1));
            }
            crc
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(512))]
        #[test]
        fn damaged_files_are_errors_or_images(
            jpg in any::<bool>(),
            changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
            cut in prop::option::of(any::<prop::sample::Index>()),
        ) {
            let mut bytes = if jpg { jpeg(3) } else { encode_png(&picture(3)) };
            for (at, value) in changes {
                let at = at.index(bytes.len());
                bytes[at] = value;
            }
            if let Some(cut) = cut {
                bytes.truncate(cut.index(bytes.len()));
            }
            let _ = decode_image(&bytes, "fuzz");
        }
    }
}
