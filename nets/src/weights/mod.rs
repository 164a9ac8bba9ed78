//! Weights from files, by PyTorch's names.
//!
//! ```
//! use autodiff_lite::{ConvGeometry, state};
//! use nets::{Conv2d, Init, LoadWeights};
//!
//! # let folder = std::env::temp_dir().join("nets-weights-doc");
//! # std::fs::create_dir_all(&folder)?;
//! let path = folder.join("whole.safetensors");
//! let conv = |seed: u64| Conv2d::<f32>::new(&Init::new(seed), 3, 8, 3, ConvGeometry::new());
//! let whole = (conv(1), conv(2));
//! state::save(&path, &whole)?; // names `0.weight`, `0.bias`, `1.weight`, `1.bias`
//!
//! // A part of it, under other names; a `.pth` would do as well.
//! let mut part = conv(3);
//! LoadWeights::partial().map("1.=")?.load(&path, &mut part)?;
//! assert_eq!(part.weight.value, whole.1.weight.value);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod error;
mod freeze;
pub(crate) mod lpips_weights;
mod map;
mod pth;

use std::path::Path;

use autodiff_lite::state::{Mismatch, State};
use autodiff_lite::{Module, Param, Real};

pub use error::{FormatError, PthError, WeightsError};
pub use freeze::{freeze, unfreeze};
pub use map::{MapError, NameMap};

/// Reads a file of named arrays: safetensors, or PyTorch's `.pth` of either age (zip archives
/// since 1.6, and the sequence of pickles before), told apart by content. Nothing in the file is
/// executed.
///
/// Half, `bfloat16` and double precision are converted when a module is loaded; a checkpoint that
/// keeps the weights under `state_dict`, `model_state_dict` or `model` is looked into.
///
/// # Errors
/// If the file cannot be read or is of neither format.
pub fn read_weights(path: impl AsRef<Path>) -> Result<State, WeightsError> {
    let path = path.as_ref();
    let bytes =
        std::fs::read(path).map_err(|source| WeightsError::Io { path: path.to_owned(), source })?;
    weights_from_bytes(&bytes)
        .map_err(|source| WeightsError::Format { path: path.to_owned(), source })
}

/// [`read_weights`] of bytes. Memory is taken only for numbers that are there: at most 256 MB and 20
/// bytes for each of the file's.
///
/// # Errors
/// What is wrong with the bytes.
pub fn weights_from_bytes(bytes: &[u8]) -> Result<State, FormatError> {
    if pth::recognises(bytes) {
        Ok(pth::read(bytes)?)
    } else {
        State::from_bytes(bytes).map_err(FormatError::Safetensors)
    }
}

/// What the names of a model begin with that was trained as PyTorch's `DataParallel` or `DistributedDataParallel`.
const WRAPPED: &str = "module.";

/// How much a file may differ from the module.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Strictness {
    #[default]
    Strict,
    Partial,
    Lenient,
}

/// How weights are loaded into a module.
///
/// Where all names of a file begin with `module.`, as those of PyTorch's `DataParallel` do, they are taken without it, unless a rule of
/// the [map](Self::map) is for them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LoadWeights {
    strictness: Strictness,
    map: NameMap,
    widened: Vec<String>,
}

impl LoadWeights {
    /// The file must have exactly the names and shapes of the module.
    pub fn strict() -> Self {
        Self::default()
    }

    /// The file may have more names, being that of a larger model.
    pub fn partial() -> Self {
        Self { strictness: Strictness::Partial, ..Self::default() }
    }

    /// What fits is loaded, the rest reported.
    pub fn lenient() -> Self {
        Self { strictness: Strictness::Lenient, ..Self::default() }
    }

    /// Renames what the file holds first; the rules are those of [`NameMap`].
    ///
    /// # Errors
    /// If a rule cannot be read.
    pub fn map(self, rules: &str) -> Result<Self, MapError> {
        Ok(Self { map: rules.parse()?, ..self })
    }

    /// Lets the array of this name (after renaming) have fewer input channels, its second axis, in
    /// the file than in the module. Those there are copied; the module keeps its own values in the
    /// others, so that a network for colour and depth begins as one for colour:
    ///
    /// ```
    /// use nets::{Init, LoadWeights, ResNet, ResNetConfig};
    /// use autodiff_lite::state::State;
    ///
    /// let config = ResNetConfig { width: 4, ..ResNetConfig::resnet18() };
    /// let mut state = State::new(); // as it would be read from a file
    /// state.add_module("", &ResNet::<f32>::new(&Init::new(0), &config));
    /// let config = ResNetConfig { inputs: 4, ..config };
    /// let mut net = ResNet::<f32>::new(&Init::new(1), &config);
    /// LoadWeights::strict().widen("conv1.weight").load_state(state, &mut net)?;
    /// # Ok::<(), nets::WeightsError>(())
    /// ```
    #[must_use]
    pub fn widen(mut self, name: &str) -> Self {
        self.widened.push(name.to_owned());
        self
    }

