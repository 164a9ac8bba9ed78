//! Which residual network.

use super::BlockKind;
use crate::NormKind;

/// Depth, width and input of a [`ResNet`](super::ResNet).
///
/// ```
/// use nets::ResNetConfig;
///
/// // Half as wide, for four channels, without a classifier.
/// let config = ResNetConfig { width: 32, inputs: 4, ..ResNetConfig::resnet18() };
/// assert_eq!(config.channels(), [32, 64, 128, 256]);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResNetConfig {
    /// The blocks that it is made of.
    pub block: BlockKind,
    /// Blocks in each of the four stages.
    pub blocks: [usize; 4],
    /// Channels of the stem, and the width of the first stage; each later one is twice as wide.
    /// 64 in the published networks.
    pub width: usize,
    /// Channels of the images: 3, or 4 with depth.
    pub inputs: usize,
    /// Trained or frozen norms.
    pub norm: NormKind,
    /// Outputs of the classifier `fc`; none is no classifier.
    pub classes: Option<usize>,
}

impl ResNetConfig {
    /// ResNet-18 without its classifier.
    pub fn resnet18() -> Self {
        Self {
            block: BlockKind::Basic,
            blocks: [2, 2, 2, 2],
            width: 64,
            inputs: 3,
            norm: NormKind::Batch,
            classes: None,
        }
    }

    /// ResNet-34 without its classifier.
    pub fn resnet34() -> Self {
        Self { blocks: [3, 4, 6, 3], ..Self::resnet18() }
    }

    /// ResNet-50 without its classifier.
    pub fn resnet50() -> Self {
        Self { block: BlockKind::Bottleneck, ..Self::resnet34() }
    }

    /// The same with frozen norms.
    #[must_use]
    pub fn frozen(self) -> Self {
        Self { norm: NormKind::Frozen, ..self }
    }

    /// Channels of the maps of the four stages.
    pub fn channels(&self) -> [usize; 4] {
        [1, 2, 4, 8].map(|k| k * self.width * self.block.expansion())
    }
}
