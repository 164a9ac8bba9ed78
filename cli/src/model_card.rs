//! What is said of weights that are given away.

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

use serde::Serialize;
use train::report::counted;
use train::{DataSummary, RunMetadata, Subset};

/// A model card, which prints as Markdown.
///
/// # References
/// Mitchell et al. 2019, *Model Cards for Model Reporting*.
#[derive(Debug, Serialize)]
pub(crate) struct ModelCard {
    pub(crate) system: &'static str,
    /// What the system does, in a sentence.
    pub(crate) about: &'static str,
    pub(crate) parameters: usize,
    pub(crate) steps: u64,
    /// Those before, of the weights that the training began with.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) began_with: Option<BeganWith>,
    pub(crate) seed: u64,
    /// Of computing; none where the log is not there.
    pub(crate) seconds: Option<f64>,
    /// What was trained on; none where the system made its own, or it is not known.
    pub(crate) data: Option<PathBuf>,
    /// The same in words.
    #[serde(skip)]
    pub(crate) trained_on: String,
    /// What was scored, where that is not what was trained on.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) scored_on: Option<PathBuf>,
    /// How much there is for what in the data that were scored.
    pub(crate) subsets: Option<DataSummary>,
    pub(crate) command: Option<String>,
    pub(crate) commit: Option<String>,
    pub(crate) cpu: Option<String>,
    /// Of the weights as they are written.
    pub(crate) scores: Vec<(Subset, BTreeMap<String, f64>)>,
}

/// The weights that a training began with.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct BeganWith {
    /// As they were named.
    pub(crate) path: String,
    /// Steps that they had been trained for; none where they cannot be looked at any more.
    pub(crate) steps: Option<u64>,
}

impl ModelCard {
    /// With what a run's folder notes.
    #[must_use]
    pub(crate) fn noted(self, noted: RunMetadata) -> Self {
        let RunMetadata { command, commit, cpu, .. } = noted;
        Self { command, commit, cpu, ..self }
    }

    /// Those of this training and those before.
    fn all_steps(&self) -> String {
        match &self.began_with {
            None => self.steps.to_string(),
            Some(BeganWith { path, steps: Some(before) }) => {
                let all = self.steps.saturating_add(*before);
                format!("{all}: {before} of {path}, which it began with, and {} then", self.steps)
            }
            Some(BeganWith { path, steps: None }) => {
                format!("{} behind those of {path}, which it began with", self.steps)
            }
        }
    }
}

/// Data in words.
pub(crate) fn in_words(data: Option<&Path>, seed: u64) -> String {
    data.map_or_else(
        || format!("procedural objects, made by the system from seed {seed}"),
        |path| path.display().to_string(),
    )
}

/// What a card says under a name, of facts and not of scores.
pub(crate) fn fact<'a>(card: &'a str, name: &str) -> Option<&'a str> {
    let row = |line: &'a str| line.strip_prefix("| ")?.strip_suffix(" |")?.split_once(" | ");
    let facts = card.lines().take_while(|line| !line.starts_with("Scores of"));
    facts.filter_map(row).find(|(found, _)| *found == name).map(|(_, fact)| fact)
}

/// The scores that a card lists, by what they are of.
pub(crate) fn scores(card: &str) -> BTreeMap<String, BTreeMap<String, f64>> {
    let mut found = BTreeMap::<String, BTreeMap<String, f64>>::new();
    let mut subset = None;
    for line in card.lines() {
        if let Some(rest) = line.strip_prefix("Scores of these weights on ") {
            let end = rest.find(|c: char| !c.is_ascii_alphabetic()).unwrap_or(rest.len());
            subset = Some(&rest[..end]);
        }
        let row = || line.strip_prefix("| ")?.strip_suffix(" |")?.split_once(" | ");
        if let (Some(subset), Some((name, value))) = (subset, row())
            && let Ok(value) = value.parse()
        {
            found.entry(subset.to_owned()).or_default().insert(name.to_owned(), value);
        }
    }
    found
}

/// A time of computing, in minutes where there are any.
fn spoken(seconds: f64) -> String {
    if seconds < 59.5 {
        return counted(seconds.round() as usize, "second");
    }
    counted((seconds / 60.0).round() as usize, "minute")
}

