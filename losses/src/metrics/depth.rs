//! How far a rendered depth is from the truth.

use mesh_core::{DepthMap, Image};

/// The depth error at one view.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct DepthError {
    /// The mean over the pixels that count of `|d - d*|`, or of the penalty where nothing was rendered.
    pub mean: f64,
    /// The share of the pixels that count where nothing was rendered.
    pub uncovered: f64,
    /// How many pixels count.
    pub pixels: usize,
}

/// Mean absolute depth error over the pixels of the true mask; `None` if none counts.
///
/// ```text
/// (1/M) Σ  |d - d*|   where the prediction has depth,   penalty   where it has none (+∞ or NaN)
/// ```
///
/// A pixel counts where `mask` (one channel) is above one half and the truth is finite; what the prediction
/// covers beyond the mask is not looked at. Choose the penalty no smaller than errors get, the size of the
/// object, or uncovering a pixel would pay: the figure is only as comparable as the penalty is the same.
///
/// ```
/// use losses::metrics::depth_error;
/// use mesh_core::{DepthMap, Image};
///
/// let map = |data: [f32; 4]| DepthMap { height: 1, width: 4, data: data.to_vec() };
/// let mask = Image { height: 1, width: 4, channels: 1, data: vec![1.0, 1.0, 1.0, 0.0] };
/// let none = f32::INFINITY;
/// let error = depth_error(&map([2.5, 2.0, none, 9.0]), &map([2.0, 2.0, 2.0, none]), &mask, 1.0);
/// let error = error.unwrap();
/// assert_eq!((error.mean, error.uncovered, error.pixels), (0.5, 1.0 / 3.0, 3));
/// ```
///
/// # Panics
/// If the sizes differ or the mask has more than one channel.
pub fn depth_error(
    prediction: &DepthMap,
    truth: &DepthMap,
    mask: &Image,
    penalty: f64,
) -> Option<DepthError> {
    let size = (truth.height, truth.width);
    assert!(
        (prediction.height, prediction.width) == size
            && (mask.height, mask.width, mask.channels) == (size.0, size.1, 1),
        "depth_error: the sizes differ\n  prediction [{}, {}]\n  truth      [{}, {}]\n  mask       [{}, {}, {}]",
        prediction.height,
        prediction.width,
        truth.height,
        truth.width,
        mask.height,
        mask.width,
        mask.channels
    );
    let (mut total, mut pixels, mut uncovered) = (0.0, 0_usize, 0_usize);
    for ((&d, &t), &m) in prediction.data.iter().zip(&truth.data).zip(&mask.data) {
        if m > 0.5 && t.is_finite() {
            pixels += 1;
            if d.is_finite() {
                total += (f64::from(d) - f64::from(t)).abs();
            } else {
                uncovered += 1;
                total += penalty;
            }
        }
    }
    let share = |x: f64| x / pixels as f64;
    (pixels > 0).then(|| DepthError {
        mean: share(total),
        uncovered: share(uncovered as f64),
        pixels,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(data: &[f32]) -> DepthMap {
        DepthMap { height: 1, width: data.len(), data: data.to_vec() }
    }

    fn mask(data: &[f32]) -> Image {
        Image { height: 1, width: data.len(), channels: 1, data: data.to_vec() }
    }

    #[test]
    fn nothing_outside_the_mask_counts() {
        let truth = map(&[1.0, 2.0, f32::INFINITY, 4.0]);
        let seen = mask(&[1.0, 0.6, 1.0, 0.4]);
        let of = |last: f32| depth_error(&map(&[1.0, 2.0, 3.0, last]), &truth, &seen, 7.0);
        for last in [4.0, 0.0, f32::INFINITY, f32::NAN] {
            assert_eq!(of(last), Some(DepthError { mean: 0.0, uncovered: 0.0, pixels: 2 }));
        }
        assert_eq!(depth_error(&truth, &truth, &mask(&[0.0; 4]), 1.0), None);
    }

    /// Covering less never looks better, as long as the penalty is no smaller than the errors.
    #[test]
    fn an_uncovered_pixel_pays() {
        let (truth, seen) = (map(&[1.0; 4]), mask(&[1.0; 4]));
        let mut prediction = map(&[1.5; 4]);
        let mut last = 0.0;
        for p in 0..4 {
            let mean = depth_error(&prediction, &truth, &seen, 1.0).map_or(0.0, |e| e.mean);
            assert!(mean > last, "{mean}");
            last = mean;
            prediction.data[p] = if p % 2 == 0 { f32::INFINITY } else { f32::NAN };
        }
    }

    #[test]
    #[should_panic(expected = "depth_error: the sizes differ")]
    fn sizes_must_agree() {
        let _ = depth_error(&map(&[1.0]), &map(&[1.0, 2.0]), &mask(&[1.0]), 1.0);
    }
}
