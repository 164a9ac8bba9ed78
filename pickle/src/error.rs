//! What can go wrong.

/// What is wrong with a pickle, and where: the place of the instruction, or the value's path.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{field}: found {found}, expected {expected}")]
pub struct PickleError {
    /// The place of the instruction, or the path of the value.
    pub field: String,
    /// What is there.
    pub found: String,
    /// What was expected.
    pub expected: String,
}

pub(crate) fn error(
    field: impl Into<String>,
    found: impl Into<String>,
    expected: &str,
) -> PickleError {
    PickleError { field: field.into(), found: found.into(), expected: expected.to_owned() }
}
