//! One step's gradient: a batch cut into shards, each on a tape of its own.

use autodiff_lite::{Gradients, Module, Tape, Updates};
use rayon::prelude::*;

use super::draw::tape_seed;
use super::error::{LossError, TrainError};
use super::message::Message;
use super::non_finite::{locate_non_finite, without_value};
use super::ranks::Ranks;
use super::reduction::Reduction;
use super::share::Share;
use super::step_info::StepInfo;
use super::system::{System, Term, Terms};

/// The tapes of a run, kept so that their memory is, and what sums their gradients with those of other processes.
#[derive(Debug)]
pub(super) struct Tapes {
    of_shards: Vec<Tape>,
    share: Share,
    reduction: Reduction,
}

/// What the batches of a step amount to.
#[derive(Debug)]
pub(super) struct StepGradient {
    pub(super) gradients: Gradients,
    /// Weighted terms by name; their sum is the loss. Those of weight 0 are 0, whatever their value.
    pub(super) terms: Vec<(&'static str, f64)>,
    /// Euclidean norm of the gradients.
    pub(super) norm: f64,
    /// What running statistics learned, shard by shard: to be applied where the step is taken.
    updates: Vec<Updates>,
}

impl StepGradient {
    pub(super) fn loss(&self) -> f64 {
        self.terms.iter().map(|(_, value)| value).sum()
    }

    /// Moves the system's running statistics, in the order in which its shards were computed.
    pub(super) fn update(&mut self, system: &mut impl System) {
        self.updates.drain(..).for_each(|updates| updates.apply(system));
    }
}

/// What one tape computed: its share of the sums.
struct Part {
    gradients: Gradients,
    terms: Vec<(&'static str, f64)>,
    updates: Updates,
}

impl Tapes {
    /// Those of the shards that are this process's.
    pub(super) fn new(share: Share) -> Self {
        let of_shards = share.own_shards().map(|_| Tape::train(0)).collect();
        Self { of_shards, share, reduction: Reduction::default() }
    }

    /// The mean gradient over all samples, batch after batch; within a batch all shards at once,
    /// summed in their order. Of the samples those of this process are given. `meanwhile` runs beside the first batch,
    /// before parameters change.
    ///
    /// # Errors
    /// If anything is not finite, or a loss has no value, here or in another process.
    pub(super) fn gradient<S: System>(
        &mut self,
        system: &S,
        samples: &[S::Sample],
        (at, seed): (StepInfo, u64),
        ranks: &mut Ranks<'_>,
        meanwhile: impl FnOnce(&S) + Send,
    ) -> Result<StepGradient, TrainError> {
        let batches = samples.chunks(self.share.own_samples().len());
        let total = (batches.len() * self.share.batch) as f64;
        let mut sum: Option<StepGradient> = None;
        let mut meanwhile = Some(meanwhile);
        if !ranks.is_alone() {
            self.reduction.begin(system);
        }
        for (k, batch) in batches.enumerate() {
            let first = k * self.share.shards + self.share.own_shards().start;
            let seeds = |i: usize| tape_seed(seed, at.step, (first + i) as u64);
            let parts = self.parts(system, batch, at, seeds, total, meanwhile.take());
            let parts = ranks.together(parts)?;
            if ranks.is_alone() {
                sum = accumulate(sum, parts);
            } else {
                sum = Some(self.exchange(sum, system, parts, ranks));
            }
        }
        let mut gradient = sum.expect("a step has samples");
        if !ranks.is_alone() {
            gradient.gradients = self.reduction.end(system, &self.of_shards[0], ranks);
        }
        gradient.norm = gradient.gradients.norm();
        if gradient.norm.is_finite() && gradient.terms.iter().all(|(_, value)| value.is_finite()) {
            return Ok(gradient);
        }
        drop(gradient);
        Err(locate_non_finite(&mut self.of_shards[0], system, samples, &self.share, at, ranks))
    }

