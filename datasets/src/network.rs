//! Networks in ONNX's form that take one image.

pub(crate) mod check;
#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
pub(crate) mod tiny;
mod wire;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use rten::{Dimension, Model, ModelOptions, Value};
use rten_tensor::prelude::*;
use rten_tensor::{NdTensor, Tensor};

/// Why a network could not be loaded or run.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", path.display())]
pub struct NetworkError {
    /// The model's file.
    pub path: PathBuf,
    /// What is wrong.
    #[source]
    pub problem: NetworkProblem,
}

/// What is wrong with a network.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NetworkProblem {
    /// The file cannot be read.
    #[error("cannot be read: {0}")]
    Io(#[source] std::io::Error),
    /// The file is no ONNX model, or needs an operator that the runtime has not.
    #[error("is not an ONNX model that can be loaded: {0}")]
    Load(String),
    /// The model does not take one image.
    #[error("takes {found}, expected one input [1, 3, H, W]")]
    Input {
        /// What it takes.
        found: String,
    },
    /// The model failed on the way.
    #[error("fails on an image of {height} x {width}: {what}")]
    Run {
        /// Rows that it was given.
        height: usize,
        /// Columns that it was given.
        width: usize,
        /// What the runtime said.
        what: String,
    },
    /// The answer is no number per pixel.
    #[error("answers with {found}, expected numbers [1, H, W], [1, 1, H, W] or [H, W]")]
    Output {
        /// What it answered with.
        found: String,
    },
}

/// A network that was loaded. The file is read whole; weights in files of their own (`external_data`) are found beside it.
pub(crate) struct Network {
    path: PathBuf,
    model: Model,
    /// The size of its input, where the file fixes it.
    pub(crate) size: [Option<usize>; 2],
}

/// Which of a network's outputs is its answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Answer {
    First,
    Last,
}

impl Network {
    /// Loads a network; what it expects of an image does not stand in its file.
    ///
    /// # Errors
    /// The file cannot be read, is no model, or the model does not take one image.
    pub(crate) fn open(path: &Path) -> Result<Self, NetworkError> {
        let failed = |problem| NetworkError { path: path.to_owned(), problem };
        let bytes = read_regular(path).map_err(|error| failed(NetworkProblem::Io(error)))?;
        let checked = check::check(&bytes).map_err(|what| failed(NetworkProblem::Load(what)))?;
        drop(bytes);
        for name in &checked.external {
            let weights = path.with_file_name(name);
            if weights.exists() && !weights.is_file() {
                let what = format!("{name}, which holds weights, is no file");
                return Err(failed(NetworkProblem::Load(what)));
            }
        }
        let mut options = ModelOptions::with_all_ops();
        options.enable_optimization(!checked.constants_may_grow);
        let model = guarded(|| options.load_file(path).map_err(|error| error.to_string()))
            .map_err(|what| failed(NetworkProblem::Load(what)))?;
        let size = input_size(&model).map_err(|found| failed(NetworkProblem::Input { found }))?;
        Ok(Self { path: path.to_owned(), model, size })
    }

    /// The numbers that it answers an image `[3, height, width]` with, and how many rows and columns they have.
    ///
    /// # Errors
    /// It fails, or answers with something else than a number per pixel.
    pub(crate) fn run(
        &self,
        values: Vec<f32>,
        [height, width]: [usize; 2],
        which: Answer,
    ) -> Result<(Vec<f32>, [usize; 2]), NetworkError> {
        let failed = |problem| NetworkError { path: self.path.clone(), problem };
        let tensor = NdTensor::from_data([1, 3, height, width], values);
        let outputs = self.model.output_ids();
        let output = match which {
            Answer::First => outputs[0],
            Answer::Last => outputs[outputs.len() - 1],
        };
        let run = || {
            let inputs = vec![(self.model.input_ids()[0], tensor.into())];
            let answer = self.model.run(inputs, &[output], None);
            let mut answer = answer.map_err(|error| error.to_string())?;
            answer.pop().ok_or_else(|| "nothing".to_owned())
        };
        let answer =
            guarded(run).map_err(|what| failed(NetworkProblem::Run { height, width, what }))?;
        image_of(answer).map_err(|found| failed(NetworkProblem::Output { found }))
    }
}

impl std::fmt::Debug for Network {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Network")
            .field("path", &self.path)
            .field("size", &self.size)
            .finish_non_exhaustive()
    }
}

/// The bytes of a file; a pipe or a device is none.
fn read_regular(path: &Path) -> std::io::Result<Vec<u8>> {
    if !std::fs::metadata(path)?.is_file() {
        return Err(std::io::Error::other("it is a folder, a pipe or a device"));
    }
    std::fs::read(path)
}

/// Any bytes may arrive as a model, and a panic over them is an error like others.
fn guarded<T>(f: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(f)).unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().cloned();
        let text = text.or_else(|| panic.downcast_ref::<&str>().map(|&s| s.to_owned()));
        Err(text.unwrap_or_else(|| "the runtime gave up".to_owned()))
    })
}

/// Rows and columns of the model's input, where they are fixed.
fn input_size(model: &Model) -> Result<[Option<usize>; 2], String> {
    if model.input_ids().len() != 1 || model.output_ids().is_empty() {
        let (inputs, outputs) = (model.input_ids().len(), model.output_ids().len());
        return Err(format!("{inputs} inputs (and gives {outputs} outputs)"));
    }
    // Without a shape in the file anything may be tried.
    let Some(shape) = model.input_shape(0) else { return Ok([None; 2]) };
    let fixed = |axis: &Dimension| match axis {
        Dimension::Fixed(n) => Some(*n),
        Dimension::Symbolic(_) => None,
    };
    let axes: Vec<Option<usize>> = shape.iter().map(fixed).collect();
    match axes[..] {
        [None | Some(1), None | Some(3), height, width]
            if height != Some(0) && width != Some(0) =>
        {
            Ok([height, width])
        }
        _ => {
            let name = |axis: &Option<usize>| axis.map_or("_".to_owned(), |n| n.to_string());
            Err(format!("[{}]", axes.iter().map(name).collect::<Vec<_>>().join(", ")))
        }
    }
}

/// One number per pixel, and how many rows and columns.
fn image_of(answer: Value) -> Result<(Vec<f32>, [usize; 2]), String> {
    let tensor: Tensor<f32> =
        answer.try_into().map_err(|_| "other things than floating-point numbers".to_owned())?;
    let size = match *tensor.shape() {
        [h, w] | [1, h, w] | [1, 1, h, w] | [1, h, w, 1] if h * w > 0 => [h, w],
        _ => return Err(format!("{:?}", tensor.shape())),
    };
    Ok((tensor.to_vec(), size))
}
