//! The backbone, as it takes images with and without depth.

use autodiff_lite::{Tape, Tensor, Var, impl_module};
use nets::{IMAGENET_DEVIATION, IMAGENET_MEAN, Init, LoadWeights, ResNet, WeightsError};

use super::config::RefineConfig;
use super::scenes::Scene;

/// Mean and deviation of ImageNet's images, and of the depth channel.
pub(super) const MEAN: [f32; 4] = with_depth(IMAGENET_MEAN, 0.5);
pub(super) const DEVIATION: [f32; 4] = with_depth(IMAGENET_DEVIATION, 0.25);

const fn with_depth([r, g, b]: [f32; 3], depth: f32) -> [f32; 4] {
    [r, g, b, depth]
}

/// A residual network over colours, and depth where it is given.
#[derive(Clone, Debug)]
pub(super) struct Encoder {
    pub(super) resnet: ResNet,
    black: bool,
    pub(super) blind: bool,
}
impl_module!(Encoder: f32 { resnet } fixed { black, blind });

impl Encoder {
    pub(super) fn new(init: &Init, config: &RefineConfig) -> Self {
        let resnet = ResNet::new(&init.at("resnet"), &config.resnet());
        Self { resnet, black: config.black_background, blind: config.blind }
    }

    /// Fills it with weights under torchvision's names; a filter for depth keeps its fresh values.
    ///
    /// # Errors
    /// If the file is damaged, or lacks what this backbone has.
    pub(super) fn load(&mut self, path: &str) -> Result<(), WeightsError> {
        let loading = LoadWeights::partial().widen("conv1.weight");
        loading.load(path, &mut self.resnet).map(|_| ())
    }

    /// Channels of the images: colours, and depth.
    pub(super) fn channels(&self) -> usize {
        self.resnet.conv1.weight.shape()[1]
    }

    /// The maps of scenes' images.
    pub(super) fn maps<'t>(&self, tape: &'t Tape, scenes: &[&Scene]) -> [Var<'t>; 4] {
        self.resnet.forward_maps(tape.constant(self.images(tape, scenes)))
    }

    /// Images as the network takes them, `[N, S, S, 3 or 4]`.
    pub(super) fn images(&self, tape: &Tape, scenes: &[&Scene]) -> Tensor<f32> {
        let side = scenes[0].image.camera.width;
        let channels = self.channels();
        let mut images = tape.array(&[scenes.len(), side, side, channels]);
        let values = images.as_slice_mut();
        if self.blind {
            values.fill(0.0);
            return images;
        }
        for (out, scene) in values.chunks_exact_mut(side * side * channels).zip(scenes) {
            fill(out, channels, scene, self.black);
        }
        images
    }
}

fn fill(out: &mut [f32], channels: usize, scene: &Scene, black: bool) {
    let colors = scene.image.pixels.chunks_exact(3);
    for (p, (pixel, color)) in out.chunks_exact_mut(channels).zip(colors).enumerate() {
        // Pictures are white around the object, by the share of it in each pixel.
        let white = if black { 255 - scene.image.mask[p] } else { 0 };
        for c in 0..channels {
            let value = match color.get(c) {
                Some(&byte) => f32::from(byte.saturating_sub(white)) / 255.0,
                None => scene.depth_targets.channel[p],
            };
            pixel[c] = (value - MEAN[c]) / DEVIATION[c];
        }
    }
}
