//! Checkpoints: parameters, optimiser, and where the run was, in one safetensors file.
//!
//! The metadata holds `format` (2), `checksum` (of all bytes of the file, as [`Fingerprint`] has it, with zeros in its own
//! place; files of format 1 have none), `system`, `step`, `epochs-begun`, `pending` (whether the
//! evaluation of an epoch that just ended is still to come), `best`, `average`, of weights that are given away `card`, and `config`, the
//! whole configuration as TOML; averaged weights stand under `optim.average.PATH`, what is noted of a network beside its
//! weights under `optim.beside.NAME`. Numbers are printed so that they read back bit by bit.

use std::path::Path;

use autodiff_lite::Tensor;
use autodiff_lite::state::{LoadError, Mismatch, SaveError, State};

use super::average::{AVERAGE, Average};
use super::config::{Configuration, TrainConfig};
use super::error::CheckpointError;
use super::fingerprint::Fingerprint;
use super::inherited::Inherited;
use super::optimizer::{AnyOptimizer, OptimizerState};
use super::system::{System, best_of};
use crate::output::disk::write_whole;
use crate::settings::Tabular as _;

const FORMAT: &str = "2";
/// Without a checksum; otherwise the same.
const FORMER: &str = "1";
/// How the checksum's entry begins in the file; within other entries a quote has a backslash before it.
const CHECKSUM: &[u8] = b"\"checksum\":\"";
/// The entry that holds the model card.
const CARD: &str = "card";
/// What the names of arrays beside the parameters begin with: as they are no parameters, whoever loads these passes over them.
const BESIDE: &str = "optim.beside.";
/// Arrays of so few numbers stay whole where weights are halved: it saves nothing, and the frame of a world is among them, which may be
/// anywhere; half precision has three digits, and ends at 65,504.
const SMALL: usize = 16;
/// In place of the checksum while it is computed.
const ZEROS: &str = "0000000000000000";

/// Where a run stands, beside its parameters.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct TrainState {
    /// Steps taken.
    pub(super) step: u64,
    /// How often the system was told that an epoch begins.
    pub(super) epochs_begun: u64,
    /// Whether what follows the end of an epoch is still to be done.
    pub(super) pending: bool,
    /// The best value of the chosen metric and the step that had it.
    pub(super) best: Option<(f64, u64)>,
    /// Moving average of the losses.
    pub(super) average: Option<f64>,
    /// Steps in a row, up to the last one, that were left out as spikes.
    pub(super) skipped: u64,
}

/// A checkpoint as it was read: sound as a file, not yet a system.
#[derive(Debug)]
pub struct Checkpoint<'a> {
    path: &'a Path,
    state: State,
}

impl<'a> Checkpoint<'a> {
    /// Reads a file.
    ///
    /// # Errors
    /// If it cannot be read, is no safetensors file, was damaged after it was written, or is no checkpoint of a training.
    pub fn read(path: &'a Path) -> Result<Self, CheckpointError> {
        let bytes = std::fs::read(path)
            .map_err(|source| LoadError::Io { path: path.to_owned(), source })?;
        Self::from_bytes(path, &bytes)
    }

