//! How well two masks overlap.
//!
//! Masks are images of one channel, `f32` in `[0, 1]`, 1 is object. Two of different dimensions are a mistake of the caller
//! and panic.

use mesh_core::{Image, iou};

use super::image::same_size;

/// Intersection over union of two masks (one channel, object above one half); 1 when both are empty.
///
/// The masks are hard, so the figure of a soft silhouette is that of its half level. (MCMR's published
/// figures count every non-zero alpha as object: [`mask_iou_by`].)
pub fn mask_iou(prediction: &Image, target: &Image) -> f64 {
    one_channel("mask_iou", prediction, target);
    let pixels = prediction.data.iter().zip(&target.data);
    iou(pixels.map(|(&a, &b)| (a > 0.5, b > 0.5))).unwrap_or(1.0)
}

/// From which value on a pixel of a soft mask is object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum MaskRule {
    /// Above 0: MCMR's published figures. Any trace of a soft silhouette counts, so that outlines come out
    /// too large on both sides.
    AboveZero,
    /// From one half on: the level at which a silhouette lies where the object ends.
    FromHalf,
}

/// [`mask_iou`] by a rule.
///
/// # Panics
/// If the masks differ in size or have more than one channel.
pub fn mask_iou_by(prediction: &Image, target: &Image, rule: MaskRule) -> f64 {
    one_channel("mask_iou_by", prediction, target);
    let object = |v: f32| match rule {
        MaskRule::AboveZero => v > 0.0,
        MaskRule::FromHalf => v >= 0.5,
    };
    let pixels = prediction.data.iter().zip(&target.data);
    iou(pixels.map(|(&a, &b)| (object(a), object(b)))).unwrap_or(1.0)
}

#[track_caller]
fn one_channel(name: &str, prediction: &Image, target: &Image) {
    same_size(name, prediction, target);
    assert!(
        prediction.channels == 1,
        "{name}: a mask has one channel, found {}",
        prediction.channels
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mask<const N: usize>(data: [f32; N]) -> Image {
        Image { height: 1, width: N, channels: 1, data: data.to_vec() }
    }

    #[test]
    fn masks_are_hard() {
        let a = mask([0.6, 0.4, 1.0, 0.0]);
        let b = mask([1.0, 0.0, 0.0, 0.0]);
        assert_eq!(mask_iou(&a, &b), 0.5);
        assert_eq!(mask_iou(&Image::new(1, 4, 1), &Image::new(1, 4, 1)), 1.0);
        // Every trace counts in the published rule: three of one.
        assert_eq!(mask_iou_by(&a, &b, MaskRule::AboveZero), 1.0 / 3.0);
        assert_eq!(mask_iou_by(&a, &b, MaskRule::FromHalf), 0.5);
        let half = mask([0.5; 4]);
        assert_eq!(mask_iou_by(&half, &half, MaskRule::FromHalf), 1.0);
        assert_eq!(mask_iou_by(&half, &b, MaskRule::FromHalf), 0.25);
    }
}