impl fmt::Display for ModelCard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "# {}\n\n{}.\n", self.system, self.about)?;
        let scored = self.scored_on.as_ref().map(|path| ("scored on", path.display().to_string()));
        let subsets = self.subsets.as_ref().map(|there| ("subsets", there.to_string()));
        let time = self.seconds.map(|seconds| ("time", spoken(seconds)));
        let steps = format!("{}, seed {}", self.all_steps(), self.seed);
        let facts = [("trained on", self.trained_on.clone())].into_iter();
        let facts = facts.chain(scored).chain(subsets);
        let facts = facts.chain([("steps", steps)]).chain(time);
        let facts = facts.chain([
            ("command", code(self.command.as_ref())),
            ("commit", code(self.commit.as_ref())),
            ("processor", self.cpu.clone().unwrap_or_default()),
            ("parameters", format!("{}, in half precision", self.parameters)),
            ("licence", "MIT OR Apache-2.0".to_owned()),
        ]);
        writeln!(f, "| | |\n|---|---|")?;
        for (name, fact) in facts.filter(|(_, fact)| !fact.is_empty()) {
            writeln!(f, "| {name} | {} |", fact.replace('|', "\\|").replace('\n', " "))?;
        }
        for (subset, metrics) in &self.scores {
            let how = match subset {
                Subset::Test => ", scored once",
                _ => ", by which the checkpoint was chosen",
            };
            writeln!(f, "\nScores of these weights on {subset}{how}:\n\n| | |\n|---|--:|")?;
            for (name, value) in metrics {
                writeln!(f, "| {name} | {value:.4} |")?;
            }
        }
        let knows = "It knows objects like those that it was trained on, and is no use for others.";
        writeln!(f, "\n{knows} `unsphere eval` scores it on yours.")
    }
}

fn code(text: Option<&String>) -> String {
    text.map_or_else(String::new, |text| format!("`{text}`"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn card() -> ModelCard {
        let scores = BTreeMap::from([("mask-iou".to_owned(), 0.5)]);
        ModelCard {
            system: "img2mesh",
            about: "Views to a mesh",
            parameters: 12,
            steps: 7,
            began_with: None,
            seed: 3,
            seconds: None,
            data: None,
            trained_on: in_words(None, 3),
            scored_on: None,
            subsets: None,
            command: Some("unsphere train img2mesh | tee".to_owned()),
            commit: None,
            cpu: None,
            scores: vec![(Subset::Test, scores)],
        }
    }

    #[test]
    fn a_card_says_what_is_known_and_nothing_else() {
        let text = card().to_string();
        assert!(text.starts_with("# img2mesh\n\nViews to a mesh.\n"), "{text}");
        for line in
            ["| steps | 7, seed 3 |", "| mask-iou | 0.5000 |", "seed 3 |", "img2mesh \\| tee`"]
        {
            assert!(text.contains(line), "{line}: {text}");
        }
        assert!(text.contains("scored once") && !text.contains("commit") && !text.contains("time"));
        assert!(!text.contains("scored on "), "{text}");
    }

    #[test]
    fn a_card_parts_what_was_trained_on_from_what_was_scored() {
        let card = ModelCard {
            trained_on: in_words(Some(Path::new("clock.zip")), 3),
            scored_on: Some("other.zip".into()),
            seconds: Some(61.0),
            began_with: Some(BeganWith { path: "first".to_owned(), steps: Some(40) }),
            ..card()
        };
        let text = card.to_string();
        assert_eq!(fact(&text, "trained on"), Some("clock.zip"));
        assert_eq!(fact(&text, "scored on"), Some("other.zip"));
        assert_eq!(fact(&text, "time"), Some("1 minute"));
        assert_eq!(
            fact(&text, "steps"),
            Some("47: 40 of first, which it began with, and 7 then, seed 3")
        );
        assert_eq!(fact(&text, "mask-iou"), None);
        assert_eq!(scores(&text)["test"], BTreeMap::from([("mask-iou".to_owned(), 0.5)]));
        assert_eq!(
            [spoken(1.0), spoken(59.0), spoken(119.0)],
            ["1 second", "59 seconds", "2 minutes"]
        );
    }
}
