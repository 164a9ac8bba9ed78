//! `unsphere eval`: a trained system, scored on a part of its data.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use models::predict::Predictor;
use serde::Serialize;
use train::{Checkpoint, DataSummary, RunMetadata, Subset};

use crate::args::{Eval, Global};
use crate::by_category::ByCategory;
use crate::checkpoint::{checkpoint_path, configuration};
use crate::console::{Console, table};
use crate::failure::Failure;
use crate::progress::Progress;
use crate::views::open;

/// What is printed with `--json`.
#[derive(Debug, Serialize)]
struct Evaluated<'a> {
    system: &'static str,
    #[serde(serialize_with = "train::path_text::serialize")]
    checkpoint: &'a Path,
    steps: u64,
    /// None where the system made its own.
    #[serde(serialize_with = "train::path_text::serialize_optional")]
    data: Option<PathBuf>,
    seed: u64,
    /// What was scored.
    split: Subset,
    /// How much there is for what; none where the system does not say.
    #[serde(skip_serializing_if = "Option::is_none")]
    subsets: Option<DataSummary>,
    seconds: f64,
    metrics: BTreeMap<String, f64>,
    /// None where objects have no categories.
    #[serde(flatten)]
    categories: Option<ByCategory>,
    /// The names of the scores in the order of the system.
    #[serde(skip)]
    order: Vec<String>,
}

pub(crate) fn run<S: Predictor>(
    console: Console,
    global: Global,
    arguments: &Eval,
) -> Result<(), Failure> {
    let found = checkpoint_path::<S>(&arguments.checkpoint, arguments.last)?;
    let checkpoint = Checkpoint::read(&found.file).map_err(Failure::input)?;
    let config = configuration::<S>(&checkpoint, &arguments.set, global.seed)?;
    let system = checkpoint.load_as::<S>(&config).map_err(|error| match arguments.set.len() {
        0 => Failure::input(error),
        _ => Failure::Usage(format!("--set changes the model: {error}")),
    })?;
    let noted = found.run.as_deref().map(RunMetadata::of).unwrap_or_default();
    let (data, hash) = match &arguments.data {
        Some(path) => (Some(path.clone()), None),
        None => (noted.data.clone(), noted.data.and(noted.data_hash)),
    };
    let opened = open::<S>(console, &config, data.as_deref(), &arguments.reading.options())?;
    let now = format!("{:016x}", S::fingerprint(&opened));
    if let (Some(path), Some(hash)) = (&data, hash.filter(|hash| *hash != now)) {
        console.warn(format_args!(
            "{} gives other data than the run was trained on ({now} instead of {hash}): has it \
                 changed, or was it read with other options?",
            path.display()
        ));
    }
    let subsets = S::data_summary(&opened);
    for text in subsets.iter().flat_map(|summary| &summary.warnings) {
        console.warn(text);
    }
    if arguments.split == Subset::Test {
        console.remark(
            "scored on the test data: it is for the end, when nothing is chosen by it any more",
        );
    }
    let start = Instant::now();
    let progress = Progress::new(console, "eval");
    let metrics = system.evaluate(&opened, arguments.split).map_err(Failure::input)?;
    progress.finish();
    let categories = ByCategory::of(&metrics);
    let order = metrics.iter().map(|metric| metric.name.clone()).collect();
    let evaluated = Evaluated {
        system: S::NAME,
        checkpoint: &found.file,
        steps: checkpoint.step().map_err(Failure::input)?,
        data,
        seed: config.train.seed,
        split: arguments.split,
        subsets,
        seconds: start.elapsed().as_secs_f64(),
        metrics: metrics.into_iter().map(|m| (m.name, m.value)).collect(),
        categories,
        order,
    };
    console.result(&evaluated, describe)
}

fn describe(evaluated: &Evaluated<'_>) -> String {
    let data = match &evaluated.data {
        Some(path) => path.display().to_string(),
        None => format!("made by the system, seed {}", evaluated.seed),
    };
    let scores = evaluated.metrics.iter().map(|(name, value)| (&**name, format!("{value:.4}")));
    let scored = match &evaluated.subsets {
        Some(there) => {
            let size = there.size(evaluated.split);
            let unit = if size == 1 { there.unit.trim_end_matches('s') } else { there.unit };
            format!("{}, {size} {unit}", evaluated.split)
        }
        None => evaluated.split.to_string(),
    };
    let parts = evaluated.subsets.as_ref().map(|there| ("parts", there.to_string()));
    let order: Vec<&str> = evaluated.order.iter().map(String::as_str).collect();
    let categories = evaluated.categories.as_ref().map(|found| found.text(&order));
    let rows = table(scores.chain([("scored", scored)]).chain(parts).chain([
        ("checkpoint", format!("{}, step {}", evaluated.checkpoint.display(), evaluated.steps)),
        ("data", data),
        ("time", format!("{:.1} s", evaluated.seconds)),
    ]));
    rows + &categories.unwrap_or_default()
}
