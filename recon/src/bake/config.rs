//! What baking can be told.

use serde::{Deserialize, Serialize};
use train::settings::Options as _;

train::options! {
    /// Options of a texture that is baked, each with the default that [`BakeConfig::default`] gives.
    #[serde(deny_unknown_fields)]
    pub struct BakeConfig {
        /// Which texture coordinates: `"auto"`, those of the mesh where it has some that do not overlap, else new ones; `"keep"`,
        /// those of the mesh; `"new"`.
        pub uv: UvKind = UvKind::Auto;
        /// Side of the texture in pixels; without, it is as fine as the images, and at most 4096.
        #[serde(with = "train::settings::optional")]
        pub texture_size: Option<usize> = None, in 64..=8192;
        /// Whether colours are brought to one exposure and white balance where photographs differ in these.
        pub balance_colors: bool = true;
    }
}

/// Which texture coordinates a baked mesh gets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum UvKind {
    /// Those of the mesh where they can show all of it, else new ones.
    Auto,
    /// Those of the mesh, also where they overlap.
    Keep,
    /// An [`Atlas`](crate::atlas::Atlas).
    New,
}

impl BakeConfig {
    /// What is wrong with these options, one sentence each; empty when nothing is.
    pub fn check(&self) -> Vec<String> {
        self.out_of_range()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_out_of_range_is_named() {
        assert_eq!(BakeConfig::default().check(), Vec::<String>::new());
        let wrong = BakeConfig { texture_size: Some(7), ..BakeConfig::default() };
        let found = wrong.check();
        assert!(found.len() == 1 && found[0].contains("texture-size"), "{found:?}");
    }
}