    /// Loads a file into the module. The result says what differed and was allowed to.
    ///
    /// # Errors
    /// If the file cannot be read or does not fit as asked for: every name that is missing,
    /// unexpected or of another shape, with both shapes, at once. The module is then unchanged.
    pub fn load<F: Real>(
        &self,
        path: impl AsRef<Path>,
        module: &mut (impl Module<F> + ?Sized),
    ) -> Result<Mismatch, WeightsError> {
        let path = path.as_ref();
        self.load_from(path, read_weights(path)?, module)
    }

    /// [`load`](Self::load) of arrays that were read before.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn load_state<F: Real>(
        &self,
        state: State,
        module: &mut (impl Module<F> + ?Sized),
    ) -> Result<Mismatch, WeightsError> {
        self.load_from("the given arrays".as_ref(), state, module)
    }

    fn load_from<F: Real>(
        &self,
        path: &Path,
        state: State,
        module: &mut (impl Module<F> + ?Sized),
    ) -> Result<Mismatch, WeightsError> {
        let wrapped = !self.map.expects(WRAPPED)
            && state.names().next().is_some()
            && state.names().all(|name| name.starts_with(WRAPPED));
        let inner = |name: &str| match name.strip_prefix(WRAPPED) {
            Some(inner) if wrapped => self.map.apply(inner),
            _ => self.map.apply(name),
        };
        let mut state = state
            .renamed(inner)
            .map_err(|name| WeightsError::Twice { path: path.to_owned(), name })?;
        for name in &self.widened {
            widen(&mut state, name, module);
        }
        let found = state.compare_module("", module);
        let allowed = match self.strictness {
            Strictness::Strict => found == Mismatch::default(),
            Strictness::Partial => found.missing.is_empty() && found.different.is_empty(),
            Strictness::Lenient => true,
        };
        if !allowed {
            // What a partial load allows is not part of its complaint.
            let mut mismatch = found;
            if self.strictness == Strictness::Partial {
                mismatch.unexpected.clear();
            }
            return Err(WeightsError::Mismatch { path: path.to_owned(), mismatch });
        }
        state.load_matching("", module);
        Ok(found)
    }
}

/// Fills up the second axis of an array with the module's own values, if that is all it lacks.
fn widen<F: Real>(state: &mut State, name: &str, module: &(impl Module<F> + ?Sized)) {
    let Some(stored) = state.array::<F>(name) else { return };
    module.visit("", &mut |path: &str, param: &Param<F>| {
        let (file, own) = (stored.shape(), param.shape());
        let fits = path == name && file.len() == own.len() && file.len() > 1;
        if fits && file[0] == own[0] && file[1] < own[1] && file[2..] == own[2..] {
            let mut filled = param.value.clone();
            filled.view_mut().slice_axis_mut(ndarray::Axis(1), (..file[1]).into()).assign(&stored);
            state.insert(name, own, filled.as_slice());
        }
    });
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use autodiff_lite::ConvGeometry;

    use super::*;
    use crate::{Conv2d, Init};

    fn conv(seed: u64) -> Conv2d<f32> {
        Conv2d::new(&Init::new(seed), 3, 4, 3, ConvGeometry::new())
    }

    #[test]
    fn what_data_parallel_puts_before_all_names_is_left_away() {
        let saved = |prefix: &str| {
            let mut state = State::new();
            state.add_module(prefix, &conv(1));
            state
        };
        let mut loaded = conv(2);
        LoadWeights::strict().load_state(saved("module"), &mut loaded).unwrap();
        assert_eq!(loaded.weight.value, conv(1).weight.value);
        // With rules for what is inside, and with those for the whole names.
        for (prefix, rules) in
            [("module.features", "features.="), ("module.features", "module.features.=")]
        {
            let mut loaded = conv(2);
            let loading = LoadWeights::strict().map(rules).unwrap();
            loading.load_state(saved(prefix), &mut loaded).unwrap();
            assert_eq!(loaded.weight.value, conv(1).weight.value);
        }
        // A part of a model that is called so is one of several.
        let mut mixed = saved("module");
        mixed.add_module("head", &conv(1));
        let error = LoadWeights::partial().load_state(mixed, &mut conv(2)).unwrap_err();
        assert!(error.to_string().contains("weight"), "{error}");
    }
}