    /// The bytes of a file that has, or is to have, this name.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn from_bytes(path: &'a Path, bytes: &[u8]) -> Result<Self, CheckpointError> {
        let state = State::from_bytes(bytes)
            .map_err(|reason| LoadError::Format { path: path.to_owned(), reason })?;
        let checkpoint = Self { path, state };
        // First of all: what else is wrong may be wrong because of the damage.
        if let Some(expected) = checkpoint.state.metadata.get("checksum") {
            let found = checksum(&mut bytes.to_owned());
            if found != *expected {
                let (path, expected) = (path.to_owned(), expected.clone());
                return Err(CheckpointError::Damaged { path, found, expected });
            }
        }
        match checkpoint.entry("format")? {
            FORMAT => checkpoint.entry("checksum").map(drop)?,
            FORMER => {}
            format => return Err(checkpoint.wrong("format", format, FORMAT)),
        }
        Ok(checkpoint)
    }

    /// The name of the system it is of.
    ///
    /// # Errors
    /// If the file does not say.
    pub fn system(&self) -> Result<&str, CheckpointError> {
        self.entry("system")
    }

    /// Steps that were taken.
    ///
    /// # Errors
    /// If the file does not say, or says what cannot be.
    pub fn step(&self) -> Result<u64, CheckpointError> {
        let step: u64 = self.number("step")?;
        self.countable("step", step)
    }

    /// The configuration of the run.
    ///
    /// # Errors
    /// If it is of another system, or the configuration is damaged or out of range.
    pub fn config<S: System>(&self) -> Result<Configuration<S::Config>, CheckpointError> {
        let system = self.system()?;
        if system != S::NAME {
            return Err(self.wrong("system", system, S::NAME));
        }
        let text = self.entry("config")?;
        let config = Configuration::<S::Config>::from_text(text)
            .map_err(|error| self.wrong("config", "damaged", error.message()))?;
        let problems = S::problems(&config);
        if problems.is_empty() {
            return Ok(config);
        }
        Err(self.wrong("config", "out of range", &problems.join("; ")))
    }

    /// A fresh system led to the checkpoint's shapes and filled with its values.
    fn rebuild<S: System>(
        &self,
        config: &Configuration<S::Config>,
        optimizer: &mut AnyOptimizer,
    ) -> Result<(S, TrainState), CheckpointError> {
        let system = self.system()?;
        if system != S::NAME {
            return Err(self.wrong("system", system, S::NAME));
        }
        let state = self.state()?;
        let (begun, epochs) = (state.epochs_begun, config.train.epochs);
        if begun > epochs {
            return Err(self.wrong("epochs-begun", &begun.to_string(), &format!("0 to {epochs}")));
        }
        let mut system = S::new(&config.system, config.train.seed);
        for epoch in 0..state.epochs_begun {
            system.begin_epoch(epoch, &mut OptimizerState(optimizer));
        }
        self.state.load_module("", &mut system).map_err(|mismatch| self.unlike(mismatch))?;
        Ok((system, state))
    }

    /// Gives a fresh system the weights of the checkpoint, where both have an array of a name.
    ///
    /// # Errors
    /// If it is of another system, has nothing that the system has, or an array of another shape.
    pub(super) fn lend<S: System>(&self, system: &mut S) -> Result<Inherited, CheckpointError> {
        let name = self.system()?;
        if name != S::NAME {
            return Err(self.wrong("system", name, S::NAME));
        }
        let arrays = self.arrays();
        let Mismatch { missing, unexpected, different } = arrays.compare_module("", system);
        let taken = arrays.names().count() - unexpected.len();
        if !different.is_empty() || taken == 0 {
            return Err(self
                .unlike(Mismatch {
                    missing: if taken == 0 { missing } else { Vec::new() },
                    different,
                    ..Mismatch::default()
                })
                .into());
        }
        arrays.load_matching("", system);
        let is_taken = |name: &&str| unexpected.iter().all(|other| other != name);
        let first = |name: &str| name.split('.').next().unwrap_or(name).to_owned();
        let parts = arrays.names().filter(is_taken).map(first).collect();
        Ok(Inherited { taken, fresh: missing, unused: unexpected, parts })
    }

    /// What is given away of a training: the weights that predict, in half precision, with the configuration and a model card,
    /// and without what only going on needs. It is a checkpoint like any other: it loads, and a training can begin with it.
    pub fn weights(&self, card: &str) -> Vec<u8> {
        self.weights_beside(card, &State::new())
    }

    /// The same with arrays beside the weights, in full precision: what was learned of the network after its training.
    pub fn weights_beside(&self, card: &str, beside: &State) -> Vec<u8> {
        let whole = self.arrays();
        let mut weights = self.arrays().halved();
        for name in whole.names() {
            let array = whole.array::<f32>(name);
            if let Some(array) = array.filter(|array| array.len() <= SMALL) {
                weights.insert(name, array.shape(), array.as_slice());
            }
        }
        for (name, array) in
            beside.names().filter_map(|name| Some((name, beside.array::<f32>(name)?)))
        {
            weights.insert(&format!("{BESIDE}{name}"), array.shape(), array.as_slice());
        }
        weights.metadata.clone_from(&self.state.metadata);
        weights.metadata.insert(CARD.to_owned(), card.to_owned());
        weights.metadata.insert("checksum".to_owned(), ZEROS.to_owned());
        weights.metadata.insert("format".to_owned(), FORMAT.to_owned());
        seal(weights.to_bytes())
    }

    /// An array that stands [beside](Self::weights_beside) the weights, if there is one of this name.
    ///
    /// # Shapes
    /// Whatever the file says, of as many numbers as it has.
    pub fn beside(&self, name: &str) -> Option<Tensor<f32>> {
        self.state.array(&format!("{BESIDE}{name}"))
    }

    /// The model card, where there is one: Markdown that says what the weights are of, and how good they are.
    pub fn card(&self) -> Option<&str> {
        self.state.metadata.get(CARD).map(String::as_str)
    }

    /// The weights that predict, under the names of the system's parameters.
    fn arrays(&self) -> State {
        let averages = format!("{AVERAGE}.");
        let averaged = self.is_averaged();
        let mut arrays = State::new();
        for name in self.state.names() {
            let own = if averaged {
                name.strip_prefix(&averages)
            } else {
                Some(name).filter(|name| !name.starts_with("optim."))
            };
            if let Some((own, array)) = own.zip(self.state.array::<f32>(name)) {
                arrays.insert(own, array.shape(), array.as_slice());
            }
        }
        arrays
    }

    /// Whether averages predict.
    fn is_averaged(&self) -> bool {
        self.state.names().any(|name| name.starts_with(AVERAGE))
    }

    fn unlike(&self, mismatch: Mismatch) -> LoadError {
        LoadError::Mismatch { path: self.path.to_owned(), mismatch }
    }

    /// Everything that a run needs to go on.
    pub(super) fn resume<S: System>(
        &self,
        config: &Configuration<S::Config>,
    ) -> Result<(S, AnyOptimizer, Option<Average>, TrainState), CheckpointError> {
        let mut scratch = AnyOptimizer::new(&config.train, &[]);
        let (system, mut state) = self.rebuild::<S>(config, &mut scratch)?;
        let before = Configuration::<S::Config>::from_text(self.entry("config")?)
            .map_err(|error| self.wrong("config", "damaged", error.message()))?;
        if best_of::<S>(&before.train) != best_of::<S>(&config.train) {
            // It is a value of another metric.
            state.best = None;
        }
        let mut optimizer = AnyOptimizer::new(&config.train, &system.rates());
        optimizer.load(&self.state).map_err(|mismatch| self.unlike(mismatch))?;
        if let Some((path, found, expected)) = optimizer.misfit(&system) {
            let found = format!("{found} numbers for `{path}`");
            return Err(self.wrong("optim", &found, &expected.to_string()));
        }
        let average =
            config.train.ema_decay.map(|decay| Average::read(decay, &system, &self.state));
        Ok((system, optimizer, average, state))
    }

    fn state(&self) -> Result<TrainState, CheckpointError> {
        let step = self.step()?;
        let epochs_begun: u64 = self.number("epochs-begun")?;
        let best = match self.entry("best")? {
            "none" => None,
            text => {
                let parts = text.split_once(" at ").map(|(v, s)| (v.parse().ok(), s.parse().ok()));
                let Some((Some(value), Some(step))) = parts else {
                    return Err(self.wrong("best", text, "`VALUE at STEP` or none"));
                };
                Some((value, self.countable("best", step)?))
            }
        };
        let average = match self.entry("average")? {
            "none" => None,
            text => {
                let average: f64 = self.number("average")?;
                if !average.is_finite() {
                    return Err(self.wrong("average", text, "a finite number"));
                }
                Some(average)
            }
        };
        // Where no step was left out just before, and in files of earlier versions, there is no such entry.
        let skipped = match self.state.metadata.get("skipped") {
            Some(_) => self.number("skipped")?,
            None => 0,
        };
        let pending = self.number("pending")?;
        Ok(TrainState { step, epochs_begun, pending, best, average, skipped })
    }

    fn entry(&self, field: &'static str) -> Result<&str, CheckpointError> {
        let entry = self.state.metadata.get(field).map(String::as_str);
        entry.ok_or_else(|| self.wrong(field, "missing", "an entry of a training's checkpoint"))
    }

    fn number<T: std::str::FromStr>(&self, field: &'static str) -> Result<T, CheckpointError> {
        let text = self.entry(field)?;
        text.parse().map_err(|_| self.wrong(field, text, std::any::type_name::<T>()))
    }

    /// No training has more steps: a configuration cannot ask for them.
    fn countable(&self, field: &'static str, step: u64) -> Result<u64, CheckpointError> {
        let sound = i64::try_from(step).is_ok();
        let expected = "a step of at most 2^63 - 1";
        if sound { Ok(step) } else { Err(self.wrong(field, &step.to_string(), expected)) }
    }

    /// That an entry of this file cannot be: what it is and what it might be.
    pub fn wrong(&self, field: &'static str, found: &str, expected: &str) -> CheckpointError {
        let (found, expected) = (found.to_owned(), expected.to_owned());
        CheckpointError::Metadata { path: self.path.to_owned(), field, found, expected }
    }
}

