//! Is the mesh what the images show? A verdict with its reasons, from views and mesh alone.
//!
//! Good is a mesh that a user need not look at twice. Doubtful is one that is off somewhere, or may be where no view tells; failed is
//! one that is not the object. The bounds are chosen on fits of procedural objects under planted mistakes and hold on others
//! (`docs/verdict.md`, made by the example `verdicts`).

mod assess;
mod disagreement;
mod evidence;
mod judge;

pub use assess::{Assessment, WorstView, assess};
pub use disagreement::Disagreement;
pub use evidence::Evidence;
pub use judge::judge;

use mesh_core::counted;
use serde::Serialize;

/// How far a fit can be trusted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Grade {
    /// The mesh agrees with what its views show.
    Good,
    /// It is off somewhere, or may be where no view tells.
    Doubtful,
    /// It is not what the views show.
    Failed,
}

impl Grade {
    /// As it is written.
    pub fn name(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Doubtful => "doubtful",
            Self::Failed => "failed",
        }
    }
}

impl std::fmt::Display for Grade {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// A grade and why.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Verdict {
    /// How far the fit can be trusted.
    pub grade: Grade,
    /// Why it is not better, one sentence each, what weighs most first; empty where it is good.
    pub reasons: Vec<String>,
}

impl Verdict {
    /// The same of a fit that was stopped early: doubtful at best, whatever it agrees with.
    fn interrupted(mut self, steps: usize) -> Self {
        let text = format!("the fit was interrupted after {}", counted(steps, "step"));
        // What makes it a failure weighs more.
        let place = if self.grade == Grade::Failed { self.reasons.len() } else { 0 };
        self.reasons.insert(place, text);
        self.grade = self.grade.max(Grade::Doubtful);
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_interrupted_is_doubtful_at_best() {
        let verdict = |grade, reasons: &[&str]| Verdict {
            grade,
            reasons: reasons.iter().map(|reason| (*reason).to_owned()).collect(),
        };
        let text = "the fit was interrupted after 1 step";
        let good = verdict(Grade::Good, &[]).interrupted(1);
        assert_eq!(good, verdict(Grade::Doubtful, &[text]));
        let failed = verdict(Grade::Failed, &["the mesh is not closed"]).interrupted(1);
        assert_eq!(failed, verdict(Grade::Failed, &["the mesh is not closed", text]));
    }
}
