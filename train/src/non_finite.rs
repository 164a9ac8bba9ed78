//! Who made a number that is none: found by doing the step again in small pieces.

use autodiff_lite::{Gradients, Param, Tape};

use super::error::{LossError, TrainError};
use super::not_finite::{NotFinite, Tensor};
use super::ranks::Ranks;
use super::share::Share;
use super::step::non_finite_parameter;
use super::step_info::StepInfo;
use super::system::System;

/// Repeats a step that failed: each sample alone, then shard by shard, each term by itself. Every process repeats what
/// was its own, of `samples`; what is not found by all it is told by the others.
pub(super) fn locate_non_finite<S: System>(
    tape: &mut Tape,
    system: &S,
    samples: &[S::Sample],
    share: &Share,
    at: StepInfo,
    ranks: &mut Ranks<'_>,
) -> TrainError {
    let StepInfo { step, epoch } = at;
    let parameter = non_finite_parameter(system).map(Tensor::Parameter);
    let batches = || samples.chunks(share.own_samples().len());
    let shard = share.samples_each();
    let sizes = if shard > 1 { vec![1, shard] } else { vec![1] };
    for size in sizes {
        let found = batches().flat_map(|batch| batch.chunks(size)).find_map(|chunk| {
            tape.reset();
            let (term, tensor) = first_non_finite(tape, system, chunk, at)?;
            let (term, tensor) = (term.to_owned(), parameter.clone().unwrap_or(tensor));
            Some(NotFinite { step, epoch, term, tensor, sample: named(&names::<S>(chunk)) })
        });
        let found = found.map_or(Ok(()), |found| Err(Box::new(found).into()));
        if let Err(error) = ranks.together(found) {
            return error;
        }
    }
    let tensor = parameter.unwrap_or(Tensor::Sum);
    let sample = named(&ranks.gather(&names::<S>(samples)).concat());
    Box::new(NotFinite { step, epoch, term: String::new(), tensor, sample }).into()
}

/// Why a loss has no value: the first sample that has none by itself, or else all of them together.
pub(super) fn without_value<S: System>(
    tape: &mut Tape,
    system: &S,
    samples: &[S::Sample],
    at: StepInfo,
    error: LossError,
) -> TrainError {
    let StepInfo { step, epoch } = at;
    for one in samples.chunks(1) {
        tape.reset();
        if let Err(error) = system.loss(tape, one, at) {
            return TrainError::Loss { step, epoch, samples: named(&names::<S>(one)), error };
        }
    }
    TrainError::Loss { step, epoch, samples: named(&names::<S>(samples)), error }
}

fn names<S: System>(samples: &[S::Sample]) -> Vec<String> {
    samples.iter().map(S::name_of).collect()
}

fn named(names: &[String]) -> String {
    let noun = if names.len() == 1 { "sample" } else { "samples" };
    format!("{noun} {}", names.join(", "))
}

fn first_non_finite<S: System>(
    tape: &Tape,
    system: &S,
    chunk: &[S::Sample],
    at: StepInfo,
) -> Option<(&'static str, Tensor)> {
    // One without a value is told before it comes to this.
    let terms = system.loss(tape, chunk, at).ok()?;
    let counted = || terms.0.iter().filter(|term| term.weight != 0.0);
    if let Some(term) = counted().find(|term| !term.value.item().is_finite()) {
        return Some((term.name, Tensor::Value));
    }
    counted().find_map(|term| {
        let path = last_spoiled(system, &term.value.backward())?;
        Some((term.name, Tensor::Gradient(path)))
    })
}

/// Gradients flow from the last layers to the first, so the last that is spoiled is nearest to
/// where it began.
fn last_spoiled<S: System>(system: &S, gradients: &Gradients) -> Option<String> {
    let mut found = None;
    system.visit("", &mut |path: &str, param: &Param| {
        let gradient = gradients.slice_of(param).unwrap_or_default();
        if gradient.iter().any(|g| !g.is_finite()) {
            found = Some(path.to_owned());
        }
    });
    found
}
