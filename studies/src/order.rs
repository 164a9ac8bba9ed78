//! What a study is asked for.

use std::path::Path;

use train::Provenance;

use super::study::Scale;

/// What is to be done.
#[derive(Clone, Debug)]
pub struct Order<'a> {
    /// How much.
    pub scale: Scale,
    /// With which seeds, in this order.
    pub seeds: Vec<u64>,
    /// Data that the user has, instead of what the study makes.
    pub data: Option<&'a Path>,
    /// Whether results of other settings are dropped.
    pub force: bool,
    /// What tables and runs say about their making.
    pub provenance: Provenance,
}

impl Default for Order<'_> {
    fn default() -> Self {
        let provenance = Provenance::default();
        Self { scale: Scale::Full, seeds: vec![0], data: None, force: false, provenance }
    }
}
