//! What error a step may have.

/// What error a step may have: the root mean square of `error / (absolute + relative max(|before|, |after|))` stays
/// below 1. There is no default: only you know the scale of your state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Relative to the state.
    pub relative: f64,
    /// In units of the state.
    pub absolute: f64,
}
