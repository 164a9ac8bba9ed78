//! What a study is going to do.

use crate::claim::Claim;

/// The jobs of a study, and all that decides their results beside seed, data and the code itself.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plan {
    /// The jobs in the order of the rows.
    pub jobs: Vec<PlannedJob>,
    /// Lines of `name = value`. Kept results of other settings are refused, and the first line that
    /// differs is named.
    pub settings: String,
}

/// A job: it trains one model and may give several rows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlannedJob {
    /// Its name, of small letters, digits and dashes.
    pub id: String,
    /// The label of its rows, or what they begin with, before a comma or a colon.
    pub label: String,
    /// How long its training is: in steps, or in epochs where its configuration says no steps. 0 where nothing is trained.
    pub length: u64,
}

impl PlannedJob {
    /// Whether a row is this job's, by its label.
    pub(crate) fn makes(&self, row: &str) -> bool {
        let rest = row.strip_prefix(&self.label);
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with([',', ':']))
    }

    /// Whether a claim is about one of its rows.
    pub(crate) fn is_claimed(&self, claims: &[Claim]) -> bool {
        claims.iter().flat_map(Claim::rows).any(|row| self.makes(row))
    }
}

impl Plan {
    /// Jobs whose rows are called as they are.
    pub fn of<I: Into<String>>(
        jobs: impl IntoIterator<Item = I>,
        settings: impl Into<String>,
    ) -> Self {
        let job = |id: I| {
            let id = id.into();
            PlannedJob { label: id.clone(), id, length: 0 }
        };
        Self { jobs: jobs.into_iter().map(job).collect(), settings: settings.into() }
    }

    /// The names of the jobs.
    pub fn ids(&self) -> impl Iterator<Item = &str> {
        self.jobs.iter().map(|job| job.id.as_str())
    }

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
