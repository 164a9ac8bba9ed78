//! Averaged weights.

use std::collections::BTreeMap;

use autodiff_lite::state::State;
use autodiff_lite::{Module, Param};

/// Where averages stand in a checkpoint: among what is the optimiser's, since no model has parameters there.
pub(super) const AVERAGE: &str = "optim.average";

/// The exponential moving average of a system's parameters: what is scored, kept as the best, and predicts.
///
/// `a <- d a + (1 - d) p` after each step, `d = min(decay, (1 + t) / (10 + t))` after `t` steps, so that the first weights are
/// soon forgotten. Buffers too, as PyTorch's `AveragedModel` with `use_buffers` does: a batch norm's running means of the moment
/// are those of other weights, and with them an averaged network is worse than none.
///
/// # References
/// Morales-Brotons, Vogels, Hendrikx 2024, *Exponential Moving Average of Weights in Deep Learning*; the rising decay is
/// that of TensorFlow's `ExponentialMovingAverage`.
#[derive(Clone, Debug)]
pub(super) struct Average {
    decay: f64,
    values: BTreeMap<String, Vec<f32>>,
}

impl Average {
    /// Of a system that has taken no step.
    pub(super) fn new(decay: f64, system: &impl Module<f32>) -> Self {
        let mut values = BTreeMap::new();
        system.visit("", &mut |path: &str, param: &Param| {
            values.insert(path.to_owned(), param.as_slice().to_vec());
        });
        Self { decay, values }
    }

    /// As a checkpoint has it; parameters that it knows no average of begin with what they are.
    pub(super) fn read(decay: f64, system: &impl Module<f32>, state: &State) -> Self {
        let mut average = Self::new(decay, system);
        for (path, values) in &mut average.values {
            let stored = state.array::<f32>(&format!("{AVERAGE}.{path}"));
            if let Some(stored) = stored.filter(|stored| stored.len() == values.len()) {
                values.copy_from_slice(stored.as_slice());
            }
        }
        average
    }

    /// Adds what the parameters are after `steps` steps. One that has another length than before begins anew.
    pub(super) fn update(&mut self, system: &impl Module<f32>, steps: u64) {
        let rising = (1.0 + steps as f64) / (10.0 + steps as f64);
        let share = (1.0 - self.decay.min(rising)) as f32;
        system.visit("", &mut |path: &str, param: &Param| {
            let now = param.as_slice();
            match self.values.get_mut(path) {
                Some(mean) if mean.len() == now.len() => {
                    mean.iter_mut().zip(now).for_each(|(mean, now)| *mean += share * (now - *mean));
                }
                _ => drop(self.values.insert(path.to_owned(), now.to_vec())),
            }
        });
    }

    /// Puts the averages in the place of the parameters, and these in theirs.
    pub(super) fn swap(&mut self, system: &mut impl Module<f32>) {
        system.visit_mut("", &mut |path: &str, param: &mut Param| {
            if let Some(mean) = self.values.get_mut(path).filter(|mean| mean.len() == param.len()) {
                param.as_slice_mut().swap_with_slice(mean);
            }
        });
    }

    pub(super) fn save(&self, system: &impl Module<f32>, state: &mut State) {
        system.visit("", &mut |path: &str, param: &Param| {
            let Some(mean) = self.values.get(path) else { return };
            // What has grown since the last update is its own average.
            let mean = if mean.len() == param.len() { mean } else { param.as_slice() };
            state.insert(&format!("{AVERAGE}.{path}"), param.shape(), mean);
        });
    }
}

#[cfg(test)]
mod tests {
    use ndarray::arr1;

    use super::*;

    fn pair(trained: f32, buffer: f32) -> (Param, Param) {
        (Param::new(arr1(&[trained])), Param::buffer(arr1(&[buffer])))
    }

    /// Against the formula, written out.
    #[test]
    fn averages_follow_the_formula() {
        let mut average = Average::new(0.25, &pair(1.0, 1.0));
        average.update(&pair(3.0, 7.0), 1);
        // (1 + 1) / (10 + 1) is less than the decay.
        let first = [3.0 + 2.0 / 11.0 * (1.0 - 3.0), 7.0 + 2.0 / 11.0 * (1.0 - 7.0)];
        average.update(&pair(5.0, 8.0), 100);
        let mut system = pair(5.0, 8.0);
        average.swap(&mut system);
        let expected = [5.0 + 0.25 * (first[0] - 5.0), 8.0 + 0.25 * (first[1] - 8.0)];
        let found = [system.0.as_slice()[0], system.1.as_slice()[0]];
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{system:?}");
        average.swap(&mut system);
        assert_eq!(system.0.as_slice(), [5.0]);
    }

    #[test]
    fn what_has_grown_begins_anew() {
        let mut average = Average::new(0.9, &pair(1.0, 0.0));
        let grown = (Param::new(arr1(&[2.0_f32, 4.0])), Param::buffer(arr1(&[0.0_f32])));
        average.update(&grown, 50);
        let mut system = grown.clone();
        average.swap(&mut system);
        assert_eq!(system.0.as_slice(), [2.0, 4.0]);
    }

    /// Where a step was passed over since it grew.
    #[test]
    fn what_has_grown_is_saved_as_it_is() {
        let average = Average::new(0.9, &pair(1.0, 0.0));
        let grown = (Param::new(arr1(&[2.0_f32, 4.0])), Param::buffer(arr1(&[0.0_f32])));
        let mut state = State::new();
        average.save(&grown, &mut state);
        let saved = state.array::<f32>(&format!("{AVERAGE}.0"));
        assert_eq!(saved.map(|array| array.as_slice().to_vec()), Some(vec![2.0, 4.0]));
    }
}
