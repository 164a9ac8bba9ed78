//! Masks from one image, by a network in ONNX's form.

use std::path::Path;

use mesh_core::{ByteImage, Image};

use crate::network::{Answer, Network, NetworkError};
use crate::{MaskInput, mask_of_shares};

/// A network that parts an object from its background: U²-Net, IS-Net, BiRefNet, and others that are called as they are.
///
/// A model is a program: see [`DepthEstimator`](crate::DepthEstimator) for how it is read and what it may do.
///
/// ```no_run
/// use datasets::{MaskEstimator, MaskInput};
///
/// let isnet = MaskEstimator::open("isnet-general-use.onnx", MaskInput::isnet())?;
/// let image = mesh_core::read_image("chair.jpg")?.over([255; 3]);
/// let mask = isnet.mask(&image)?; // 255 = object
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct MaskEstimator {
    input: MaskInput,
    network: Network,
}

impl MaskEstimator {
    /// Loads a model; what it expects of an image does not stand in its file.
    ///
    /// # Errors
    /// The file cannot be read, is no model, or the model does not take one image.
    pub fn open(path: impl AsRef<Path>, input: MaskInput) -> Result<Self, NetworkError> {
        Ok(Self { input, network: Network::open(path.as_ref())? })
    }

    /// The object's share of each pixel, `[H, W, 1]`, 0 to 1. Where the model's file fixes the size of its input, that is used.
    ///
    /// # Errors
    /// The model fails, or answers with something else than a number per pixel.
    /// # Panics
    /// If the image has no pixels.
    pub fn estimate(&self, image: &ByteImage) -> Result<Image, NetworkError> {
        let size = self.network.size.map(|fixed| fixed.unwrap_or(self.input.side));
        let values = self.input.prepare(image, size);
        let which = if self.input.last_output { Answer::Last } else { Answer::First };
        let (values, found) = self.network.run(values, size, which)?;
        Ok(self.input.restore(&values, found, [image.height, image.width]))
    }

    /// The pixels of which the object has at least half: 255, others 0.
    ///
    /// # Errors
    /// # Panics
    /// As [`estimate`](Self::estimate).
    pub fn mask(&self, image: &ByteImage) -> Result<ByteImage, NetworkError> {
        Ok(mask_of_shares(&self.estimate(image)?))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::network::NetworkProblem;
    use crate::network::tiny::{Message, ints, model, node, saved, tensor, value_info};

    /// A red disc on grey.
    fn picture() -> ByteImage {
        let pixel = |k: usize| {
            let inside = (k / 60).abs_diff(18).pow(2) + (k % 60).abs_diff(35).pow(2) < 130;
            if inside { [220, 40, 30] } else { [120, 120, 120] }
        };
        let data = (0..40 * 60).flat_map(pixel).collect();
        ByteImage { height: 40, width: 60, channels: 3, data }
    }

    fn off(mask: &ByteImage) -> usize {
        let image = picture();
        let inside = |k: usize| image.data[3 * k] == 220;
        mask.data.iter().enumerate().filter(|(k, m)| (**m != 0) != inside(*k)).count()
    }

    /// A network that answers with how much redder than green a pixel is.
    #[test]
    fn a_model_that_knows_red_finds_a_red_disc() {
        let folder = tempfile::tempdir().unwrap();
        for input in [MaskInput::u2net(), MaskInput::isnet()] {
            let bytes = model(&[1, 3, 0, 0], [1.0, -1.0, 0.0], 0.0, 1, &[]);
            let estimator = MaskEstimator::open(saved(&folder, &bytes), input).unwrap();
            assert!(off(&estimator.mask(&picture()).unwrap()) < 25, "{input:?}");
        }
        // Logits, at a size that the file fixes: 0.7 between red and green of the disc, 0 beside.
        let bytes = model(
            &[1, 3, 48, 80],
            [10.0 * 0.229, -10.0 * 0.224, 0.0],
            -3.0 + 10.0 * (0.485 - 0.456),
            1,
            &[],
        );
        let estimator = MaskEstimator::open(saved(&folder, &bytes), MaskInput::birefnet()).unwrap();
        let shares = estimator.estimate(&picture()).unwrap();
        assert!(shares.data[0] < 0.06 && shares.data[18 * 60 + 35] > 0.95, "{shares:?}");
        assert!(off(&estimator.mask(&picture()).unwrap()) < 25);
    }

    /// Two outputs, the second the first turned around.
    #[test]
    fn the_output_is_the_one_that_is_published() {
        let folder = tempfile::tempdir().unwrap();
        let conv = node("Conv", &["picture", "weights"], "first", &[ints("kernel_shape", &[1, 1])]);
        let graph = Message::default()
            .message(1, &conv)
            .message(1, &node("Neg", &["first"], "last", &[]))
            .bytes(2, b"tiny")
            .message(5, &tensor("weights", &[1, 3, 1, 1], &[1.0, -1.0, 0.0]))
            .message(11, &value_info("picture", &[1, 3, 0, 0]))
            .message(12, &value_info("first", &[]))
            .message(12, &value_info("last", &[]));
        let opset = Message::default().bytes(1, b"").int(2, 12);
        let bytes = Message::default().int(1, 7).message(7, &graph).message(8, &opset).0;
        let path = saved(&folder, &bytes);
        let first = MaskEstimator::open(&path, MaskInput::isnet()).unwrap();
        assert!(off(&first.mask(&picture()).unwrap()) < 25);
        let last = MaskInput { last_output: true, ..MaskInput::isnet() };
        let last = MaskEstimator::open(&path, last).unwrap();
        assert!(off(&last.mask(&picture()).unwrap()) > 2300);
    }

    #[test]
    fn errors_name_the_model() {
        let folder = tempfile::tempdir().unwrap();
        let error =
            MaskEstimator::open(saved(&folder, b"no model"), MaskInput::u2net()).unwrap_err();
        assert!(matches!(error.problem, NetworkProblem::Load(_)), "{error}");
        assert!(error.to_string().contains("tiny.onnx"), "{error}");
    }
}