    /// What the shards of a batch compute, side by side.
    fn parts<S: System>(
        &mut self,
        system: &S,
        batch: &[S::Sample],
        at: StepInfo,
        seeds: impl Fn(usize) -> u64 + Sync,
        total: f64,
        meanwhile: Option<impl FnOnce(&S) + Send>,
    ) -> Result<Vec<Part>, TrainError> {
        let shard = self.share.samples_each();
        let tapes = self.of_shards.par_iter_mut().zip(batch.par_chunks(shard)).enumerate();
        let parts = tapes.map(|(i, (tape, chunk))| {
            tape.reseed(seeds(i));
            part(tape, system, chunk, chunk.len() as f64 / total, at)
        });
        let parts: Vec<Result<Part, LossError>> = match meanwhile {
            Some(other) => rayon::join(|| parts.collect(), || other(system)).0,
            None => parts.collect(),
        };
        let whole = parts.into_iter().zip(batch.chunks(shard)).map(|(part, chunk)| {
            part.map_err(|error| without_value(&mut self.of_shards[0], system, chunk, at, error))
        });
        whole.collect()
    }

    /// Adds what all processes computed of a batch. The gradients stay behind until all batches are done.
    fn exchange<S: System>(
        &mut self,
        sum: Option<StepGradient>,
        system: &S,
        parts: Vec<Part>,
        ranks: &mut Ranks<'_>,
    ) -> StepGradient {
        let names: Vec<&'static str> = parts[0].terms.iter().map(|(name, _)| *name).collect();
        let mut own = Vec::with_capacity(parts.len());
        for Part { gradients, terms, updates } in parts {
            let absent = self.reduction.lay(system, &gradients);
            own.push(Message::new(system, &terms, &updates, absent));
        }
        let all: Vec<Message> = ranks.gather(&own).into_iter().flatten().collect();
        let (mut terms, mut updates) =
            sum.map(|sum| (Some(sum.terms), sum.updates)).unwrap_or_default();
        for message in &all {
            updates.push(message.updates(system, &self.of_shards[0]));
            let values = names.iter().copied().zip(message.terms());
            match &mut terms {
                None => terms = Some(values.collect()),
                Some(terms) => add_terms(terms, values),
            }
        }
        let absent: Vec<Vec<usize>> = all.into_iter().map(|message| message.absent).collect();
        self.reduction.add(&self.share, &absent, ranks);
        let terms = terms.expect("a batch has shards");
        StepGradient { gradients: self.of_shards[0].gradients(), terms, norm: 0.0, updates }
    }
}

/// Adds what the shards of a batch computed, in their order.
fn accumulate(mut sum: Option<StepGradient>, parts: Vec<Part>) -> Option<StepGradient> {
    for Part { gradients, terms, updates } in parts {
        match &mut sum {
            None => {
                sum = Some(StepGradient { gradients, terms, norm: 0.0, updates: vec![updates] });
            }
            Some(sum) => {
                sum.gradients.accumulate(&gradients);
                add_terms(&mut sum.terms, terms.into_iter());
                sum.updates.push(updates);
            }
        }
    }
    sum
}

fn add_terms(terms: &mut [(&'static str, f64)], more: impl Iterator<Item = (&'static str, f64)>) {
    terms.iter_mut().zip(more).for_each(|((_, value), (_, more))| *value += more);
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
    let values = terms.0.iter().map(|term| (term.name, weighted(term, share))).collect();
    let gradients = match total(&terms, share) {
        Ok(total) => total.backward(),
        Err(error) => {
            drop(terms);
            tape.reset();
            return Err(error);
        }
    };
    let updates = tape.take_updates();
    drop(terms);
    tape.reset();
    Ok(Part { gradients, terms: values, updates })
}

/// What a term adds to the loss: nothing where its weight is 0, even if its value is none.
fn weighted(term: &Term<'_>, share: f64) -> f64 {
    if term.weight == 0.0 { 0.0 } else { share * term.weight * f64::from(term.value.item()) }
}

/// The weighted sum of the terms that count, of which there is at least one.
fn total<'t>(terms: &Terms<'t>, share: f64) -> Result<autodiff_lite::Var<'t>, LossError> {
    let scaled = terms.0.iter().filter(|term| term.weight != 0.0).map(|term| {
        let value = term.value.reshape(&[]);
        value.scale((share * term.weight) as f32)
    });
    scaled.reduce(|a, b| a + b).ok_or_else(|| {
        let terms = terms.0.iter().map(|term| term.name).collect();
        LossError::Weightless { terms }
    })
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
