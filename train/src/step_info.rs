//! The step that a call is made for.

/// The step and epoch that a call is made for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepInfo {
    /// Steps taken before.
    pub step: u64,
    /// Epochs finished before.
    pub epoch: u64,
}
