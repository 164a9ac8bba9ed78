//! What a file of weights is: `unsphere check` of a checkpoint.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use models::predict::Predictor;
use serde::Serialize;
use train::{Checkpoint, CheckpointPath, RunMetadata, settings};

use crate::checkpoint::configuration;
use crate::console::table;
use crate::failure::Failure;
use crate::model_card::{fact, scores};

/// A checkpoint, described.
#[derive(Debug, Serialize)]
pub(crate) struct CheckpointReport {
    #[serde(serialize_with = "train::path_text::serialize")]
    path: PathBuf,
    system: &'static str,
    #[serde(skip)]
    about: &'static str,
    /// Version of the file's layout.
    format: Option<String>,
    bytes: u64,
    steps: u64,
    /// The best value of the metric that checkpoints are chosen by, and when it was reached; none of weights that were never scored.
    best: Option<String>,
    seed: u64,
    /// What the run beside it or its card says; none where neither is there.
    trained_on: Option<String>,
    commit: Option<String>,
    command: Option<String>,
    trainable: usize,
    frozen: usize,
    /// Those of its card, by what they are of; empty where it has none.
    scores: BTreeMap<String, BTreeMap<String, f64>>,
    config: serde_json::Value,
    /// Settings that differ from the system's defaults.
    #[serde(skip)]
    settings: Vec<String>,
}

/// Describes a checkpoint of a system. Its arrays are held against its configuration.
pub(crate) fn checkpoint_report<S: Predictor>(
    checkpoint: &Checkpoint<'_>,
    found: &CheckpointPath,
) -> Result<CheckpointReport, Failure> {
    let config = configuration::<S>(checkpoint, &[], None)?;
    checkpoint.load_as::<S>(&config).map_err(Failure::input)?;
    let summary = S::summary(&config.system);
    let metadata = metadata(&found.file);
    let noted = found.run.as_deref().map(RunMetadata::of).unwrap_or_default();
    let card = checkpoint.card().unwrap_or_default();
    let said = |name: &str| fact(card, name).map(|fact| without_marks(fact).to_owned());
    let beside = found.run.as_ref().zip(noted.command.as_ref()).map(|_| noted.data.as_ref());
    let beside = beside.map(|data| {
        data.map_or_else(|| "what the system makes".to_owned(), |path| path.display().to_string())
    });
    let best = metadata.get("best").filter(|best| *best != "none");
    Ok(CheckpointReport {
        path: found.file.clone(),
        system: S::NAME,
        about: S::ABOUT,
        format: metadata.get("format").cloned(),
        bytes: std::fs::metadata(&found.file).map_or(0, |file| file.len()),
        steps: checkpoint.step().map_err(Failure::input)?,
        best: best.map(|best| best.replace(" at ", " at step ")),
        seed: config.train.seed,
        trained_on: said("trained on").or(beside),
        commit: said("commit").or(noted.commit),
        command: said("command").or(noted.command),
        trainable: summary.trainable,
        frozen: summary.frozen,
        scores: scores(card),
        settings: differences(&settings::to_toml(&config), &defaults::<S>()),
        config: serde_json::to_value(&config).map_err(Failure::other)?,
    })
}

/// A word of code without the marks that Markdown puts around it; what has several is left as it is.
fn without_marks(text: &str) -> &str {
    let inside = text.strip_prefix('`').and_then(|text| text.strip_suffix('`'));
    inside.filter(|inside| !inside.contains('`')).unwrap_or(text)
}

/// A value and its step to four figures, where it is one.
fn shortened(best: &str) -> String {
    let parts =
        best.split_once(' ').and_then(|(value, rest)| Some((value.parse::<f64>().ok()?, rest)));
    parts.map_or_else(|| best.to_owned(), |(value, rest)| format!("{value:.4} {rest}"))
}

/// The defaults of a system, as text.
fn defaults<S: Predictor>() -> String {
    settings::to_toml(&train::Configuration::<S::Config>::default())
}

/// Lines of a configuration that another does not have.
fn differences(text: &str, other: &str) -> Vec<String> {
    let own = text.lines().map(str::trim).filter(|line| line.contains(" = "));
    own.filter(|line| !other.lines().any(|other| other.trim() == *line))
        .map(str::to_owned)
        .collect()
}

/// The entries at the head of a file that was read before and is sound; empty where it has changed since.
fn metadata(path: &Path) -> BTreeMap<String, String> {
    let read = || {
        let bytes = std::fs::read(path).ok()?;
        let length = u64::from_le_bytes(bytes.get(..8)?.try_into().ok()?);
        let end = usize::try_from(length).ok()?.checked_add(8)?;
        let head: serde_json::Value = serde_json::from_slice(bytes.get(8..end)?).ok()?;
        serde_json::from_value(head.get("__metadata__")?.clone()).ok()
    };
    read().unwrap_or_default()
}

impl CheckpointReport {
    /// For people.
    pub(crate) fn text(&self) -> String {
        let known = |text: &Option<String>| text.clone().unwrap_or_else(|| "not known".to_owned());
        let mut rows = vec![
            ("system".to_owned(), format!("{}: {}", self.system, self.about)),
            (
                "file".to_owned(),
                format!("format {}, {:.1} MB", known(&self.format), self.bytes as f64 / 1e6),
            ),
            ("steps".to_owned(), format!("{}, seed {}", self.steps, self.seed)),
        ];
        rows.extend(self.best.as_ref().map(|best| ("best".to_owned(), shortened(best))));
        rows.extend([
            ("trained on".to_owned(), known(&self.trained_on)),
            ("commit".to_owned(), known(&self.commit)),
            ("command".to_owned(), known(&self.command)),
            ("numbers".to_owned(), format!("{} trained, {} frozen", self.trainable, self.frozen)),
        ]);
        for (subset, scores) in &self.scores {
            rows.extend(
                scores
                    .iter()
                    .map(|(name, value)| (format!("{name}, {subset}"), format!("{value:.4}"))),
            );
        }
        let settings = if self.settings.is_empty() {
            "the defaults".to_owned()
        } else {
            self.settings.join(", ")
        };
        rows.push(("settings that differ from the defaults".to_owned(), settings));
        let rows = rows.into_iter().map(|(name, value)| (format!("  {name}"), value));
        format!("{}\n{}", self.path.display(), table(rows))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_differs_is_listed() {
        let text = "a = 1\nb = [\"x\", \"y\"]\n# c = 2\nd = \"e\"\n";
        assert_eq!(
            differences(text, "a = 1\nb = []\n"),
            ["b = [\"x\", \"y\"]", "# c = 2", "d = \"e\""]
        );
        assert!(differences(text, text).is_empty());
    }

    #[test]
    fn words_of_cards_lose_their_marks() {
        assert_eq!(
            [without_marks("`a b`"), without_marks("`a`, then `b`")],
            ["a b", "`a`, then `b`"]
        );
        assert_eq!([shortened("0.123456 at step 7"), shortened("x")], ["0.1235 at step 7", "x"]);
    }
}
