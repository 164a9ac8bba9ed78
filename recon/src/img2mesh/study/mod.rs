//! The tables of img2mesh: the paper's own setting, and unseen objects.

mod clock;
mod unseen;

use std::fmt::Write as _;

pub use clock::ClockStudy;
pub use unseen::UnseenStudy;

use super::{Img2Mesh, Img2MeshConfig};
use crate::reproduce::{Cell, Row, Work};
use crate::settings::{read_text, to_toml};
use crate::train::{Configuration, DataError, Metric, Source, System};

type Config = Configuration<Img2MeshConfig>;

/// A preset with changes. Both are ours and sound.
fn preset(name: &str, changes: &[(&str, &str)]) -> Config {
    let found = Img2Mesh::PRESETS.iter().find(|(preset, _)| *preset == name);
    let (_, text) = found.expect("a preset of this system");
    let changes: Vec<(String, String)> =
        changes.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect();
    read_text(name.as_ref(), text, &changes).expect("presets and their changes are sound")
}

/// All that decides the results of these jobs.
fn settings<'a>(jobs: impl Iterator<Item = (&'a str, Config)>) -> String {
    let mut text = String::new();
    for (job, config) in jobs {
        for line in to_toml(&config).lines() {
            let _ = writeln!(text, "{job}.{line}");
        }
    }
    text
}

/// The user's data, or what the configuration makes: the same for all seeds (`data-seed`), so that
/// the spread is that of training alone.
fn open(work: &Work<'_>, config: &Config) -> Result<super::Data, DataError> {
    let options = datasets::ReadOptions::default();
    let source =
        Source { path: work.data, options: &options, seed: work.seed, progress: &|_, _| () };
    Img2Mesh::open(&config.system, &source)
}

/// A row with all of these scores.
fn scored(row: Row, metrics: &[Metric]) -> Row {
    metrics.iter().fold(row, |row, metric| {
        let decimals = if metric.name == "psnr" { 2 } else { 4 };
        row.with(Cell::of(metric, decimals))
    })
}
