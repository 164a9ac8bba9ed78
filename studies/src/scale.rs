//! How much of a study is done, and with how many seeds.

use serde::{Deserialize, Serialize};

/// How much is done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Scale {
    /// The table.
    #[default]
    Full,
    /// Every row in a tenth of the steps: to see what a change does before a night is spent on it.
    Tenth,
    /// A minute's worth, to see that nothing is broken.
    Quick,
}

impl Scale {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Full, Self::Tenth, Self::Quick];

    /// `full`, `tenth` or `quick`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Full => "full",
            Self::Tenth => "tenth",
            Self::Quick => "quick",
        }
    }

    /// Seeds of a row where nobody says how many: three where a claim rests on it, or one.
    pub fn seeds(self, claimed: bool) -> u64 {
        match self {
            Self::Full if claimed => 3,
            Self::Tenth => 2,
            _ => 1,
        }
    }
}

/// Which seeds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Seeds {
    /// As many as the scale asks for, counted from this one on.
    From(u64),
    /// These, for every row.
    Listed(Vec<u64>),
}

impl Seeds {
    /// Those of a row.
    pub(crate) fn of(&self, scale: Scale, claimed: bool) -> Vec<u64> {
        match self {
            Self::From(first) => {
                (0..scale.seeds(claimed)).map(|k| first.saturating_add(k)).collect()
            }
            Self::Listed(seeds) => seeds.clone(),
        }
    }
}

impl Default for Seeds {
    fn default() -> Self {
        Self::From(0)
    }
}
