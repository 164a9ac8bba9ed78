//! What a study is.

use std::ops::ControlFlow;

use serde::Serialize;

use super::error::StudyError;
use super::row::Row;
use super::table::Tables;
use super::work::{Tick, Work};

/// A published table, or several, as jobs that make its rows.
pub trait Study: Sync {
    /// Its name in commands: `img2mesh`.
    fn name(&self) -> &'static str;

    /// What it shows, in a line of the help.
    fn about(&self) -> &'static str;

    /// Everything that decides the results beside seed, data and the code itself, as lines of
    /// `name = value`. Kept results of other settings are refused, and the first line that differs
    /// is named.
    fn settings(&self, scale: Scale) -> String;

    /// The jobs in the order of the rows, each a name of small letters, digits and dashes. A job
    /// trains one model and may give several rows.
    fn jobs(&self, scale: Scale) -> Vec<String>;

    /// Does one job. Rows of one job have different labels within a table, and every seed gives
    /// the same ones.
    ///
    /// # Errors
    /// [`StudyError::Stopped`] as soon as `watch` answers [`ControlFlow::Break`], and whatever prevents the rows.
    fn run(
        &self,
        work: &Work<'_>,
        watch: &mut dyn FnMut(Tick) -> ControlFlow<()>,
    ) -> Result<Vec<Row>, StudyError>;

    /// What the tables are to show. Asked once every job has a result of every seed.
    fn claims(&self, tables: &Tables, scale: Scale) -> Vec<Claim>;

    /// What stands above a table: its setting, what differs from the paper.
    fn caption(&self, _table: &str, _scale: Scale) -> String {
        String::new()
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
}
