//! A prediction above the image that it was made from.

use mesh_core::{ByteImage, TriMesh};
use synth::{Lighting, RenderOptions, render_views};
use train::report::ViewPair;

use super::picture::Picture;

/// Side of the images that are shown, pixels.
const SIDE: usize = 192;

/// A mesh of the world, lit and seen from the image's camera, above the image.
pub(crate) fn picture_above(picture: &Picture, mesh: &TriMesh, caption: String) -> ViewPair {
    let side = picture.camera.width;
    let truth = ByteImage { height: side, width: side, channels: 3, data: picture.image.clone() };
    let camera = picture.camera.resized(SIDE, SIDE);
    let options = RenderOptions {
        lighting: Lighting::studio(),
        background: [1.0; 3],
        ..RenderOptions::default()
    };
    let rendered = render_views(mesh, &[camera], &options, &|_, _| ());
    let model = rendered.ok().and_then(|mut views| views.pop()).map(|view| view.color);
    let truth = truth.resized(SIDE, SIDE);
    let blank = || ByteImage { data: vec![255; 3 * SIDE * SIDE], ..truth.clone() };
    ViewPair { caption, model: model.unwrap_or_else(blank), truth }
}
