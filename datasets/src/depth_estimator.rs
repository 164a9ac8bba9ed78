//! Depth from one image, by a network in ONNX's form.

mod check;
mod wire;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use mesh_core::{ByteImage, DisparityMap};
use rten::{Dimension, Model, ModelOptions, Value};
use rten_tensor::prelude::*;
use rten_tensor::{NdTensor, Tensor};

use crate::DepthInput;

/// Why an estimator could not be loaded or run.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", path.display())]
pub struct DepthModelError {
    /// The model's file.
    pub path: PathBuf,
    /// What is wrong.
    #[source]
    pub problem: DepthModelProblem,
}

/// What is wrong with an estimator.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DepthModelProblem {
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
    /// The answer is no depth map.
    #[error("answers with {found}, expected numbers [1, H, W], [1, 1, H, W] or [H, W]")]
    Output {
        /// What it answered with.
        found: String,
    },
}

/// A network that estimates disparity: MiDaS, Depth Anything, and others that are called as they are.
///
/// The file is read whole; weights in files of their own (`external_data`) are found beside it. Loading it is
/// bounded by the file's length: what follows from its constants is computed then if it cannot grow, otherwise
/// when it is run. A model is a program: running it may take any time and memory that it wants, so run those
/// that you trust. The runtime (rten, in
/// Rust throughout) has a pool of threads of its own, which no `--threads` reaches, and reads environment
/// variables that begin with `RTEN_`.
///
/// ```no_run
/// use datasets::{DepthEstimator, DepthInput};
///
/// let midas = DepthEstimator::open("midas_v21_small_256.onnx", DepthInput::midas_small())?;
/// let image = mesh_core::read_image("chair.png")?.over([255; 3]);
/// let disparity = midas.estimate(&image)?; // larger is nearer, in no unit
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct DepthEstimator {
    path: PathBuf,
    input: DepthInput,
    model: Model,
    /// The size of its input, where the file fixes it.
    size: [Option<usize>; 2],
}

impl std::fmt::Debug for DepthEstimator {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("DepthEstimator")
            .field("path", &self.path)
            .field("input", &self.input)
            .field("size", &self.size)
            .finish_non_exhaustive()
    }
}

impl DepthEstimator {
    /// Loads a model; what it expects of an image does not stand in its file.
    ///
    /// # Errors
    /// The file cannot be read, is no model, or the model does not take one image.
    pub fn open(path: impl AsRef<Path>, input: DepthInput) -> Result<Self, DepthModelError> {
        let path = path.as_ref();
        let failed = |problem| DepthModelError { path: path.to_owned(), problem };
        let bytes = read_regular(path).map_err(|error| failed(DepthModelProblem::Io(error)))?;
        let checked = check::check(&bytes).map_err(|what| failed(DepthModelProblem::Load(what)))?;
        drop(bytes);
        for name in &checked.external {
            let weights = path.with_file_name(name);
            if weights.exists() && !weights.is_file() {
                let what = format!("{name}, which holds weights, is no file");
                return Err(failed(DepthModelProblem::Load(what)));
            }
        }
        let mut options = ModelOptions::with_all_ops();
        options.enable_optimization(!checked.constants_may_grow);
        let model = guarded(|| options.load_file(path).map_err(|error| error.to_string()))
            .map_err(|what| failed(DepthModelProblem::Load(what)))?;
        let size =
            input_size(&model).map_err(|found| failed(DepthModelProblem::Input { found }))?;
        Ok(Self { path: path.to_owned(), input, model, size })
    }

    /// The disparity of an image, at its size: larger is nearer, up to a scale and a shift that differ from
    /// image to image.
    ///
    /// Where the model's file fixes the size of its input, that is used in place of the one that the
    /// [`DepthInput`] would give. Grey images are taken as colour, and alpha is ignored: put the object over
    /// a background first.
    ///
    /// # Errors
    /// The model fails, or answers with something else than a number per pixel.
    /// # Panics
    /// If the image has no pixels.
    pub fn estimate(&self, picture: &ByteImage) -> Result<DisparityMap, DepthModelError> {
        let failed = |problem| DepthModelError { path: self.path.clone(), problem };
        let wanted = self.input.size(picture.height, picture.width);
        let [height, width] = [0, 1].map(|k| self.size[k].unwrap_or(wanted[k]));
        let values = self.input.prepare(picture, [height, width]);
        let tensor = NdTensor::from_data([1, 3, height, width], values);
        let run = || {
            let answer = self.model.run_one(tensor.into(), None);
            answer.map_err(|error| error.to_string())
        };
        let answer =
            guarded(run).map_err(|what| failed(DepthModelProblem::Run { height, width, what }))?;
        let (values, size) =
            image_of(answer).map_err(|found| failed(DepthModelProblem::Output { found }))?;
        Ok(self.input.restore(&values, size, [picture.height, picture.width]))
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

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests;
