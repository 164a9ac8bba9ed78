//! Depth and disparity from files of their own.

use std::path::Path;

use mesh_core::{DepthMap, DisparityMap, ImageError, read_depth, read_depth_png, read_pfm};

use crate::error::ReadViewsError;
use crate::formats::npy;
use crate::source::read_file;

/// What the numbers of a file may mean at most: depths from here on are background.
const FAR: f32 = 1e9;
/// 128 megapixels of the widest numbers.
const MOST_BYTES: u64 = 1 << 30;

/// Reads planar depth: EXR, PFM, npy, or a grey PNG of 8 or 16 bits.
///
/// Every number is multiplied with `unit` (0.001 where a PNG holds millimetres). What is not finite, not above
/// zero or at least 1e9 is background, `+inf`. Three channels that hold the same are taken for one; an npy is
/// `[H, W]`, `[H, W, 1]`, `[1, H, W]` or `[1, 1, H, W]`.
///
/// # Errors
/// The file cannot be read, is none of these, is damaged, or is an image in colour.
pub fn read_depth_file(path: impl AsRef<Path>, unit: f32) -> Result<DepthMap, ReadViewsError> {
    let ([height, width], mut data) = numbers(path.as_ref())?;
    for value in &mut data {
        let depth = *value * unit;
        *value = if *value > 0.0 && *value < FAR { depth } else { f32::INFINITY };
    }
    Ok(DepthMap { height, width, data })
}

/// Reads disparity, as MiDaS and its like leave it: the same files, the numbers as they stand.
///
/// Zero is far away, or, in the form of 16 bits that MiDaS writes, what was farthest. Only what is not finite
/// is unknown, `+inf`.
///
/// # Errors
/// As [`read_depth_file`].
pub fn read_disparity_file(path: impl AsRef<Path>) -> Result<DisparityMap, ReadViewsError> {
    let path = path.as_ref();
    let ([height, width], mut data) = numbers(path)?;
    // Zero is a hole in a depth map of integers; in disparity it is a number.
    let integers = extension(path) == "png";
    for value in &mut data {
        if !value.is_finite() {
            *value = if integers { 0.0 } else { f32::INFINITY };
        }
    }
    Ok(DisparityMap { height, width, data })
}

/// Height, width and the numbers of a file as they stand in it.
fn numbers(path: &Path) -> Result<([usize; 2], Vec<f32>), ReadViewsError> {
    let failed = |error: ImageError| ReadViewsError::new(path, error);
    let of = |map: DepthMap| ([map.height, map.width], map.data);
    match extension(path).as_str() {
        "exr" => read_depth(path).map(of).map_err(failed),
        "png" => read_depth_png(path, 1.0).map(of).map_err(failed),
        "pfm" => {
            let image = read_pfm(path).map_err(failed)?;
            let gray = |pixel: &[f32]| pixel.iter().all(|v| v.to_bits() == pixel[0].to_bits());
            if !image.data.chunks_exact(image.channels).all(gray) {
                return Err(failed(ImageError::Colored { path: path.to_owned() }));
            }
            let first = image.data.iter().step_by(image.channels).copied().collect();
            Ok(([image.height, image.width], first))
        }
        "npy" => {
            let bytes = read_file(path, "depth", MOST_BYTES)?;
            npy::read_image(&bytes)
                .map(|image| (image.size, image.data))
                .map_err(|e| ReadViewsError::field(path, e.field, e.found, e.expected))
        }
        other => {
            let found = if other.is_empty() { "none" } else { other };
            let expected = "exr, pfm, npy or png";
            Err(ReadViewsError::field(path, "extension", found, expected))
        }
    }
}

