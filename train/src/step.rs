//! One step's gradient: a batch cut into shards, each on a tape of its own.

use autodiff_lite::{Gradients, Module, Tape, Updates};
use rayon::prelude::*;

use super::draw::tape_seed;
use super::error::{LossError, TrainError};
use super::non_finite::{locate_non_finite, without_value};
use super::step_info::StepInfo;
use super::system::{System, Terms};

/// The tapes of a run, kept so that their memory is.
#[derive(Debug)]
pub(super) struct Tapes(Vec<Tape>);

/// What the batches of a step amount to.
#[derive(Debug)]
pub(super) struct StepGradient {
    pub(super) gradients: Gradients,
    /// Weighted terms by name; their sum is the loss.
    pub(super) terms: Vec<(&'static str, f64)>,
    /// Euclidean norm of the gradients.
    pub(super) norm: f64,
}

impl StepGradient {
    pub(super) fn loss(&self) -> f64 {
        self.terms.iter().map(|(_, value)| value).sum()
    }
}

/// What one tape computed: its share of the sums.
struct Part {
    gradients: Gradients,
    terms: Vec<(&'static str, f64)>,
    updates: Updates,
}

impl Tapes {
    pub(super) fn new(shards: usize) -> Self {
        Self((0..shards).map(|_| Tape::train(0)).collect())
    }

    /// The mean gradient over all samples, batch after batch; within a batch all shards at once,
    /// summed in their order. `meanwhile` runs beside the first batch, before parameters change.
    ///
    /// # Errors
    /// If anything is not finite, or a loss has no value.
    pub(super) fn gradient<S: System>(
        &mut self,
        system: &mut S,
        samples: &[S::Sample],
        batch: usize,
        at: StepInfo,
        seed: u64,
        meanwhile: impl FnOnce(&S) + Send,
    ) -> Result<StepGradient, TrainError> {
        let shard = batch.div_ceil(self.0.len());
        let mut sum: Option<StepGradient> = None;
        let mut meanwhile = Some(meanwhile);
        for (k, batch) in samples.chunks(batch).enumerate() {
            let first = (k * self.0.len()) as u64;
            let fresh: &S = system;
            let tapes = self.0.par_iter_mut().zip(batch.par_chunks(shard)).enumerate();
            let parts = tapes.map(|(i, (tape, chunk))| {
                tape.reseed(tape_seed(seed, at.step, first + i as u64));
                let share = chunk.len() as f64 / samples.len() as f64;
                part(tape, fresh, chunk, share, at)
            });
            let parts: Vec<Result<Part, LossError>> = match meanwhile.take() {
                Some(other) => rayon::join(|| parts.collect(), || other(fresh)).0,
                None => parts.collect(),
            };
            for (part, chunk) in parts.into_iter().zip(batch.chunks(shard)) {
                let part = match part {
                    Ok(part) => part,
                    Err(error) => {
                        return Err(without_value(&mut self.0[0], system, chunk, at, error));
                    }
                };
                part.updates.apply(system);
                match &mut sum {
                    None => {
                        let Part { gradients, terms, .. } = part;
                        sum = Some(StepGradient { gradients, terms, norm: 0.0 });
                    }
                    Some(sum) => {
                        sum.gradients.accumulate(&part.gradients);
                        for ((_, value), (_, more)) in sum.terms.iter_mut().zip(&part.terms) {
                            *value += more;
                        }
                    }
                }
            }
        }
        let mut gradient = sum.expect("a step has samples");
        gradient.norm = gradient.gradients.norm();
        if gradient.norm.is_finite() && gradient.terms.iter().all(|(_, value)| value.is_finite()) {
            return Ok(gradient);
        }
        drop(gradient);
        Err(Box::new(locate_non_finite(&mut self.0[0], system, samples, shard, at)).into())
    }
}

fn part<S: System>(
    tape: &mut Tape,
    system: &S,
    chunk: &[S::Sample],
    share: f64,
    at: StepInfo,
) -> Result<Part, LossError> {
    let terms = match system.loss(tape, chunk, at) {
        Ok(terms) => terms,
        Err(error) => {
            tape.reset();
            return Err(error);
        }
    };
    let values = terms
        .0
        .iter()
        .map(|term| (term.name, share * term.weight * f64::from(term.value.item())))
        .collect();
    let gradients = total(&terms, share).backward();
    let updates = tape.take_updates();
    drop(terms);
    tape.reset();
    Ok(Part { gradients, terms: values, updates })
}

/// The weighted sum of the terms that count.
fn total<'t>(terms: &Terms<'t>, share: f64) -> autodiff_lite::Var<'t> {
    let scaled = terms.0.iter().filter(|term| term.weight != 0.0).map(|term| {
        let value = term.value.reshape(&[]);
        value.scale((share * term.weight) as f32)
    });
    scaled.reduce(|a, b| a + b).expect("a loss has a term whose weight is not 0")
}

/// The path of the first parameter that is not finite.
pub(super) fn non_finite_parameter(module: &impl Module<f32>) -> Option<String> {
    let mut found = None;
    module.visit("", &mut |path: &str, param: &autodiff_lite::Param| {
        if found.is_none() && param.as_slice().iter().any(|x| !x.is_finite()) {
            found = Some(path.to_owned());
        }
    });
    found
}
