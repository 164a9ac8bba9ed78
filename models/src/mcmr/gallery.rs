//! What there is to show: predictions, and the mean shapes.

use mesh_core::{ByteImage, Camera, TriMesh};
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
        let samples: Vec<Sample> = (0..shown)
            .map(|i| Ok(data.photo(listed[i * listed.len() / shown])?.plain(&self.config)))
            .collect::<Result<_, DataError>>()?;
        let pairs = self.in_batches(&samples, SHOWN, &|_| None, |tape, predicted, _, samples| {
            let poses = self.poses(tape, &predicted, samples);
            let drawn = self.drawn(tape, &predicted, &poses);
            let value = drawn.image.value();
            let weights = predicted.weights.value();
            let pair = |(i, sample): (usize, &Sample)| {
                let bytes: Vec<u8> = row(&value, i)
                    .iter()
                    .map(|x| (x.clamp(0.0, 1.0) * 255.0 + 0.5) as u8)
                    .collect();
                let bytes_of = |data: Vec<u8>| self.bytes(data).resized(SIDE, SIDE);
                let shape = largest(&row(&weights, i)) + 1;
                let caption = format!("{}: mean shape {shape}", sample.name);
                let truth = bytes_of(sample.target.clone());
                ViewPair { caption, model: bytes_of(bytes), truth }
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
        let samples: Vec<Sample> = data
            .wanted(subset)?
            .iter()
            .map(|&object| Ok(data.photo(object)?.plain(&self.config)))
            .collect::<Result<_, DataError>>()?;
        let weights = self.in_batches(&samples, 16, &|_| None, |_, predicted, _, samples| {
            let weights = predicted.weights.value();
            (0..samples.len()).map(|i| row(&weights, i)).collect::<Vec<_>>()
        });
        let weights = weights.concat();
        let eye = [1.15, 0.7, 1.55];
        let camera = Camera::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 0.5, SIDE, SIDE);
        let shapes = self.mean_shapes().into_iter().enumerate();
        let pair = |(i, shape): (usize, TriMesh)| {
            let best = (0..samples.len())
                .fold(0, |best, k| if weights[k][i] > weights[best][i] { k } else { best });
            let (sample, share) = (&samples[best], weights[best][i]);
            let caption = format!("mean shape {}; {} has {share:.2} of it", i + 1, sample.name);
            let truth = self.bytes(sample.target.clone()).resized(SIDE, SIDE);
            ViewPair { caption, model: in_studio(&shape, &camera), truth }
        };
        Ok(shapes.map(pair).collect())
    }

    /// An image of the network's size.
    fn bytes(&self, data: Vec<u8>) -> ByteImage {
        let side = self.config.image_size;
        ByteImage { height: side, width: side, channels: 3, data }
    }
}
