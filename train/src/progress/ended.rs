//! How a job came to its end.

use serde::Serialize;

/// How a job ended that did not fail.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Ended {
    /// All of it is done.
    #[default]
    Completed,
    /// A [`Cancel`](super::Cancel) ended it; what it had by then is kept.
    Cancelled,
}

impl Ended {
    /// Whether it was ended early.
    pub fn is_cancelled(self) -> bool {
        self == Self::Cancelled
    }

    /// By whether it was ended early.
    pub fn early(early: bool) -> Self {
        if early { Self::Cancelled } else { Self::Completed }
    }
}