/// The extension in lower case; empty where there is none.
fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use std::path::PathBuf;

    use mesh_core::{ByteImage, Image, encode_pfm, write_depth};

    use super::*;

    const VALUES: [f32; 6] = [1.5, 2.0, 0.25, 3.0, f32::INFINITY, 7.0];

    fn files() -> (tempfile::TempDir, Vec<PathBuf>) {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let (height, width, data) = (2, 3, VALUES.to_vec());
        write_depth(at("a.exr"), &DepthMap { height, width, data: data.clone() }).unwrap();
        let image = Image { height, width, channels: 1, data };
        std::fs::write(at("a.PFM"), encode_pfm(&image)).unwrap();
        let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 2, 3), }";
        let mut bytes = b"\x93NUMPY\x01\0".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.bytes());
        bytes.extend(VALUES.iter().flat_map(|v| v.to_le_bytes()));
        std::fs::write(at("a.npy"), bytes).unwrap();
        let paths = vec![at("a.exr"), at("a.PFM"), at("a.npy")];
        (folder, paths)
    }

    #[test]
    fn every_form_of_the_same_numbers() {
        let (_folder, paths) = files();
        for path in paths {
            let depth = read_depth_file(&path, 2.0).unwrap();
            assert_eq!((depth.height, depth.width), (2, 3));
            assert_eq!(depth.data, VALUES.map(|v| 2.0 * v), "{}", path.display());
            assert_eq!(read_disparity_file(&path).unwrap().data, VALUES, "{}", path.display());
        }
    }

    #[test]
    fn holes_are_background_in_depth_and_far_away_in_disparity() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.pfm");
        let data = vec![-1.0, 0.0, f32::NAN, 1e10, 2.0, 3.0];
        let image = Image { height: 1, width: 6, channels: 1, data };
        std::fs::write(&path, encode_pfm(&image)).unwrap();
        let none = f32::INFINITY;
        let depth = read_depth_file(&path, 1.0).unwrap().data;
        assert_eq!(depth, [none, none, none, none, 2.0, 3.0]);
        let disparity = read_disparity_file(&path).unwrap().data;
        assert_eq!(disparity, [-1.0, 0.0, none, 1e10, 2.0, 3.0]);
    }

    #[test]
    fn gray_pictures() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let gray = ByteImage { height: 1, width: 3, channels: 1, data: vec![0, 10, 200] };
        mesh_core::write_png(&path, &gray).unwrap();
        assert_eq!(read_depth_file(&path, 0.5).unwrap().data, [f32::INFINITY, 5.0, 100.0]);
        assert_eq!(read_disparity_file(&path).unwrap().data, [0.0, 10.0, 200.0]);
    }

    #[test]
    fn pictures_in_color_are_no_depth() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let (height, width, channels) = (1, 2, 3);
        let colors = Image { height, width, channels, data: VALUES.to_vec() };
        std::fs::write(at("a.pfm"), encode_pfm(&colors)).unwrap();
        let bytes = ByteImage { height, width, channels, data: vec![200, 90, 40, 1, 2, 3] };
        mesh_core::write_png(at("a.png"), &bytes).unwrap();
        for name in ["a.pfm", "a.png"] {
            let depth = read_depth_file(at(name), 1.0).unwrap_err().to_string();
            let disparity = read_disparity_file(at(name)).unwrap_err().to_string();
            assert!(depth.contains(name) && depth.contains("in colour"), "{depth}");
            assert_eq!(depth, disparity);
        }
        let gray = Image { data: vec![2.0, 2.0, 2.0, 7.0, 7.0, 7.0], ..colors };
        std::fs::write(at("b.pfm"), encode_pfm(&gray)).unwrap();
        assert_eq!(read_depth_file(at("b.pfm"), 1.0).unwrap().data, [2.0, 7.0]);
    }

    #[test]
    fn errors_name_the_file_and_what_is_wrong() {
        let folder = tempfile::tempdir().unwrap();
        let text = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            read_depth_file(&path, 1.0).unwrap_err().to_string()
        };
        let odd = text("a.tiff", b"");
        assert!(odd.contains("a.tiff") && odd.contains("found tiff, expected exr"), "{odd}");
        assert!(text("depth", b"").contains("found none"));
        assert!(text("b.pfm", b"P6").contains("b.pfm"));
        let header =
            "{'descr': '<f4', 'fortran_order': False, 'shape': (4294967296, 4294967296), }";
        let mut bytes = b"\x93NUMPY\x01\0".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.bytes());
        let huge = text("c.npy", &bytes);
        assert!(huge.contains("c.npy") && huge.contains("4294967296"), "{huge}");
        let missing = read_depth_file(folder.path().join("d.npy"), 1.0).unwrap_err().to_string();
        assert!(missing.contains("d.npy"), "{missing}");
    }
}
