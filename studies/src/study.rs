//! What a study is.

use super::claim::Claim;
use super::error::StudyError;
use super::floor::Floor;
use super::plan::Plan;
use super::row::Row;
use super::scale::Scale;
use super::work::Work;
use crate::progress::Watch;

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
    /// [`StudyError::Cancelled`] as soon as `watch` is, which [`Work::tell`] and [`Work::train`] see to, and whatever prevents the rows.
    fn run(&self, work: &Work<'_>, watch: &mut Watch<'_>) -> Result<Vec<Row>, StudyError>;

    /// What the tables are to show, stated without knowing them; judged by one rule ([`verdict`](crate::verdict)), not in the
    /// quick form.
    fn claims(&self) -> Vec<Claim> {
        Vec::new()
    }

    /// What the quick form has to reach, and what must miss it.
    fn floors(&self) -> Vec<Floor> {
        Vec::new()
    }

    /// What stands above a table: its setting, what differs from the paper.
    fn caption(&self, _table: &str, _scale: Scale) -> String {
        String::new()
    }

    /// Whether it can only be done on data that the user has.
    fn needs_data(&self) -> bool {
        false
    }
}
