//! What is said of how familiar an input is.

use std::fmt;

use serde::Serialize;

/// How far a prediction's input is from what the system was trained on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Judgement {
    /// The relative Mahalanobis distance of its features, without a unit; a mean over its images.
    pub distance: f64,
    /// The share of the objects for validation that are nearer, 0 to 1.
    pub quantile: f64,
    /// How many objects that is a share of.
    pub of: usize,
}

impl Judgement {
    /// Whether no object for validation is as far.
    pub fn is_strange(&self) -> bool {
        self.quantile >= 1.0
    }

    /// What a user should be warned of, if anything.
    pub fn warning(&self) -> Option<String> {
        self.is_strange().then(|| {
            format!(
                "it looks unlike what the system was trained on, more so than all {} objects that it was validated on: do not \
                 trust the sides that no image shows",
                self.of
            )
        })
    }
}

/// In words, for people.
impl fmt::Display for Judgement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        /// Beyond so many of the objects for validation an object is unusual.
        const UNUSUAL: f64 = 0.95;
        let what = match self.quantile {
            _ if self.is_strange() => "unlike what it was trained on",
            q if q >= UNUSUAL => "unusual beside what it was trained on",
            _ => "like what it was trained on",
        };
        let percent = (100.0 * self.quantile).floor();
        write!(
            f,
            "{what}: farther from it ({:.1}) than {percent} % of the validation objects",
            self.distance
        )
    }
}
