//! PNG and JPEG, the only such code in the workspace.

use std::io::Cursor;
use std::path::Path;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{
    DynamicImage, ExtendedColorType, ImageDecoder, ImageEncoder, ImageFormat, ImageReader, Limits,
};

use super::{ByteImage, DepthMap, ImageError};
use crate::io::{WriteError, write_atomic};

/// The largest image that is unpacked: 16384 x 16384 with four channels.
const LARGEST: u64 = 1 << 30;
/// Deflate makes at most 1032 bytes of one.
const DEFLATE_RATIO: u64 = 1032;
/// A block of 64 pixels takes at least a bit, once per plane.
const JPEG_RATIO: u64 = 8192;

/// Reads a PNG or JPEG file: 1 to 4 channels as the file has them, 16 bits rounded to 8.
///
/// The orientation that cameras note in EXIF is applied, so row 0 is the top of the scene.
///
/// # Errors
/// The file cannot be read, is no image, is damaged, or its header claims what cannot be.
pub fn read_image(path: impl AsRef<Path>) -> Result<ByteImage, ImageError> {
    let path = path.as_ref();
    decode_image(&read_bytes(path)?, path)
}

/// The same for bytes that are already in memory; `name` stands for them in errors.
///
/// # Errors
/// As [`read_image`].
pub fn decode_image(bytes: &[u8], name: impl AsRef<Path>) -> Result<ByteImage, ImageError> {
    let image = decode(bytes, name.as_ref())?;
    let (width, height) = (image.width() as usize, image.height() as usize);
    let channels = image.color().channel_count() as usize;
    let data = match channels {
        1 => image.into_luma8().into_raw(),
        2 => image.into_luma_alpha8().into_raw(),
        3 => image.into_rgb8().into_raw(),
        _ => image.into_rgba8().into_raw(),
    };
    Ok(ByteImage { height, width, channels, data })
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

/// The same for bytes that are already in memory; `name` stands for them in errors.
///
/// # Errors
/// As [`read_image`].
pub fn decode_depth_png(
    bytes: &[u8],
    name: impl AsRef<Path>,
    unit: f32,
) -> Result<DepthMap, ImageError> {
    let image = decode(bytes, name.as_ref())?;
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
    std::fs::read(path).map_err(|source| ImageError::Io { path: path.to_owned(), source })
}

fn decode(bytes: &[u8], name: &Path) -> Result<DynamicImage, ImageError> {
    let failed = |what: String| ImageError::Decode { path: name.to_owned(), what };
    let mut reader = ImageReader::new(Cursor::new(bytes))
        .with_guessed_format()
        .map_err(|e| failed(e.to_string()))?;
    if reader.format().is_none() {
        return Err(failed("the first bytes are neither PNG's nor JPEG's".to_owned()));
    }
    let ratio = match reader.format() {
        Some(ImageFormat::Png) => DEFLATE_RATIO,
        _ => JPEG_RATIO,
    };
    let limit = LARGEST.min((bytes.len() as u64).saturating_mul(ratio));
    let mut limits = Limits::default();
    limits.max_alloc = Some(LARGEST);
    reader.limits(limits);
    let mut decoder = reader.into_decoder().map_err(|e| failed(e.to_string()))?;
    let ((width, height), claimed) = (decoder.dimensions(), decoder.total_bytes());
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
    if packed > limit || claimed > LARGEST {
        return Err(ImageError::TooLarge {
            path: name.to_owned(),
            width: u64::from(width),
            height: u64::from(height),
            bytes: claimed,
            limit,
            length: bytes.len() as u64,
        });
    }
    let orientation = decoder.orientation().map_err(|e| failed(e.to_string()))?;
    let mut image = DynamicImage::from_decoder(decoder).map_err(|e| failed(e.to_string()))?;
    image.apply_orientation(orientation);
    Ok(image)
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
        assert!(matches!(error, ImageError::TooLarge { width: 1_048_575, .. }), "{error}");
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
