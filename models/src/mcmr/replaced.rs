//! Controls: what stands in the place of a part of a prediction.

use autodiff_lite::Tape;
use train::{DataError, Subset};

use super::data::Data;
use super::model::Predicted;
use super::score::largest;
use super::{Mcmr, McmrConfig};

/// Photographs that the mean colour is taken of, at most.
const MEAN_OF: usize = 400;

/// What stands in the place of a part of each prediction; by default nothing does.
///
/// What a table's row is worth shows beside what the same network reaches when a part of it is told the truth, or knows
/// nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Replaced {
    /// Where the weights of the mean shapes come from.
    pub selection: Selection,
    /// Whether nothing is added to the mean shapes.
    pub undeformed: bool,
    /// Whether the camera is the true one of another object of the subset, which is chance; an error where there is one object.
    pub camera_of_another: bool,
    /// The one colour of every texture, in `[0, 1]`.
    pub color: Option<[f32; 3]>,
}

/// Where the weights of the mean shapes come from.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Selection {
    /// The network.
    #[default]
    Predicted,
    /// All have the same.
    Uniform,
    /// The category's mean shape alone: an oracle knows the category, and by its number which shape that is.
    OfCategory(Vec<usize>),
}

impl Selection {
    /// An oracle: each category has the mean shape of which its objects of a subset have most. The subset should not be the
    /// one that is scored.
    ///
    /// # Errors
    /// If a file cannot be read, or there is nothing for that.
    pub fn oracle(system: &Mcmr, data: &Data, subset: Subset) -> Result<Self, DataError> {
        let scored = system.scored(data, subset)?;
        let most = |kind: usize| {
            let weights: Vec<f32> = scored.weights_of(kind).into_iter().map(|w| w as f32).collect();
            largest(&weights)
        };
        Ok(Self::OfCategory((0..data.categories().len()).map(most).collect()))
    }

    /// The weights of objects of these categories, `[B, N]`; none where the network says them.
    pub(super) fn weights(&self, kinds: &[usize], shapes: usize) -> Option<Vec<f32>> {
        let one_hot = |i: usize| (0..shapes).map(move |k| f32::from(u8::from(k == i)));
        match self {
            Self::Predicted => None,
            Self::Uniform => Some(vec![1.0 / shapes as f32; kinds.len() * shapes]),
            Self::OfCategory(of) => {
                Some(kinds.iter().flat_map(|&kind| one_hot(of[kind])).collect())
            }
        }
    }
}

impl Replaced {
    /// The prediction with what is replaced of it.
    pub(super) fn in_prediction<'t>(
        &self,
        tape: &'t Tape,
        mut predicted: Predicted<'t>,
    ) -> Predicted<'t> {
        if self.undeformed {
            predicted.positions = predicted.positions - predicted.offsets;
        }
        if let Some(color) = self.color {
            let mut texture = tape.array(&predicted.texture.shape());
            let texels = texture.as_slice_mut().as_chunks_mut::<3>().0;
            texels.fill(color);
            predicted.texture = tape.constant(texture);
        }
        predicted
    }
}

impl Data {
    /// The mean colour of the objects that are trained on, in `[0, 1]`.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn mean_color(&self, config: &McmrConfig) -> Result<[f32; 3], DataError> {
        let (mut sums, mut all) = ([0.0_f64; 3], 0.0);
        for &object in self.trained().iter().take(MEAN_OF) {
            let sample = self.photo(object)?.plain(Subset::Train, config);
            for (color, &mask) in sample.target.as_chunks::<3>().0.iter().zip(&sample.mask) {
                let share = f64::from(mask) / 255.0;
                all += share;
                for (sum, &c) in sums.iter_mut().zip(color) {
                    *sum += share * f64::from(c) / 255.0;
                }
            }
        }
        Ok(sums.map(|sum| if all > 0.0 { (sum / all) as f32 } else { 0.5 }))
    }
}
