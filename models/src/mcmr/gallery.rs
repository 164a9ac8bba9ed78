//! What there is to show: predictions, and the mean shapes.

use mesh_core::{ByteImage, Camera, Image, TriMesh};
use train::report::ViewPair;
use train::{DataError, Subset};

use super::data::Data;
use super::prediction::row;
use super::score::largest;
use super::{Mcmr, Sample};
use crate::paired::in_studio;

/// Objects shown together.
const SHOWN: usize = 8;
/// Side of the images that are shown, pixels.
const SIDE: usize = 160;

impl Mcmr {
    /// Some objects spread over all of a subset: the prediction with its own camera above the photograph.
    ///
    /// # Errors
    /// If a file cannot be read, or there is nothing for that.
    pub fn gallery(&self, data: &Data, subset: Subset) -> Result<Vec<ViewPair>, DataError> {
        let listed = data.wanted(subset)?;
        let shown = SHOWN.min(listed.len());
        let listed: Vec<usize> = (0..shown).map(|i| listed[i * listed.len() / shown]).collect();
        let samples = data.samples(&listed, subset, &self.config)?;
        let pairs = self.in_batches(&samples, SHOWN, &|_| None, |tape, predicted, _, samples| {
            let poses = self.poses(tape, &predicted, samples);
            let drawn = self.drawn(tape, &predicted, &poses);
            let value = drawn.image.value();
            let weights = predicted.weights.value();
            let pair = |(i, sample): (usize, &Sample)| {
                let (height, width) = (self.config.image_size, self.config.image_size);
                let drawn = Image { height, width, channels: 3, data: row(&value, i) };
                let shape = largest(&row(&weights, i)) + 1;
                let caption = format!("{}: mean shape {shape}", sample.name);
                let truth = self.target_of(sample);
                ViewPair { caption, model: drawn.to_bytes().resized(SIDE, SIDE), truth }
            };
            samples.iter().enumerate().map(pair).collect::<Vec<_>>()
        });
        Ok(pairs.into_iter().flatten().collect())
    }

    /// The mean shapes, each above the photograph of a subset that has most of it.
    ///
    /// # Errors
    /// If a file cannot be read, or there is nothing for that.
    pub fn gallery_of_shapes(
        &self,
        data: &Data,
        subset: Subset,
    ) -> Result<Vec<ViewPair>, DataError> {
        let samples = data.samples(data.wanted(subset)?, subset, &self.config)?;
        let weights = self.in_batches(&samples, 16, &|_| None, |_, predicted, _, samples| {
            let weights = predicted.weights.value();
            (0..samples.len()).map(|i| row(&weights, i)).collect::<Vec<_>>()
        });
        let weights = weights.concat();
        let eye = [1.15, 0.7, 1.55];
        let camera = Camera::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 0.5, SIDE, SIDE);
        let shapes = self.mean_shapes().into_iter().enumerate();
        let pair = |(i, shape): (usize, TriMesh)| {
            let of_shape: Vec<f32> = weights.iter().map(|weights| weights[i]).collect();
            let best = largest(&of_shape);
            let (sample, share) = (&samples[best], of_shape[best]);
            let caption = format!("mean shape {}; {} has {share:.2} of it", i + 1, sample.name);
            let truth = self.target_of(sample);
            ViewPair { caption, model: in_studio(&shape, &camera), truth }
        };
        Ok(shapes.map(pair).collect())
    }

    /// What a prediction is compared with, as large as it is shown.
    fn target_of(&self, sample: &Sample) -> ByteImage {
        let (height, width) = (self.config.image_size, self.config.image_size);
        let image = ByteImage { height, width, channels: 3, data: sample.target.clone() };
        image.resized(SIDE, SIDE)
    }
}
