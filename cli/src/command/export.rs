//! `unsphere export`: a training in, weights to give away out.

use std::collections::BTreeMap;
use std::path::Path;

use models::predict::Predictor;
use serde::Serialize;
use train::output::write_within;
use train::{Checkpoint, RunFolder, RunMetadata, Subset};

use crate::args::{Export, Global, refuse_existing};
use crate::checkpoint::{checkpoint_path, configuration};
use crate::console::{Console, table};
use crate::failure::Failure;
use crate::model_card::ModelCard;
use crate::progress::Progress;
use crate::views::open;

/// What is printed with `--json`.
#[derive(Debug, Serialize)]
struct Exported<'a> {
    output: &'a Path,
    card: &'a Path,
    bytes: usize,
    about: &'a ModelCard,
}

pub(crate) fn run<S: Predictor>(
    console: Console,
    global: Global,
    arguments: &Export,
) -> Result<(), Failure> {
    let (output, page) = (&arguments.output, arguments.output.with_extension("md"));
    refuse_existing(&[output, &page], arguments.force)?;
    let found = checkpoint_path::<S>(&arguments.checkpoint, arguments.last)?;
    let checkpoint = Checkpoint::read(&found.file).map_err(Failure::input)?;
    let config = configuration::<S>(&checkpoint, &[], global.seed)?;
    let noted = found.run.as_deref().map(RunMetadata::of).unwrap_or_default();
    let data = arguments.data.clone().or_else(|| noted.data.clone());
    let opened = open::<S>(console, &config, data.as_deref(), &arguments.reading.options())?;
    // What is scored is what is written: half precision rounds.
    let bytes = checkpoint.weights("");
    let rounded = Checkpoint::from_bytes(output, &bytes).map_err(Failure::input)?;
    let system = rounded.load_as::<S>(&config).map_err(Failure::input)?;
    let subsets: &[Subset] =
        if arguments.test { &[Subset::Validation, Subset::Test] } else { &[Subset::Validation] };
    let mut scores = Vec::new();
    for &subset in subsets {
        let progress = Progress::new(console, &format!("score {subset}"));
        let metrics = system.evaluate(&opened, subset).map_err(Failure::input)?;
        progress.finish();
        let metrics: BTreeMap<_, _> = metrics.into_iter().map(|m| (m.name, m.value)).collect();
        scores.push((subset, metrics));
    }
    let seconds = found.run.as_deref().and_then(|run| RunFolder::at(run).seconds().ok());
    let summary = S::summary(&config.system);
    let card = ModelCard {
        system: S::NAME,
        about: S::ABOUT,
        parameters: summary.trainable + summary.frozen,
        steps: checkpoint.step().map_err(Failure::input)?,
        seed: config.train.seed,
        seconds,
        data,
        subsets: S::data_summary(&opened),
        command: None,
        commit: None,
        cpu: None,
        scores,
    }
    .noted(noted);
    let text = card.to_string();
    let bytes = checkpoint.weights(&text);
    write(output, &bytes)?;
    write(&page, text.as_bytes())?;
    let exported = Exported { output, card: &page, bytes: bytes.len(), about: &card };
    console.result(&exported, describe)
}

/// Whole or not at all.
fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    let folder = path.parent().unwrap_or_else(|| Path::new(""));
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    write_within(folder, &name, bytes).map_err(|(path, error)| {
        Failure::Other(format!("{}: cannot be written: {error}", path.display()))
    })
}

fn describe(exported: &Exported<'_>) -> String {
    let scores = exported.about.scores.iter().flat_map(|(subset, metrics)| {
        metrics
            .iter()
            .map(move |(name, value)| (format!("{name}, {subset}"), format!("{value:.4}")))
    });
    let size = format!("{}, {:.1} MB", exported.output.display(), exported.bytes as f64 / 1e6);
    let files = [("weights", size), ("model card", exported.card.display().to_string())];
    table(scores.chain(files.map(|(name, text)| (name.to_owned(), text))))
}
