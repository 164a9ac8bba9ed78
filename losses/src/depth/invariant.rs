//! The loss of MiDaS: disparity up to scale and shift.

use autodiff_lite::{Real, Var};

use super::pixels::common_mask;
use super::{
    DepthMean, align_scale_shift, depth_gradients, depth_l1_trimmed, depth_l2, normalize_depth,
};

/// How scale and shift are taken out, and what the rest is measured with.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Robustness {
    /// The prediction is [aligned](align_scale_shift) by least squares, the rest squared.
    LeastSquares {
        /// The floor of the correlation; -1 for none.
        least_correlation: f64,
    },
    /// Both are [normalised](normalize_depth) by median and mean distance, the rest is absolute and
    /// [trimmed](depth_l1_trimmed). Turned inside out is always wrong here.
    Trimmed {
        /// The share that is left out.
        share: f64,
    },
}

/// A loss between disparities that scale and shift of the *prediction* do not change.
///
/// ```text
/// L = data + gradient_weight · depth_gradients
/// ```
///
/// With [`Robustness::Trimmed`] those of the target do not matter either; with least squares the value is in
/// units of the target squared. Compare a rendered depth with an estimate through [`disparity`](super::disparity),
/// over the pixels that are inside the silhouette of both.
///
/// ```
/// use autodiff_lite::Tape;
/// use losses::{ScaleShiftInvariant, disparity};
/// use ndarray::Array3;
///
/// // Depth of a tilted plane, and its disparity as an estimator may give it: in another scale, and shifted.
/// let depth = Array3::from_shape_fn((1, 8, 8), |(_, i, j)| 2.0 + 0.1 * (i + 2 * j) as f64);
/// let estimate = depth.mapv(|z| 40.0 / z + 7.0);
/// let tape = Tape::<f64>::train(0);
/// let rendered = tape.leaf(depth);
/// let (estimate, mask) = (tape.constant(estimate), tape.constant(Array3::ones((1, 8, 8))));
/// let loss = ScaleShiftInvariant::least_squares().loss(disparity(rendered), estimate, mask);
/// assert!(loss.item() < 1e-12);
/// ```
///
/// # References
/// Ranftl et al. 2020, *Towards Robust Monocular Depth Estimation: Mixing Datasets for Zero-shot
/// Cross-dataset Transfer*, section 5.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScaleShiftInvariant {
    /// What becomes of scale, shift and outliers.
    pub robustness: Robustness,
    /// The weight of the gradient term; 0.5 is published.
    pub gradient_weight: f64,
    /// The scales of the gradient term; 4 are published.
    pub scales: usize,
    /// How a batch is averaged.
    pub mean: DepthMean,
}

impl ScaleShiftInvariant {
    /// Least squares as published, but for a floor of 0.1 under the correlation, without which a relief
    /// turned inside out is as good as the right one.
    pub fn least_squares() -> Self {
        Self {
            robustness: Robustness::LeastSquares { least_correlation: 0.1 },
            ..Self::published()
        }
    }

    /// The robust variant as published: a fifth of the pixels may be wrong.
    pub fn trimmed() -> Self {
        Self { robustness: Robustness::Trimmed { share: 0.2 }, ..Self::published() }
    }

    /// Least squares as published, to the sign of the scale.
    pub fn published() -> Self {
        Self {
            robustness: Robustness::LeastSquares { least_correlation: -1.0 },
            gradient_weight: 0.5,
            scales: 4,
            mean: DepthMean::Pixels,
        }
    }

    /// The loss of images.
    ///
    /// # Shapes
    /// `prediction`, `target` and `mask` `[N, H, W]` or `[N, H, W, 1]`, alike → a scalar.
    ///
    /// # Panics
    /// If the shapes differ, a share to trim is not between 0 and 1, or there are 32 scales or more.
    #[track_caller]
    pub fn loss<'t, F: Real>(
        &self,
        prediction: Var<'t, F>,
        target: Var<'t, F>,
        mask: Var<'t, F>,
    ) -> Var<'t, F> {
        let mask = common_mask(prediction, target, mask);
        let (a, b, data) = match self.robustness {
            Robustness::LeastSquares { least_correlation } => {
                let a = align_scale_shift(prediction, target, mask, least_correlation);
                (a, target, depth_l2(a, target, mask, self.mean))
            }
            Robustness::Trimmed { share } => {
                let (a, b) = (normalize_depth(prediction, mask), normalize_depth(target, mask));
                (a, b, depth_l1_trimmed(a, b, mask, share, self.mean))
            }
        };
        if self.gradient_weight == 0.0 || self.scales == 0 {
            return data;
        }
        let edges = depth_gradients(a, b, mask, self.scales, self.mean);
        data.add(edges.scale(F::from_f64(self.gradient_weight)))
    }
}
