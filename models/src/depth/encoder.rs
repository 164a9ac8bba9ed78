//! The backbone, as it takes images with and without depth.

use autodiff_lite::{Tape, Var, impl_module};
use nets::{Init, LoadWeights, ResNet, WeightsError};

use super::config::RefineConfig;
use super::scenes::Scene;

/// Mean and deviation of ImageNet's images, as torchvision's weights expect them, and of the depth channel.
const MEAN: [f32; 4] = [0.485, 0.456, 0.406, 0.5];
const DEVIATION: [f32; 4] = [0.229, 0.224, 0.225, 0.25];

/// A residual network over colours, and depth where it is given.
#[derive(Clone, Debug)]
pub(super) struct Encoder {
    resnet: ResNet,
}
impl_module!(Encoder: f32 { resnet });

impl Encoder {
    pub(super) fn new(init: &Init, config: &RefineConfig) -> Self {
        Self { resnet: ResNet::new(&init.at("resnet"), &config.resnet()) }
    }

    /// Fills it with weights under torchvision's names; a filter for depth keeps its fresh values.
    ///
    /// # Errors
    /// If the file is damaged, or lacks what this backbone has.
    pub(super) fn load(&mut self, path: &str) -> Result<(), WeightsError> {
        let loading = LoadWeights::partial().widen("conv1.weight");
        loading.load(path, &mut self.resnet).map(|_| ())
    }

    /// The maps of scenes' images.
    pub(super) fn maps<'t>(&self, tape: &'t Tape, scenes: &[&Scene]) -> [Var<'t>; 4] {
        let side = scenes[0].picture.camera.width;
        let channels = self.resnet.conv1.weight.shape()[1];
        let mut images = tape.array(&[scenes.len(), side, side, channels]);
        let values = images.as_slice_mut();
        for (out, scene) in values.chunks_exact_mut(side * side * channels).zip(scenes) {
            fill(out, channels, scene);
        }
        self.resnet.forward_maps(tape.constant(images))
    }
}

fn fill(out: &mut [f32], channels: usize, scene: &Scene) {
    let colors = scene.picture.image.chunks_exact(3);
    for (p, (pixel, color)) in out.chunks_exact_mut(channels).zip(colors).enumerate() {
        for c in 0..channels {
            let value = match color.get(c) {
                Some(&byte) => f32::from(byte) / 255.0,
                None => scene.depth_targets.channel[p],
            };
            pixel[c] = (value - MEAN[c]) / DEVIATION[c];
        }
    }
}
