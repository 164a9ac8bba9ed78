//! PNG and JPEG, the only such code in the workspace.

use std::path::Path;

use super::decoded::Decoded;
use super::error::undecodable;
use super::{ByteImage, DepthMap, ImageError, jpeg, png};
use crate::Limits;
use crate::io::{WriteError, regular, write_atomic};

/// Reads a PNG or JPEG file: 1 to 4 channels as the file has them, 16 bits rounded to 8.
///
/// The orientation that cameras note in EXIF is applied, so row 0 is the top of the scene.
///
/// # Errors
/// The file cannot be read, is no image, is damaged or cut short, or its header claims what cannot be or
/// more pixels than the default [`Limits`] allow.
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
    StoredImage::decode(bytes, name, limits).map(|image| image.upright().into_bytes())
}

/// A picture as its file has it, for those who count its pixels as programs do that ignore the EXIF orientation, and for pictures whose
/// numbers are labels.
#[derive(Debug)]
pub struct StoredImage(Decoded);

impl StoredImage {
    /// Of a PNG or JPEG in memory; `name` stands for it in errors.
    ///
    /// # Errors
    /// As [`read_image`].
    pub fn decode(
        bytes: &[u8],
        name: impl AsRef<Path>,
        limits: &Limits,
    ) -> Result<Self, ImageError> {
        decode(bytes, name.as_ref(), limits).map(Self)
    }

    /// Whether the EXIF orientation makes columns of the stored rows.
    pub fn is_lying(&self) -> bool {
        self.0.orientation.is_lying()
    }

    /// The EXIF orientation applied: the top of the scene in row 0.
    #[must_use]
    pub fn upright(self) -> Self {
        Self(self.0.upright())
    }

    /// 1 to 4 channels as the file has them, 16 bits rounded to 8.
    pub fn into_bytes(self) -> ByteImage {
        self.0.into_bytes()
    }

    /// The same, but 16 bits whose colours are all below 256 stay the numbers that they are: labels, of which rounding would leave
    /// nothing.
    pub fn into_labels(self) -> ByteImage {
        self.0.into_labels()
    }
}

/// Reads depth from a grey PNG, as nerfstudio (16 bits, millimetres) and BOP keep it.
///
/// A pixel's depth is its value times `unit`; 0 is a hole. Of a picture whose colours are all grey the first channel is taken.
///
/// # Errors
/// As [`read_image`]; if the picture has colours, which are no depth.
pub fn read_depth_png(path: impl AsRef<Path>, unit: f32) -> Result<DepthMap, ImageError> {
    let path = path.as_ref();
    decode_depth_png(&read_bytes(path)?, path, unit)
}

/// [`read_depth_png`] for bytes that are already in memory; `name` stands for them in errors.
///
/// # Errors
/// As [`read_depth_png`].
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
/// As [`read_depth_png`].
pub fn decode_depth_png_with(
    bytes: &[u8],
    name: impl AsRef<Path>,
    unit: f32,
    limits: &Limits,
) -> Result<DepthMap, ImageError> {
    let decoded = decode(bytes, name.as_ref(), limits)?.upright();
    if decoded.is_colored() {
        return Err(ImageError::Colored { path: name.as_ref().to_owned() });
    }
    let (height, width, values) = decoded.into_gray();
    let depth = |v: u16| if v == 0 { f32::INFINITY } else { f32::from(v) * unit };
    Ok(DepthMap { height, width, data: values.map(depth).collect() })
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
    png::encode(image)
}

pub(super) fn read_bytes(path: &Path) -> Result<Vec<u8>, ImageError> {
    regular(path).map_err(|source| ImageError::Io { path: path.to_owned(), source })
}

/// Whether the bytes begin as a kind of image that [`decode_image`] knows.
#[cfg(feature = "files")]
pub(crate) fn is_known_kind(bytes: &[u8]) -> bool {
    bytes.starts_with(png::SIGNATURE) || bytes.starts_with(jpeg::SIGNATURE)
}

