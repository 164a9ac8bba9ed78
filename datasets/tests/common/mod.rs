//! Small sets of views, and the ways to spoil them.
#![allow(dead_code, reason = "every test file uses its own part")]
#![allow(clippy::unwrap_used, reason = "tests")]

use std::io::Write;
use std::path::{Path, PathBuf};

use datasets::{ReadOptions, ReadViewsError, View, Views, read_views};
use mesh_core::{ByteImage, Camera, DepthMap};

/// Views of a ball of radius 1 at the origin, from `count` places around it, wide images.
pub(crate) fn ball(count: usize) -> Vec<View> {
    let (width, height) = (40, 30);
    (0..count)
        .map(|i| {
            let angle = i as f64 * 2.4;
            let eye = [4.0 * angle.cos(), 1.0 + 0.3 * i as f64, 4.0 * angle.sin()];
            let camera = Camera::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 0.8, width, height);
            let mut color = ByteImage::new(height, width, 3);
            let mut mask = ByteImage::new(height, width, 1);
            let mut depth = vec![f32::INFINITY; height * width];
            for k in 0..height * width {
                let ray = camera.ray((k % width) as f64 + 0.5, (k / width) as f64 + 0.5);
                let along: f64 = (0..3).map(|a| -ray.origin[a] * ray.direction[a]).sum();
                let squared: f64 = ray.origin.iter().map(|o| o * o).sum::<f64>() - along * along;
                if squared < 1.0 {
                    mask.data[k] = 255;
                    color.data[3 * k..3 * k + 3].copy_from_slice(&[200, (i * 7) as u8, 40]);
                    depth[k] = (along - (1.0 - squared).sqrt()) as f32;
                }
            }
            let depth = Some(DepthMap { height, width, data: depth });
            View { name: i.to_string(), color, mask, camera, depth, crop: None }
        })
        .collect()
}

/// A temporary folder with the ball in kaolin's layout.
pub(crate) fn kaolin_folder(count: usize) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    datasets::write_kaolin(&ball(count), folder.path()).unwrap();
    folder
}

/// A temporary folder with the ball as `transforms.json`.
pub(crate) fn transforms_folder(count: usize) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    datasets::write_transforms(&ball(count), folder.path()).unwrap();
    folder
}

/// Reads with the default options.
pub(crate) fn read(path: &Path) -> Result<Views, ReadViewsError> {
    read_views(path, &ReadOptions::default(), &|_, _| {})
}

/// Changes the text of a file.
pub(crate) fn edit(path: &Path, change: impl FnOnce(String) -> String) {
    let text = std::fs::read_to_string(path).unwrap();
    let changed = change(text.clone());
    assert_ne!(text, changed, "the edit of {} changed nothing", path.display());
    std::fs::write(path, changed).unwrap();
}

/// Changes the JSON of a file.
pub(crate) fn edit_json(path: &Path, change: impl FnOnce(&mut serde_json::Value)) {
    edit(path, |text| {
        let mut value: serde_json::Value = serde_json::from_str(&text).unwrap();
        change(&mut value);
        value.to_string()
    });
}

/// Packs a folder into a zip, inside one folder as people do.
pub(crate) fn zipped(folder: &Path) -> (tempfile::TempDir, PathBuf) {
    let out = tempfile::tempdir().unwrap();
    let path = out.path().join("views.zip");
    let mut zip = zip::ZipWriter::new(std::fs::File::create(&path).unwrap());
    let options = zip::write::SimpleFileOptions::default();
    zip.add_directory("clock/", options).unwrap();
    for entry in std::fs::read_dir(folder).unwrap() {
        let entry = entry.unwrap();
        zip.start_file(format!("clock/{}", entry.file_name().to_str().unwrap()), options).unwrap();
        zip.write_all(&std::fs::read(entry.path()).unwrap()).unwrap();
    }
    zip.finish().unwrap();
    (out, path)
}

/// Gives a PNG an EXIF orientation.
pub(crate) fn orient(path: &Path, orientation: u8) {
    let mut bytes = std::fs::read(path).unwrap();
    // One entry of a big-endian TIFF: tag 0x112, a short.
    let mut chunk = b"eXIfMM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0".to_vec();
    chunk.extend([orientation, 0, 0, 0, 0, 0, 0]);
    let length = (chunk.len() as u32 - 4).to_be_bytes();
    let crc = !chunk.iter().fold(!0_u32, |crc, &b| {
        (0..8).fold(crc ^ u32::from(b), |c, _| (c >> 1) ^ (0xedb8_8320 & 0_u32.wrapping_sub(c & 1)))
    });
    // Behind the signature and IHDR.
    bytes.splice(33..33, [&length[..], &chunk, &crc.to_be_bytes()].concat());
    std::fs::write(path, bytes).unwrap();
}
