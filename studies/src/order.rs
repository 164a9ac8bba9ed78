//! What a study is asked for.

use std::path::Path;

use train::{Provenance, Shard};

use super::scale::{Scale, Seeds};

/// What is to be done.
#[derive(Clone, Debug, Default)]
pub struct Order<'a> {
    /// How much.
    pub scale: Scale,
    /// With which seeds.
    pub seeds: Seeds,
    /// The jobs that are done; empty for all of them. What is kept of others stays in the tables.
    pub only: Vec<String>,
    /// Of these, seed by seed, the share that is done here; see [`merge`](fn@super::merge).
    pub shard: Shard,
    /// Data that the user has, instead of what the study makes.
    pub data: Option<&'a Path>,
    /// Whether results of other settings are dropped.
    pub force: bool,
    /// What tables and runs say about their making.
    pub provenance: Provenance,
}

impl Order<'_> {
    /// Where the data comes from, for people.
    pub(crate) fn data_name(&self) -> String {
        self.data.map_or_else(|| "its own".to_owned(), |path| path.display().to_string())
    }

    /// Whether a job is to be done.
    pub(crate) fn asks_for(&self, job: &str) -> bool {
        self.only.is_empty() || self.only.iter().any(|name| name == job)
    }
}
