//! Which pixels count.

use autodiff_lite::{PoolVec, Real, Tensor, Var};

/// How the pixels of a batch are averaged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum DepthMean {
    /// Every pixel that counts weighs the same, whichever image it is in.
    #[default]
    Pixels,
    /// Every image weighs the same, however few of its pixels count; one without any adds nothing.
    Images,
}

impl DepthMean {
    /// What one of `own` items of an image weighs when the batch of `images` has `all` items.
    pub(super) fn weight(self, own: usize, all: usize, images: usize) -> f64 {
        match self {
            Self::Pixels => 1.0 / all.max(1) as f64,
            Self::Images => 1.0 / (images * own).max(1) as f64,
        }
    }
}

/// The pixels of a batch that count, as places in its data.
pub(super) struct Pixels {
    places: PoolVec<u32>,
    /// Where the places of each image end.
    ends: PoolVec<u32>,
    /// Rows and columns of an image.
    pub(super) size: [usize; 2],
}

impl Pixels {
    /// Those where the mask is above one half and no image holds `+∞`.
    #[track_caller]
    pub(super) fn new<F: Real>(
        op: &'static str,
        prediction: Var<'_, F>,
        target: Option<Var<'_, F>>,
        mask: Var<'_, F>,
    ) -> Self {
        let tape = prediction.tape();
        let shape = prediction.shape();
        let size = match shape[..] {
            [_, h, w] | [_, h, w, 1]
                if target.is_none_or(|t| t.shape() == shape) && mask.shape() == shape =>
            {
                [h, w]
            }
            _ => {
                let (of_target, of_mask) = (target.map(Var::shape), mask.shape());
                let mut operands = vec![("prediction", &shape[..], "N, H, W")];
                operands.extend(of_target.as_deref().map(|shape| ("target", shape, "N, H, W")));
                operands.push(("mask", &of_mask, "N, H, W"));
                tape.refuse(op, "images of one shape and one channel expected", &operands)
            }
        };
        let len = size[0] * size[1];
        let (mut places, mut ends) = (tape.indices(prediction.len()), tape.indices(shape[0]));
        let values = [prediction.value(), mask.value(), target.unwrap_or(prediction).value()];
        let [x, m, y] = values.each_ref().map(Tensor::as_slice);
        let half = F::from_f64(0.5);
        let mut count = 0;
        for (n, end) in ends.iter_mut().enumerate() {
            for p in n * len..(n + 1) * len {
                if m[p] > half && x[p] != F::infinity() && y[p] != F::infinity() {
                    places[count] = p as u32;
                    count += 1;
                }
            }
            *end = count as u32;
        }
        Self { places, ends, size }
    }

    /// The number of images.
    pub(super) fn images(&self) -> usize {
        self.ends.len()
    }

    /// How many pixels count in all images.
    pub(super) fn count(&self) -> usize {
        self.ends.last().map_or(0, |&end| end as usize)
    }

    /// The places in each image that count, ascending.
    pub(super) fn each(&self) -> impl Iterator<Item = &[u32]> {
        let mut start = 0;
        self.ends.iter().map(move |&end| {
            let places = &self.places[start..end as usize];
            start = end as usize;
            places
        })
    }
}

/// The mask of the pixels that count in both images: 1 there, 0 elsewhere.
#[track_caller]
pub(super) fn common_mask<'t, F: Real>(
    prediction: Var<'t, F>,
    target: Var<'t, F>,
    mask: Var<'t, F>,
) -> Var<'t, F> {
    let tape = prediction.tape();
    let pixels = Pixels::new("ScaleShiftInvariant", prediction, Some(target), mask);
    let mut common = tape.pool().filled(&mask.shape(), F::zero());
    let values = common.as_slice_mut();
    pixels.each().flatten().for_each(|&p| values[p as usize] = F::one());
    tape.constant(common)
}
