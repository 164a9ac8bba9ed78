//! What an integration on a tape gave.

use autodiff_lite::{Real, Var};

use crate::solve::Stats;

/// An integration on a tape.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Flow<'t, F: Real = f32> {
    /// The state at the end.
    pub end: Var<'t, F>,
    /// The states at the asked times.
    pub states: Vec<Var<'t, F>>,
    /// When each accepted step began, and when the last ended.
    pub times: Vec<f64>,
    /// How much work it was; what the way back evaluates is not counted.
    pub stats: Stats,
}

impl<'t, F: Real> Flow<'t, F> {
    /// Takes apart what [`stacked`](super::replay::stacked) put together.
    pub(super) fn of(output: Var<'t, F>, save_at: usize, times: Vec<f64>, stats: Stats) -> Self {
        if save_at == 0 {
            return Self { end: output, states: Vec::new(), times, stats };
        }
        let states = (0..save_at).map(|i| output.index_axis(0, i)).collect();
        Self { end: output.index_axis(0, save_at), states, times, stats }
    }
}
