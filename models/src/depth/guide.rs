//! Depth as a network is given it: a channel of 0 to 1, nearer is larger, 0 where nothing is known.

use mesh_core::{MedianOfEven, median};

/// What lies between `near` and `far`, linear in one over the depth as the volume's cells are.
pub(super) fn of_depth(depth: &[f32], [near, far]: [f32; 2]) -> Vec<f32> {
    let (low, high) = (far.recip(), near.recip());
    let value = |&z: &f32| {
        if z.is_finite() && z > 0.0 {
            ((z.recip() - low) / (high - low)).clamp(0.0, 1.0)
        } else {
            0.0
        }
    };
    depth.iter().map(value).collect()
}

/// A disparity of unknown scale and shift, brought to the same statistics in every image: the median over the object at
/// one half, the mean distance from it 1/8. What is not the object is 0, unless all is wanted `raw`; then 0 to 1 are the
/// least and greatest value of the image.
pub(super) fn of_disparity(disparity: &[f32], object: &[bool], raw: bool) -> Vec<f32> {
    if raw {
        let finite = || disparity.iter().copied().filter(|d| d.is_finite());
        let (low, high) =
            (finite().fold(f32::INFINITY, f32::min), finite().fold(f32::NEG_INFINITY, f32::max));
        let span = (high - low).max(f32::MIN_POSITIVE);
        return disparity
            .iter()
            .map(|d| if d.is_finite() { ((d - low) / span).clamp(0.0, 1.0) } else { 0.0 })
            .collect();
    }
    let value = |(p, x): (usize, f32)| {
        if object[p] && x.is_finite() { (0.5 + 0.125 * x).clamp(0.02, 1.0) } else { 0.0 }
    };
    standard(disparity, object).into_iter().enumerate().map(value).collect()
}

/// Values less their median over the pixels that count, over their mean distance from it; `+∞` stays.
pub(super) fn standard(values: &[f32], counts: &[bool]) -> Vec<f32> {
    let counted = values.iter().zip(counts).filter(|(v, c)| **c && v.is_finite());
    let counted: Vec<f32> = counted.map(|(v, _)| *v).collect();
    let Some(median) = median(counted.iter().copied(), MedianOfEven::Lower) else {
        return values.to_vec();
    };
    let spread = counted.iter().map(|v| (v - median).abs()).sum::<f32>() / counted.len() as f32;
    let factor = if spread > 0.0 { spread.recip() } else { 1.0 };
    let value = |&v: &f32| if v.is_finite() { (v - median) * factor } else { v };
    values.iter().map(value).collect()
}

/// The median of depth over the object's pixels that have one.
pub(super) fn median_depth(depth: &[f32], object: impl Iterator<Item = bool>) -> Option<f32> {
    let known = depth.iter().copied().zip(object).filter(|(z, o)| *o && z.is_finite() && *z > 0.0);
    median(known.map(|(z, _)| z), MedianOfEven::Upper)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_is_linear_in_disparity_between_the_ends() {
        let found = of_depth(&[1.0, 2.0, 4.0 / 3.0, f32::INFINITY, 0.5, 9.0], [1.0, 2.0]);
        let expected = [1.0, 0.0, 0.5, 0.0, 1.0, 0.0];
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}");
    }

    /// Whatever an estimator multiplies by and adds, the network sees the same.
    #[test]
    fn disparity_forgets_scale_and_shift() {
        let disparity: Vec<f32> = (0..40).map(|k| ((k * 7 % 11) as f32).sin()).collect();
        let object: Vec<bool> = (0..40).map(|k| k % 3 != 0).collect();
        let other: Vec<f32> = disparity.iter().map(|d| 12.5 * d - 3.0).collect();
        for raw in [false, true] {
            let (a, b) =
                (of_disparity(&disparity, &object, raw), of_disparity(&other, &object, raw));
            assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-4), "{raw}");
            assert!(a.iter().all(|x| (0.0..=1.0).contains(x)));
            let outside = a.iter().zip(&object).filter(|(_, inside)| !**inside);
            assert_eq!(outside.into_iter().all(|(x, _)| *x == 0.0), !raw);
        }
        assert_eq!(of_disparity(&[1.0, 2.0], &[false; 2], false), [0.0; 2]);
        assert_eq!(standard(&[1.0, 3.0, 9.0], &[true, true, false]), [0.0, 2.0, 8.0]);
        assert_eq!(of_disparity(&[3.0, f32::INFINITY], &[true; 2], false), [0.5, 0.0]);
    }
}
