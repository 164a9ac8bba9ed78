//! What a table is to show: which rows, which column, which side, by which margin.
//!
//! A claim is stated before anything is run, and knows no figures. [`verdict`](crate::verdict) judges all claims by one rule.

/// A sentence about a study's tables, and the comparisons that decide it: all of them must hold.
#[derive(Clone, Debug, PartialEq)]
pub struct Claim {
    /// The sentence.
    pub text: String,
    /// What has to hold.
    pub comparisons: Vec<Comparison>,
}

impl Claim {
    /// A sentence with what decides it.
    pub fn new(text: impl Into<String>, comparisons: impl IntoIterator<Item = Comparison>) -> Self {
        Self { text: text.into(), comparisons: comparisons.into_iter().collect() }
    }

    /// The reasons of its margins, each once.
    pub fn reasons(&self) -> Vec<&str> {
        let mut reasons = Vec::new();
        for comparison in &self.comparisons {
            if let Some(why) = comparison.margin.why()
                && !reasons.contains(&why)
            {
                reasons.push(why);
            }
        }
        reasons
    }

    /// The rows that it is about.
    pub fn rows(&self) -> impl Iterator<Item = &str> {
        self.comparisons.iter().flat_map(Comparison::rows)
    }
}

/// A column of a row, or of several rows taken together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Score {
    /// The heading of the table.
    pub table: String,
    /// The rows. The objects of several count together.
    pub rows: Vec<String>,
    /// The heading of the column.
    pub column: String,
}

/// What a score is compared with.
#[derive(Clone, Debug, PartialEq)]
pub enum Against {
    /// Another score, object by object where both have values by object.
    Score(Score),
    /// A number that no training decides.
    Value(f64),
}

impl From<Score> for Against {
    fn from(score: Score) -> Self {
        Self::Score(score)
    }
}

impl From<f64> for Against {
    fn from(value: f64) -> Self {
        Self::Value(value)
    }
}

/// Which side of the other a score is said to be on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Smaller.
    Below,
    /// Larger.
    Above,
}

/// What a score has to be by, or may fall behind. It comes from a paper or was stated before the run, and says so.
#[derive(Clone, Debug, PartialEq)]
pub enum Margin {
    /// On its side, however little.
    None,
    /// On its side by at least so much; below zero: behind by at most so much.
    By(f64, String),
    /// So many times the other at most, both counted from the value that nothing beats: for an IoU from 1, for a distance from 0.
    Times {
        /// The factor.
        most: f64,
        /// The value that nothing beats.
        perfect: f64,
        /// Where the factor comes from.
        why: String,
    },
}

impl Margin {
    fn why(&self) -> Option<&str> {
        match self {
            Self::None => None,
            Self::By(_, why) | Self::Times { why, .. } => Some(why),
        }
    }
}

/// How many times another's error an error may be and still not be behind.
pub const NOT_BEHIND: f64 = 1.05;
const WHY_NOT_BEHIND: &str = "not behind: the error is at most 1.05 times the other's, the same for every claim of this kind";

/// One comparison.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// What is said to be better, smaller or larger.
    pub own: Score,
    /// What it is compared with.
    pub other: Against,
    /// On which side of it.
    pub side: Side,
    /// By how much.
    pub margin: Margin,
    /// Whether the figures are no sample of anything: counts, bytes, equalities up to rounding. Then nothing is inferred, and
    /// each seed has to agree.
    pub exact: bool,
}

impl Score {
    /// A column of a row.
    pub fn new(
        table: impl Into<String>,
        row: impl Into<String>,
        column: impl Into<String>,
    ) -> Self {
        Self { table: table.into(), rows: vec![row.into()], column: column.into() }
    }

    /// Its rows and one more, taken together.
    #[must_use]
    pub fn and(mut self, row: impl Into<String>) -> Self {
        self.rows.push(row.into());
        self
    }

    /// That it is smaller.
    pub fn below(self, other: impl Into<Against>) -> Comparison {
        self.compared(other, Side::Below)
    }

    /// That it is larger.
    pub fn above(self, other: impl Into<Against>) -> Comparison {
        self.compared(other, Side::Above)
    }

    /// That its error is at most [`NOT_BEHIND`] times the other's; errors are counted from `perfect`, the value that nothing
    /// beats.
    pub fn not_behind(self, other: impl Into<Against>, perfect: f64) -> Comparison {
        self.at_most(NOT_BEHIND, other, perfect, WHY_NOT_BEHIND)
    }

    /// That its error is at most `most` times the other's, and why so many; errors are counted from `perfect`.
    pub fn at_most(
        self,
        most: f64,
        other: impl Into<Against>,
        perfect: f64,
        why: impl Into<String>,
    ) -> Comparison {
        let margin = Margin::Times { most, perfect, why: why.into() };
        Comparison { margin, ..self.compared(other, Side::Below) }
    }

    fn compared(self, other: impl Into<Against>, side: Side) -> Comparison {
        Comparison { own: self, other: other.into(), side, margin: Margin::None, exact: false }
    }
}

impl Comparison {
    /// By at least so much, and why so much; below zero: behind by at most so much.
    #[must_use]
    pub fn by(self, margin: f64, why: impl Into<String>) -> Self {
        Self { margin: Margin::By(margin, why.into()), ..self }
    }

    /// Of figures that are no sample: see [`exact`](Self::exact).
    #[must_use]
    pub fn exactly(self) -> Self {
        Self { exact: true, ..self }
    }

    /// The rows of both sides.
    pub fn rows(&self) -> impl Iterator<Item = &str> {
        let other = match &self.other {
            Against::Score(other) => &other.rows[..],
            Against::Value(_) => &[],
        };
        self.own.rows.iter().chain(other).map(String::as_str)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_claim_names_its_rows_and_its_reasons_once() {
        let score = |row: &str| Score::new("t", row, "CD");
        let claim = Claim::new(
            "a",
            [
                score("a").not_behind(score("b").and("c"), 0.0),
                score("a").not_behind(0.5, 0.0),
                score("a").above(0.25).by(0.1, "the paper's").exactly(),
            ],
        );
        assert_eq!(claim.rows().collect::<Vec<_>>(), ["a", "b", "c", "a", "a"]);
        assert_eq!(claim.reasons(), [WHY_NOT_BEHIND, "the paper's"]);
    }
}
