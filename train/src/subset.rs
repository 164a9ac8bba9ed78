//! What parts of the data are for.

use std::fmt;

use serde::{Deserialize, Serialize};

/// What objects are used for.
///
/// ```
/// use train::Subset;
/// assert_eq!(Subset::ALL.map(Subset::name), ["train", "validation", "test"]);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Subset {
    /// Trained on.
    Train,
    /// Scored in training: settings and the best checkpoint are chosen by it.
    Validation,
    /// Scored once, at the end; nothing is chosen by it.
    Test,
}

impl Subset {
    /// All of them, in this order.
    pub const ALL: [Self; 3] = [Self::Train, Self::Validation, Self::Test];

    /// `train`, `validation` or `test`.
    pub fn name(self) -> &'static str {
        ["train", "validation", "test"][self as usize]
    }
}

impl fmt::Display for Subset {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// How much data there is for what.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct DataSummary {
    /// What is counted: `objects`, or `views` of a single one.
    pub unit: &'static str,
    /// How many of them, in the order of [`Subset::ALL`].
    pub sizes: [usize; 3],
    /// What a user should know of them, one sentence each.
    pub warnings: Vec<String>,
}

impl DataSummary {
    /// How many there are for this.
    pub fn size(&self, subset: Subset) -> usize {
        self.sizes[subset as usize]
    }
}

impl fmt::Display for DataSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [train, validation, test] = self.sizes;
        write!(f, "{train} {} to train on, {validation} for validation, {test} to test", self.unit)
    }
}
