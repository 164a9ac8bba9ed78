//! A prediction above the image that it was made from.

use mesh_core::{ByteImage, Camera, TriMesh};
use synth::{RenderOptions, render_view};
use train::report::ViewPair;

use super::input_image::InputImage;

/// Side of the images that are shown, pixels.
const SIDE: usize = 192;

/// A mesh of the world, lit and seen from the image's camera, above the image.
pub(crate) fn mesh_above_image(image: &InputImage, mesh: &TriMesh, caption: String) -> ViewPair {
    let side = image.camera.width;
    let truth = ByteImage { height: side, width: side, channels: 3, data: image.pixels.clone() };
    let camera = image.camera.resized(SIDE, SIDE);
    ViewPair { caption, model: in_studio(mesh, &camera), truth: truth.resized(SIDE, SIDE) }
}

/// A mesh lit before white; white alone where it is no mesh.
pub(crate) fn in_studio(mesh: &TriMesh, camera: &Camera) -> ByteImage {
    render_view(mesh, camera, &RenderOptions::studio()).map_or_else(
        |_| {
            let mut blank = ByteImage::new(camera.height, camera.width, 3);
            blank.data.fill(255);
            blank
        },
        |view| view.color,
    )
}
