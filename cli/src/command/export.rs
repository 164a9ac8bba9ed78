//! `unsphere export`: a training in, weights to give away out.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use models::OnnxValue;
use models::predict::{Familiarity, Predictor};
use serde::Serialize;
use train::output::disk;
use train::report::counted;
use train::{Checkpoint, CheckpointPath, Configuration, RunFolder, RunMetadata, Subset};

use crate::args::{Export, Global, refuse_existing};
use crate::began_with::began_with;
use crate::checkpoint::{checkpoint_path, configuration};
use crate::console::{Console, table};
use crate::failure::Failure;
use crate::model_card::{ModelCard, fact, in_words};
use crate::progress::Progress;
use crate::views::open;

/// What is printed with `--json`.
#[derive(Debug, Serialize)]
struct Exported<'a> {
    #[serde(serialize_with = "train::path_text::serialize")]
    output: &'a Path,
    #[serde(serialize_with = "train::path_text::serialize")]
    card: &'a Path,
    bytes: usize,
    about: &'a ModelCard,
    #[serde(skip_serializing_if = "Option::is_none")]
    onnx: Option<Networks>,
}

/// What a file in ONNX's form has.
#[derive(Debug, Serialize)]
struct Networks {
    #[serde(serialize_with = "train::path_text::serialize")]
    path: PathBuf,
    bytes: usize,
    operators: usize,
    /// Numbers of all weights.
    numbers: usize,
    /// Names, and axes behind the batch.
    inputs: BTreeMap<String, Vec<usize>>,
    outputs: BTreeMap<String, Vec<usize>>,
}

pub(crate) fn run<S: Predictor>(
    console: Console,
    global: Global,
    arguments: &Export,
) -> Result<(), Failure> {
    let Export { output, onnx, force, .. } = arguments;
    let page = output.as_ref().map(|output| output.with_extension("md"));
    let files: Vec<&PathBuf> = output.iter().chain(&page).chain(onnx).collect();
    refuse_existing(&files, *force)?;
    let found = checkpoint_path::<S>(&arguments.checkpoint, arguments.last)?;
    let checkpoint = Checkpoint::read(&found.file).map_err(Failure::input)?;
    let config = configuration::<S>(&checkpoint, &[], global.seed)?;
    let networks = onnx.as_deref().map(|path| networks::<S>(path, &checkpoint, &config));
    let networks = networks.transpose()?;
    let (Some(output), Some(page)) = (output, &page) else {
        return console
            .result(&networks, |networks| networks.as_ref().map_or_else(String::new, listed));
    };
    let (card, bytes) = weights::<S>(console, arguments, output, (&found, &checkpoint, &config))?;
    write(page, card.to_string().as_bytes())?;
    let exported = Exported { output, card: page, bytes, about: &card, onnx: networks };
    console.result(&exported, describe)
}

/// Writes the networks that others can run.
fn networks<S: Predictor>(
    path: &Path,
    checkpoint: &Checkpoint<'_>,
    config: &Configuration<S::Config>,
) -> Result<Networks, Failure> {
    let system = checkpoint.load_as::<S>(config).map_err(Failure::input)?;
    let Some(model) = system.to_onnx() else {
        let text = format!("no part of this {} is a network that runs on an image alone", S::NAME);
        return Err(Failure::Usage(format!("--onnx: {text}")));
    };
    let bytes = model.to_bytes();
    write(path, &bytes)?;
    let (operators, numbers) = model.size();
    let named = |values: &[OnnxValue]| {
        values.iter().map(|value| (value.name.clone(), value.shape.clone())).collect()
    };
    let (inputs, outputs) = (named(&model.inputs), named(&model.outputs));
    Ok(Networks { path: path.to_owned(), bytes: bytes.len(), operators, numbers, inputs, outputs })
}