/// Pixels of bytes whose header claims no more than the limits allow and the bytes can hold, as they are stored.
fn decode(bytes: &[u8], name: &Path, limits: &Limits) -> Result<Decoded, ImageError> {
    if bytes.starts_with(png::SIGNATURE) {
        return png::decode(bytes, name, limits);
    }
    if bytes.starts_with(jpeg::SIGNATURE) {
        return jpeg::decode(bytes, name, limits);
    }
    Err(undecodable(name)("the first bytes are neither PNG's nor JPEG's"))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use jpeg_encoder::{ColorType, Encoder};
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
        let raw: Vec<u8> = [0_u16, 65535, 1000, 128].iter().flat_map(|v| v.to_be_bytes()).collect();
        let mut png = Vec::new();
        let mut encoder = ::png::Encoder::new(&mut png, 4, 1);
        encoder.set_depth(::png::BitDepth::Sixteen);
        encoder.write_header().unwrap().write_image_data(&raw).unwrap();
        std::fs::write(&path, &png).unwrap();
        assert_eq!(read_image(&path).unwrap().data, [0, 255, 4, 0]);
        let depth = read_depth_png(&path, 0.001).unwrap().data;
        assert_eq!(depth[0], f32::INFINITY);
        assert!((depth[2] - 1.0).abs() < 1e-6);
    }

    #[test]
    fn depth_is_gray_in_any_number_of_channels() {
        for channels in 1..=4 {
            // Alpha is nothing that depth has.
            let data = (0..3 * channels).map(|i| {
                let alpha = channels % 2 == 0 && i % channels == channels - 1;
                if alpha { 9 * i as u8 } else { [0, 10, 200][i / channels] }
            });
            let image = ByteImage { height: 1, width: 3, channels, data: data.collect() };
            let depth = decode_depth_png(&encode_png(&image), "a.png", 0.5).unwrap();
            assert_eq!(depth.data, [f32::INFINITY, 5.0, 100.0], "{channels}");
        }
        for channels in [3, 4] {
            let png = encode_png(&picture(channels));
            let error = decode_depth_png(&png, "a.png", 1.0).unwrap_err().to_string();
            assert!(error.contains("a.png") && error.contains("grey PNG"), "{error}");
        }
    }

    /// A JPEG with the left half white, and the given EXIF orientation.
    fn jpeg(orientation: u8) -> Vec<u8> {
        let mut data = vec![0_u8; 16 * 32 * 3];
        for row in data.chunks_exact_mut(32 * 3) {
            row[..16 * 3].fill(255);
        }
        let mut bytes = Vec::new();
        Encoder::new(&mut bytes, 95).encode(&data, 32, 16, ColorType::Rgb).unwrap();
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
        let stored = StoredImage::decode(&jpeg(6), "a.jpg", &Limits::default()).unwrap();
        assert!(stored.is_lying());
        assert_eq!(stored.into_bytes(), upright);
    }

    #[test]
    fn sixteen_bits_of_labels_are_not_rounded() {
        let labels = |color: ::png::ColorType, values: &[u16]| {
            let mut png = Vec::new();
            let mut encoder = ::png::Encoder::new(&mut png, 2, 1);
            encoder.set_color(color);
            encoder.set_depth(::png::BitDepth::Sixteen);
            let raw: Vec<u8> = values.iter().flat_map(|v| v.to_be_bytes()).collect();
            encoder.write_header().unwrap().write_image_data(&raw).unwrap();
            let image = StoredImage::decode(&png, "a.png", &Limits::default()).unwrap();
            image.into_labels().data
        };
        assert_eq!(labels(::png::ColorType::Grayscale, &[0, 1]), [0, 1]);
        assert_eq!(labels(::png::ColorType::Grayscale, &[3, 255]), [3, 255]);
        assert_eq!(labels(::png::ColorType::Grayscale, &[1, 65535]), [0, 255]);
        let with_alpha = ::png::ColorType::GrayscaleAlpha;
        assert_eq!(labels(with_alpha, &[0, 65535, 1, 0]), [0, 255, 1, 0]);
    }

    #[test]
    fn a_jpeg_without_its_end_is_refused() {
        let whole = jpeg(1);
        let error =
            |bytes: &[u8]| decode_image(bytes, "7.jpg").map(|_| ()).unwrap_err().to_string();
        // A thumbnail in the header has an end of its own.
        let mut thumbnail = whole.clone();
        let length = (whole.len() as u16 + 2).to_be_bytes();
        thumbnail.splice(2..2, [&[0xff, 0xe1], &length[..], &whole].concat());
        for bytes in [&whole, &thumbnail] {
            assert!(decode_image(bytes, "7.jpg").is_ok());
            for cut in [2, 10, 20] {
                let error = error(&bytes[..bytes.len() - cut]);
                assert!(error.contains("7.jpg") && error.contains("too early"), "{cut}: {error}");
            }
        }
        // What cameras leave behind the end does not matter.
        for tail in [&[0; 64][..], &whole[..whole.len() - 9], b"ftypmp42\xff\xda\0\x08"] {
            assert!(decode_image(&[&whole, tail].concat(), "7.jpg").is_ok());
        }
        // Not even the bytes by which scans begin, which a film has by chance.
        let film = b"\xff\xda\0\x08film".repeat(1000);
        let behind = decode_image(&[&whole, &film[..]].concat(), "7.jpg").unwrap();
        assert_eq!(behind, decode_image(&whole, "7.jpg").unwrap());
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
        let text = error.to_string();
        assert!(!text.contains("0 bytes") && text.contains("make the image smaller"), "{text}");
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