/// The checksum of a checkpoint's bytes, whatever stands in its place: zeros afterwards.
fn checksum(bytes: &mut [u8]) -> String {
    if let Some(place) = place(bytes) {
        bytes[place].copy_from_slice(ZEROS.as_bytes());
    }
    format!("{:016x}", Fingerprint::new().with(bytes).value())
}

/// Where the checksum stands.
fn place(bytes: &[u8]) -> Option<std::ops::Range<usize>> {
    let at = bytes.windows(CHECKSUM.len()).position(|window| window == CHECKSUM)?;
    let place = at + CHECKSUM.len()..at + CHECKSUM.len() + ZEROS.len();
    (bytes.get(place.end) == Some(&b'"')).then_some(place)
}

/// The trained system; see [`Checkpoint::load_as`].
pub(super) fn load<S: System>(
    checkpoint: &Checkpoint<'_>,
    config: &Configuration<S::Config>,
) -> Result<S, CheckpointError> {
    let mut optimizer = AnyOptimizer::new(&TrainConfig::default(), &[]);
    let mut system = checkpoint.rebuild::<S>(config, &mut optimizer)?.0;
    if checkpoint.is_averaged() {
        let averages = checkpoint.state.load_module(AVERAGE, &mut system);
        averages.map_err(|mismatch| checkpoint.unlike(mismatch))?;
    }
    Ok(system)
}

