//! How views are read.

use serde::{Deserialize, Serialize};

/// How views are read. The default takes what the layout offers and refuses what is incomplete.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ReadOptions {
    /// Where masks come from.
    pub mask: MaskSource,
    /// Whether masks of files and of alpha mark the background instead of the object.
    pub invert: bool,
    /// What lies behind pixels that are not opaque, sRGB.
    pub background: [u8; 3],
    /// Views larger than this, in pixels of the longer side, are averaged down to it.
    pub max_size: Option<usize>,
    /// Whether depth is read where the layout has it.
    pub depth: bool,
    /// Whether views with missing files are left out, with a warning, instead of refused.
    pub allow_missing: bool,
    /// How many bytes the pixels of all views may take together.
    pub memory_limit: u64,
}

/// Where the masks of the object come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MaskSource {
    /// Files where the layout has them, else alpha where it is not opaque everywhere.
    #[default]
    Auto,
    /// The alpha channel: at least half opaque is object.
    Alpha,
    /// Every pixel is object, and nothing is checked: for when only pictures or cameras matter.
    Whole,
    /// Files of the layout: `_semantic.npy`, `mask_path`, or `masks/` beside the images.
    Files,
    /// Everything that differs from a plain backdrop; of that, the largest connected part.
    Backdrop {
        /// The backdrop's colour; `None` takes the median of the image's border.
        color: Option<[u8; 3]>,
        /// How far a channel may differ from it and still be backdrop.
        tolerance: u8,
    },
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self {
            mask: MaskSource::Auto,
            invert: false,
            background: [0; 3],
            max_size: None,
            depth: false,
            allow_missing: false,
            memory_limit: 8 << 30,
        }
    }
}
