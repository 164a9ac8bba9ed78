//! What is said of weights that are given away.

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use serde::Serialize;
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
    pub(crate) seed: u64,
    /// Of computing; none where the log is not there.
    pub(crate) seconds: Option<f64>,
    /// None where the system made its own.
    pub(crate) data: Option<PathBuf>,
    /// How much there is for what.
    pub(crate) subsets: Option<DataSummary>,
    pub(crate) command: Option<String>,
    pub(crate) commit: Option<String>,
    pub(crate) cpu: Option<String>,
    /// Of the weights as they are written.
    pub(crate) scores: Vec<(Subset, BTreeMap<String, f64>)>,
}

impl ModelCard {
    /// With what a run's folder notes.
    #[must_use]
    pub(crate) fn noted(self, noted: RunMetadata) -> Self {
        let RunMetadata { command, commit, cpu, .. } = noted;
        Self { command, commit, cpu, ..self }
    }
}

impl fmt::Display for ModelCard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "# {}\n\n{}.\n", self.system, self.about)?;
        let data = self.data.as_ref().map_or_else(
            || format!("procedural objects, made by the system from seed {}", self.seed),
            |path| path.display().to_string(),
        );
        let subsets = self.subsets.as_ref().map(|there| ("subsets", there.to_string()));
        let minutes = self.seconds.map(|s| ("time", format!("{:.0} minutes", s / 60.0)));
        let steps = format!("{}, seed {}", self.steps, self.seed);
        let facts = [("trained on", data)].into_iter().chain(subsets);
        let facts = facts.chain([("steps", steps)]).chain(minutes);
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

    #[test]
    fn a_card_says_what_is_known_and_nothing_else() {
        let scores = BTreeMap::from([("mask-iou".to_owned(), 0.5)]);
        let card = ModelCard {
            system: "img2mesh",
            about: "Views to a mesh",
            parameters: 12,
            steps: 7,
            seed: 3,
            seconds: None,
            data: None,
            subsets: None,
            command: Some("unsphere train img2mesh | tee".to_owned()),
            commit: None,
            cpu: None,
            scores: vec![(Subset::Test, scores)],
        };
        let text = card.to_string();
        assert!(text.starts_with("# img2mesh\n\nViews to a mesh.\n"), "{text}");
        for line in
            ["| steps | 7, seed 3 |", "| mask-iou | 0.5000 |", "seed 3 |", "img2mesh \\| tee`"]
        {
            assert!(text.contains(line), "{line}: {text}");
        }
        assert!(text.contains("scored once") && !text.contains("commit") && !text.contains("time"));
    }
}
