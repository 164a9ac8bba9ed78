//! What a step costs that several processes share.

use serde::{Deserialize, Serialize};

/// What one process of several sent in a step, and how long that took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Communication {
    /// Bytes that it sent to others.
    pub bytes: u64,
    /// Seconds in which gradients were exchanged, all processes being there.
    pub seconds: f64,
    /// Seconds of waiting until they were: for those that computed longer.
    pub waiting: f64,
}
