//! What a configuration amounts to.

use train::Summary;

use super::config::{AttentionKind, EncoderKind, Img2MeshConfig, vertices};
use super::view_stage::ViewStage;

impl Img2MeshConfig {
    /// Shapes and numbers of parameters.
    pub(super) fn summary(&self) -> Summary {
        let (d, v, base) = (self.width(), self.vertices(), vertices(self.base_level()));
        let linear = |inputs: usize, outputs: usize| outputs * (inputs + 1);
        let conv =
            |pairs: &[[usize; 2]]| -> usize { pairs.iter().map(|p| linear(9 * p[0], p[1])).sum() };
        let front = [[3, 64], [64, 64], [64, 128], [128, 128], [128, 256], [256, 256], [256, 256]];
        let encoder = match self.encoder {
            EncoderKind::Small => {
                // Instead of a bias each channel has the two numbers of its norm.
                let convs = conv(&[[3, 32], [32, 64], [64, 128], [128, 256]]);
                convs + (32 + 64 + 128 + 256) + linear(4096, d) + 2 * d
            }
            EncoderKind::Cnn => conv(&front) + conv(&[[256, 64], [64, 16], [16, 4], [4, 1]]),
            EncoderKind::Vgg16 => {
                let deep = [[256, 512], [512, 512], [512, 512]];
                let last = [[512, 512]; 3];
                conv(&front) + conv(&deep) + conv(&last) + linear(7 * 7 * 512, d)
            }
            EncoderKind::None => 0,
        };
        let f = self.feed_forward;
        let layer = 4 * linear(d, d) + linear(d, f) + linear(f, d) + 4 * d;
        let mean = self.attention == AttentionKind::Mean;
        let attention = if mean { 0 } else { self.layers * layer };
        let camera = if self.camera_embedding { linear(12, d) } else { 0 };
        let coarse: usize =
            (self.coarsest()..self.base_level()).map(|level| linear(d, 3 * vertices(level))).sum();
        let heads = 2 * linear(d, 3 * base) + linear(d, 3) + coarse;
        let stages: usize =
            (0..self.stages).map(|i| ViewStage::parameters(self, self.left(i))).sum();
        let frozen = match self.encoder {
            _ if !self.freeze_encoder => 0,
            EncoderKind::Cnn => conv(&front),
            _ => encoder,
        };
        let trainable = encoder - frozen + attention + camera + linear(d, d) + heads + stages;
        let shapes = [
            ("images", format!("[N V, {0}, {0}, 3]", self.image_size)),
            ("features", format!("[N, V, {d}]")),
            ("mesh", format!("[N, {v}, 3] positions and colours, {} faces", 2 * v - 4)),
            ("renderings", format!("[N V, {0}, {0}, 3]", self.render_size)),
        ];
        // Beside the weights stands the frame of the data, four numbers.
        let shapes = shapes.map(|(name, shape)| (name.to_owned(), shape)).into();
        Summary { trainable, frozen: frozen + 4, shapes }
    }
}
