//! Depth from one image, by a network in ONNX's form.

use std::path::Path;

use mesh_core::{ByteImage, DisparityMap};

use crate::DepthInput;
use crate::network::{Answer, Network, NetworkError};

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
#[derive(Debug)]
pub struct DepthEstimator {
    input: DepthInput,
    network: Network,
}

impl DepthEstimator {
    /// Loads a model; what it expects of an image does not stand in its file.
    ///
    /// # Errors
    /// The file cannot be read, is no model, or the model does not take one image.
    pub fn open(path: impl AsRef<Path>, input: DepthInput) -> Result<Self, NetworkError> {
        Ok(Self { input, network: Network::open(path.as_ref())? })
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
    pub fn estimate(&self, image: &ByteImage) -> Result<DisparityMap, NetworkError> {
        let wanted = self.input.size(image.height, image.width);
        let size = [0, 1].map(|k| self.network.size[k].unwrap_or(wanted[k]));
        let values = self.input.prepare(image, size);
        let (values, size) = self.network.run(values, size, Answer::First)?;
        Ok(self.input.restore(&values, size, [image.height, image.width]))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests;
