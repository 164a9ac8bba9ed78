//! One view as the model takes it.

use datasets::View;
use mesh_core::{ByteImage, Camera, Mask};
use train::{DataError, Fingerprint};

use super::config::Img2MeshConfig;
use crate::view_cache::Stored;

/// One view, resized for encoder and losses, in bytes: thousands stay in memory.
#[derive(Clone, Debug)]
pub(super) struct Prepared {
    pub(super) name: String,
    /// `[S, S, 3]`, black outside of the object if the configuration says so.
    pub(super) image: Vec<u8>,
    /// `[R, R, 3]`, the same.
    pub(super) target: Vec<u8>,
    /// `[R, R]`, the share of the object in each pixel.
    pub(super) mask: Vec<u8>,
    /// `[R, R]`: distance to the mask's outline in [steps](Self::OUTLINE_STEPS) of a pixel, positive outside; empty where no
    /// stage asks for it.
    pub(super) outline: Vec<i8>,
    /// From the world, which the frame of a model is in, to the image plane: `[3, 4]`.
    camera: [[f64; 4]; 3],
    /// What tells images apart: features of frozen encoders are kept under it.
    pub(super) key: u64,
}

impl Stored for Prepared {
    fn bytes(&self) -> usize {
        self.image.len() + self.target.len() + self.mask.len() + self.outline.len()
    }
}

impl Prepared {
    /// Steps of a pixel in [`outline`](Self::outline).
    pub(super) const OUTLINE_STEPS: f32 = 4.0;

    /// Images that are not square are squeezed, for the encoder and for the losses; the cameras
    /// are told of neither, since their image plane reaches from -1 to 1 both ways.
    pub(super) fn new(view: &View, config: &Img2MeshConfig) -> Result<Self, DataError> {
        if !view.camera.is_perspective() {
            let text =
                format!("view {}: its camera is orthographic, expected a pinhole", view.name);
            return Err(DataError::Unfit(text));
        }
        let color = if config.mask_images { view.over([0; 3]) } else { view.color.clone() };
        let bytes = |image: &ByteImage, side: usize| image.resized(side, side).data;
        let image = bytes(&color, config.image_size);
        let mask = bytes(&view.mask, config.render_size);
        let outline = if config.stages > 0 { outline(&mask) } else { Vec::new() };
        Ok(Self {
            name: view.name.clone(),
            key: Fingerprint::new().with(&image).value(),
            image,
            target: bytes(&color, config.render_size),
            mask,
            outline,
            camera: view.camera.projection(),
        })
    }

    /// The same image, seen by another camera.
    pub(super) fn through(&self, camera: &Camera) -> Self {
        Self { camera: camera.projection(), ..self.clone() }
    }

    /// From a frame (its centre and scale) to the image plane: `[3, 4]` in a row.
    pub(super) fn matrix(&self, frame: &[f32]) -> [f32; 12] {
        let [x, y, z, scale] = std::array::from_fn(|k| f64::from(frame[k]));
        // M (c + s q) = s (M q): all rows are divided by s, so that depth counts in the frame.
        let row = |m: [f64; 4]| [m[0], m[1], m[2], (m[0] * x + m[1] * y + m[2] * z + m[3]) / scale];
        let rows = self.camera.map(row);
        std::array::from_fn(|k| rows[k / 4][k % 4] as f32)
    }
}

/// See [`Prepared::outline`], of a square mask.
fn outline(mask: &[u8]) -> Vec<i8> {
    let side = mask.len().isqrt();
    let inside = Mask { height: side, width: side, data: mask.iter().map(|&m| m > 127).collect() };
    let distance = inside.signed_distance(0.0).data;
    // Beyond what a byte holds it only says "far".
    distance.into_iter().map(|d| (Prepared::OUTLINE_STEPS * d) as i8).collect()
}
