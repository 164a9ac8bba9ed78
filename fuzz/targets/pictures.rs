//! Images and maps of depth.

use mesh_core::{ByteImage, DepthMap, Image};

/// An image that is not the same everywhere.
fn small() -> ByteImage {
    let data = (0..5 * 7 * 3).map(|k| (k * 37 % 256) as u8).collect();
    ByteImage { height: 5, width: 7, channels: 3, data }
}

/// PNG and JPEG, whichever it is.
pub(crate) fn picture(bytes: &[u8]) {
    if let Ok(image) = mesh_core::decode_image(bytes, "a.png") {
        let _ = (image.over([255; 3]), image.alpha());
    }
    let _ = mesh_core::decode_depth_png(bytes, "a.png", 0.001);
}

pub(crate) fn png_seeds() -> Vec<Vec<u8>> {
    let gray = ByteImage { height: 3, width: 4, channels: 1, data: vec![9; 12] };
    let alpha = ByteImage { height: 3, width: 4, channels: 4, data: vec![90; 48] };
    [small(), gray, alpha].iter().map(mesh_core::encode_png).collect()
}

pub(crate) fn jpeg_seeds() -> Vec<Vec<u8>> {
    vec![
        include_bytes!(
            "../../datasets/tests/fixtures/photos/cub/CUB_200_2011/images/001.Lopsided_Bird/Bird_val_0.jpg"
        )
        .to_vec(),
    ]
}

pub(crate) fn exr(bytes: &[u8]) {
    let _ = mesh_core::decode_depth(bytes, "a.exr");
}

pub(crate) fn exr_seeds() -> Vec<Vec<u8>> {
    let depth = DepthMap { height: 3, width: 4, data: (0..12).map(|k| k as f32).collect() };
    let image = Image { height: 2, width: 2, channels: 3, data: vec![0.5; 12] };
    vec![mesh_core::encode_depth(&depth), mesh_core::encode_exr(&image)]
}

pub(crate) fn pfm(bytes: &[u8]) {
    let _ = mesh_core::decode_pfm(bytes, "a.pfm");
}

pub(crate) fn pfm_seeds() -> Vec<Vec<u8>> {
    let image = |channels| Image { height: 2, width: 3, channels, data: vec![0.5; 6 * channels] };
    [1, 3].map(|channels| mesh_core::encode_pfm(&image(channels))).to_vec()
}
