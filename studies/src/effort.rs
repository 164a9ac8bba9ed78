//! What a model takes: a step of its training, and a prediction.

use std::time::Instant;

use autodiff_lite::Tape;
use mesh_core::{MedianOfEven, median};
use train::{Configuration, DataError, Draw, StepInfo, System};

use crate::row::{Cell, Row};
use crate::work::Trained;

/// The columns, for captions.
pub(crate) const ABOUT: &str = "MB a step: all buffers that the tapes of a training step ask for. Predict: from an image in memory to the mesh, \
                                median.";
/// Predictions that are timed; their median counts.
const TIMED: usize = 9;

/// With seconds and memory of a training step, and the time of `predict`, which makes one mesh.
///
/// # Errors
/// If a file cannot be read.
pub(crate) fn with_effort<S: System>(
    row: Row,
    trained: &Trained<S>,
    (config, data): (&Configuration<S::Config>, &S::Data),
    predict: impl FnMut(),
) -> Result<Row, DataError> {
    let seconds = trained.seconds / trained.steps.max(1) as f64;
    let megabytes = step_bytes(&trained.system, config, data)? / 1e6;
    Ok(row
        .with(Cell::smaller("s a step", seconds, 3))
        .with(Cell::smaller("MB a step", megabytes, 1))
        .with(Cell::smaller("predict, ms", millis(predict), 1)))
}

/// The median of what a call takes.
pub(crate) fn millis(mut call: impl FnMut()) -> f64 {
    let times = (0..TIMED).map(|_| {
        let start = Instant::now();
        call();
        1e3 * start.elapsed().as_secs_f64()
    });
    median(times, MedianOfEven::Upper).expect("it is called")
}

/// The first samples of a training.
///
/// # Errors
/// If a file cannot be read.
pub(crate) fn samples<S: System>(
    system: &S,
    data: &S::Data,
    count: usize,
) -> Result<Vec<S::Sample>, DataError> {
    let len = system.epoch_len(data).max(1);
    let draw = |i: usize| Draw { seed: 0, epoch: 0, index: i as u64, item: i % len };
    (0..count).map(|i| system.draw(data, &draw(i))).collect()
}

/// The bytes that a training step's tapes ask for, all shards together.
///
/// # Errors
/// If a file cannot be read.
pub(crate) fn step_bytes<S: System>(
    system: &S,
    config: &Configuration<S::Config>,
    data: &S::Data,
) -> Result<f64, DataError> {
    let shards = if system.coupling().is_some() { 1 } else { config.train.shards.max(1) };
    let batch = samples(system, data, config.train.batch.div_ceil(shards))?;
    let mut tape = Tape::train(0);
    one_step(system, &batch, &tape);
    tape.reset();
    Ok((tape.pool().bytes() * shards) as f64)
}

/// Loss and gradients. What has no value, an equation that could not be solved, takes what it took until then.
pub(crate) fn one_step<S: System>(system: &S, batch: &[S::Sample], tape: &Tape) {
    let Ok(terms) = system.loss(tape, batch, StepInfo { step: 0, epoch: 0 }) else { return };
    let total = terms.0.iter().map(|term| term.value.scale(term.weight as f32));
    if let Some(total) = total.reduce(|a, b| a + b) {
        std::hint::black_box(total.backward());
    }
}