/// Scores and writes the weights; their model card, and how many bytes they take.
fn weights<S: Predictor>(
    console: Console,
    arguments: &Export,
    output: &Path,
    (found, checkpoint, config): (&CheckpointPath, &Checkpoint<'_>, &Configuration<S::Config>),
) -> Result<(ModelCard, usize), Failure> {
    let noted = found.run.as_deref().map(RunMetadata::of).unwrap_or_default();
    let data = arguments.data.clone().or_else(|| noted.data.clone());
    let opened = open::<S>(console, config, data.as_deref(), &arguments.reading.options())?;
    let is_same = is_what_was_trained_on::<S>(console, arguments, &noted, &opened);
    // What is scored is what is written: half precision rounds.
    let bytes = checkpoint.weights("");
    let rounded = Checkpoint::from_bytes(output, &bytes).map_err(Failure::input)?;
    let system = rounded.load_as::<S>(config).map_err(Failure::input)?;
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
        began_with: noted.command.as_deref().and_then(began_with),
        seed: config.train.seed,
        seconds,
        trained_on: trained_on(found, &noted, checkpoint, config.train.seed),
        data: noted.data.clone(),
        scored_on: arguments.data.clone().filter(|_| !is_same),
        subsets: S::data_summary(&opened),
        command: None,
        commit: None,
        cpu: None,
        scores,
    }
    .noted(noted);
    let text = card.to_string();
    // What is scored on a user's request need not be what was trained on.
    let familiarity = if is_same {
        let progress = Progress::new(console, "look at what it was trained on");
        let learned = Familiarity::of_data(&system, &opened).map_err(Failure::input)?;
        progress.finish();
        learned
    } else {
        Familiarity::of(checkpoint).map_err(Failure::input)?
    };
    let bytes = match familiarity {
        Some(familiarity) => checkpoint.weights_beside(&text, &familiarity.to_state()),
        None => checkpoint.weights(&text),
    };
    write(output, &bytes)?;
    Ok((card, bytes.len()))
}

/// Whether what is scored is what the run was trained on; says so where it was to be, and is not.
fn is_what_was_trained_on<S: Predictor>(
    console: Console,
    arguments: &Export,
    noted: &RunMetadata,
    opened: &S::Data,
) -> bool {
    let now = format!("{:016x}", S::fingerprint(opened));
    let is_same = noted.data_hash.as_ref().map(|hash| *hash == now);
    match (&arguments.data, &noted.data, is_same) {
        (Some(_), _, is_same) => is_same.unwrap_or(false),
        (None, Some(path), Some(false)) => {
            console.warn(format_args!(
                "{} gives other data than the run was trained on: has it changed, or was it read with other options? The \
                 scores are of what is there now",
                path.display()
            ));
            true
        }
        (None, ..) => true,
    }
}

/// What was trained on, in words: as the run notes it, or as weights that were given away say.
fn trained_on(
    found: &CheckpointPath,
    noted: &RunMetadata,
    checkpoint: &Checkpoint<'_>,
    seed: u64,
) -> String {
    let said = checkpoint.card().and_then(|card| fact(card, "trained on"));
    match (said, &found.run, &noted.command) {
        (Some(said), ..) => said.to_owned(),
        // Its folder is not there, or has lost what it noted.
        (None, None, _) | (None, Some(_), None) => {
            "not known: nothing beside the checkpoint says it".to_owned()
        }
        (None, Some(_), Some(_)) => in_words(noted.data.as_deref(), seed),
    }
}

/// Whole or not at all.
fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    let failed = |error: &dyn std::fmt::Display| {
        Failure::Other(format!("{}: cannot be written: {error}", path.display()))
    };
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    folder.map_or(Ok(()), disk::make_folders).map_err(|error| failed(&error))?;
    mesh_core::io::write_atomic(path, |out| out.write_all(bytes)).map_err(|error| failed(&error))
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
        + &exported.onnx.as_ref().map_or_else(String::new, listed)
}

/// A line for the file, and one for each input and output.
fn listed(networks: &Networks) -> String {
    let (path, size) = (networks.path.display(), networks.bytes as f64 / 1e6);
    let operators = counted(networks.operators, "operator");
    let file = format!("{path}, {size:.1} MB, {operators}");
    let all = networks.inputs.iter().map(|value| ("in", value));
    let all = all.chain(networks.outputs.iter().map(|value| ("out", value)));
    let rows = all.map(|(way, (name, shape))| {
        let axes = shape.iter().fold(String::new(), |text, n| format!("{text}, {n}"));
        (format!("{way} {name}"), format!("[batch{axes}]"))
    });
    table(std::iter::once(("networks".to_owned(), file)).chain(rows))
}
