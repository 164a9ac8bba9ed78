//! One image of a mesh, and all that is known of its pixels.

use datasets::View;
use mesh_core::{ByteImage, Image};
use serde::{Deserialize, Serialize};

/// The frame of normals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NormalSpace {
    /// The camera's: x right, y up, z towards the viewer.
    Camera,
    /// The mesh's own.
    World,
}

/// All that is kept of one image of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Rendering {
    /// The image over its background, the mask, the camera, and depth where it was asked for.
    pub view: View,
    /// The image with straight alpha, `[H, W, 4]`, sRGB: where [`RenderOptions::alpha`](super::RenderOptions::alpha) is set.
    ///
    /// Alpha is the share of the samples that show the object, kept on the mask's side of one half,
    /// so that `alpha >= 128` is the mask exactly. Under alpha 0 stands the background.
    pub rgba: Option<ByteImage>,
    /// Unit outward normals at the pixels' centres, `[H, W, 3]`, zero at background: where
    /// [`RenderOptions::normals`](super::RenderOptions::normals) is set. Creases are those of the lighting.
    pub normals: Option<Image>,
}

impl Rendering {
    /// The normals as colours, `(n + 1) / 2`, with black background.
    pub fn normal_image(&self) -> Option<ByteImage> {
        let Image { height, width, ref data, .. } = *self.normals.as_ref()?;
        let seen = self.view.mask.data.iter();
        let data = data.chunks_exact(3).zip(seen).flat_map(|(n, &seen)| {
            let byte = |v: f32| ((0.5 * v + 0.5).clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
            if seen == 0 { [0; 3] } else { [byte(n[0]), byte(n[1]), byte(n[2])] }
        });
        Some(ByteImage { height, width, channels: 3, data: data.collect() })
    }
}
