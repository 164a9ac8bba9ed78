//! What a study is.

use serde::Serialize;

use super::error::StudyError;
use super::row::Row;
use super::table::Tables;
use super::work::{Watch, Work};

/// A published table, or several, as jobs that make its rows.
pub trait Study: Sync {
    /// Its name in commands: `img2mesh`.
    fn name(&self) -> &'static str;

    /// What it shows, in a line of the help.
    fn about(&self) -> &'static str;

    /// What is to be done, and what decides its results.
    fn plan(&self, scale: Scale) -> Plan;

    /// Does one job. Rows of one job have different labels within a table, and every seed gives
    /// the same ones.
    ///
    /// # Errors
    /// [`StudyError::Stopped`] as soon as `watch` answers [`Break`](std::ops::ControlFlow::Break), and whatever prevents the rows.
    fn run(&self, work: &Work<'_>, watch: Watch<'_>) -> Result<Vec<Row>, StudyError>;

    /// What the tables are to show. Asked once every job has a result of every seed.
    fn claims(&self, tables: &Tables, scale: Scale) -> Vec<Claim>;

    /// What stands above a table: its setting, what differs from the paper.
    fn caption(&self, _table: &str, _scale: Scale) -> String {
        String::new()
    }
}

/// The jobs of a study, and all that decides their results beside seed, data and the code itself.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Plan {
    /// The jobs in the order of the rows, each a name of small letters, digits and dashes. A job
    /// trains one model and may give several rows.
    pub jobs: Vec<String>,
    /// Lines of `name = value`. Kept results of other settings are refused, and the first line that
    /// differs is named.
    pub settings: String,
}

impl Plan {
    /// This and then another one.
    #[must_use]
    pub fn and(mut self, other: Self) -> Self {
        self.jobs.extend(other.jobs);
        self.with(&other.settings)
    }

    /// This with more settings.
    #[must_use]
    pub fn with(mut self, settings: &str) -> Self {
        self.settings += settings;
        self
    }
}

/// How much is done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Scale {
    /// The table.
    #[default]
    Full,
    /// A minute's worth, to see that nothing is broken.
    Quick,
}

impl Scale {
    /// `full` or `quick`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Full => "full",
            Self::Quick => "quick",
        }
    }
}

/// A sentence about the tables that is true or not.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Claim {
    /// The sentence.
    pub text: String,
    /// The figures that decide it.
    pub found: String,
    /// Whether it is true.
    pub holds: bool,
}

impl Claim {
    /// A claim that was judged.
    pub fn new(text: impl Into<String>, found: impl Into<String>, holds: bool) -> Self {
        Self { text: text.into(), found: found.into(), holds }
    }

    /// That what is said of is at least so much.
    pub(crate) fn at_least(what: &str, found: f64, least: f64) -> Self {
        Self::new(format!("{what} at least {least}"), format!("{found:.3}"), found >= least)
    }

    /// That what is said of is at most so much.
    pub(crate) fn at_most(what: &str, found: f64, most: f64) -> Self {
        Self::new(format!("{what} at most {most}"), format!("{found:.2}"), found <= most)
    }
}