/// Writes the checksum into the bytes of a checkpoint, in place of what stands there.
pub(super) fn seal(mut bytes: Vec<u8>) -> Vec<u8> {
    let place = place(&bytes).expect("the entry was added");
    let checksum = checksum(&mut bytes);
    bytes[place].copy_from_slice(checksum.as_bytes());
    bytes
}

/// Writes a checkpoint, whole or not at all, for good.
pub(super) fn save<S: System>(
    path: &Path,
    system: &S,
    (optimizer, average): (&AnyOptimizer, Option<&Average>),
    state: &TrainState,
    config: &Configuration<S::Config>,
) -> Result<(), CheckpointError> {
    let mut file = State::new();
    file.add_module("", system);
    optimizer.save(&mut file);
    if let Some(average) = average {
        average.save(system, &mut file);
    }
    let best = state.best.map(|(value, step)| format!("{value:?} at {step}"));
    let average = state.average.map(|average| format!("{average:?}"));
    for (name, text) in [
        ("format", FORMAT.to_owned()),
        ("checksum", ZEROS.to_owned()),
        ("system", S::NAME.to_owned()),
        ("step", state.step.to_string()),
        ("epochs-begun", state.epochs_begun.to_string()),
        ("pending", state.pending.to_string()),
        ("best", best.unwrap_or_else(|| "none".to_owned())),
        ("average", average.unwrap_or_else(|| "none".to_owned())),
        ("config", crate::settings::to_toml(config)),
    ] {
        file.metadata.insert(name.to_owned(), text);
    }
    if state.skipped > 0 {
        file.metadata.insert("skipped".to_owned(), state.skipped.to_string());
    }
    let bytes = file.to_bytes();
    drop(file);
    write_whole(path, &seal(bytes))
        .map_err(|source| SaveError { path: path.to_owned(), source }.into())
}
