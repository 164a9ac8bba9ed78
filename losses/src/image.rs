//! Image losses value by value: L1 and L2, on the whole image or weighted by a mask.

use autodiff_lite::{Backward, Real, Var};

use crate::kernels::compare;
use crate::scalar::{same_shape, scalar, seed};

/// Mean absolute difference, `mean(w |a - b|)`.
///
/// The mean is over all values, also where the weight is zero: the form of DIB-R, whose gradient does not
/// grow when the object is small. Without a mask `w = 1`; the common background then counts as right.
///
/// # Shapes
/// `image` and `target` of one shape, `[N, H, W, C]` usually; `mask` has the same axes without the last,
/// or with a last axis of one → a scalar.
/// # Gradient
/// To all inputs that want one; zero where the values are equal.
/// # Cost
/// Two reads of the image forward; backward reads it again rather than keeping a copy.
/// # Panics
/// If the shapes do not fit.
///
/// ```
/// use autodiff_lite::Tape;
/// let tape = Tape::<f32>::train(0);
/// let image = tape.leaf(ndarray::arr1(&[0.2, 0.9]));
/// let target = tape.constant(ndarray::arr1(&[0.5, 0.5]));
/// let loss = losses::l1(image, target, None);
/// assert!((loss.item() - 0.35).abs() < 1e-6);
/// assert_eq!(loss.backward().wrt(image).unwrap().as_slice(), [-0.5, 0.5]);
/// ```
#[track_caller]
pub fn l1<'t, F: Real>(
    image: Var<'t, F>,
    target: Var<'t, F>,
    mask: Option<Var<'t, F>>,
) -> Var<'t, F> {
    let one = |yes: bool| if yes { F::one() } else { F::zero() };
    let derivative = move |a: F, b: F| one(a > b) - one(a < b);
    compare("l1", [image, target], mask, |a, b| (a - b).abs(), derivative)
}

/// Mean squared difference, `mean(w (a - b)²)`.
///
/// Weights, gradient and cost as in [`l1`]. On soft masks this is the mask loss of MCMR.
///
/// # Shapes
/// As for [`l1`].
/// # Panics
/// If the shapes do not fit.
#[track_caller]
pub fn l2<'t, F: Real>(
    image: Var<'t, F>,
    target: Var<'t, F>,
    mask: Option<Var<'t, F>>,
) -> Var<'t, F> {
    let derivative = |a: F, b: F| (a - b) + (a - b);
    compare("l2", [image, target], mask, |a, b| (a - b) * (a - b), derivative)
}

/// The mean of a distance; its `derivative` is the one by `a`, and that by `b` is the negative.
#[track_caller]
fn compare<'t, F: Real>(
    name: &'static str,
    [image, target]: [Var<'t, F>; 2],
    mask: Option<Var<'t, F>>,
    distance: impl Fn(F, F) -> F + Copy + Send + Sync + 'static,
    derivative: impl Fn(F, F) -> F + Copy + Send + Sync + 'static,
) -> Var<'t, F> {
    same_shape(name, ["image", "target"], image, target);
    let channels = mask.map_or(1, |mask| channels(name, image, mask));
    let (a, b) = (image.value(), target.value());
    let (a, b) = (a.as_slice(), b.as_slice());
    let total = match mask {
        None => compare::sum(a, b, distance),
        Some(mask) => compare::weighted_sum(a, b, mask.value().as_slice(), channels, distance),
    };
    let tape = image.tape();
    let value = scalar(tape, total / a.len().max(1) as f64);
    let mut inputs = vec![image, target];
    inputs.extend(mask);
    tape.record_fn(name, &inputs, value, move |cx: &mut Backward<'_, F>| {
        let (a, b) = (cx.input(0), cx.input(1));
        let (x, y) = (a.as_slice(), b.as_slice());
        let mask = (cx.input_count() == 3).then(|| cx.input(2));
        let scale = seed(cx) / F::from_f64(x.len().max(1) as f64);
        for (i, scale) in [scale, -scale].into_iter().enumerate() {
            cx.give_with(i, |out| match &mask {
                None => compare::derivatives(x, y, scale, out, derivative),
                Some(mask) => {
                    let mask = mask.as_slice();
                    compare::weighted_derivatives(x, y, mask, channels, scale, out, derivative);
                }
            });
        }
        if mask.is_some() {
            cx.give_with(2, |out| compare::pixel_sums(x, y, channels, scale, out, distance));
        }
    })
}

/// How many values of the image lie under one value of the mask.
#[track_caller]
fn channels<F: Real>(op: &'static str, image: Var<'_, F>, mask: Var<'_, F>) -> usize {
    let (x, m) = (image.shape(), mask.shape());
    let leading = &x[..x.len().saturating_sub(1)];
    let one_channel = m.split_last().is_some_and(|(&last, rest)| last == 1 && rest == leading);
    if m == leading || one_channel {
        x.last().copied().unwrap_or(1)
    } else if m == x {
        1
    } else {
        let operands = [("image", &x[..], ""), ("mask", &m, "")];
        image.tape().refuse(op, "the mask does not fit the image", &operands)
    }
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use autodiff_lite::Tape;
    use ndarray::{Array4, IxDyn};
    use proptest::prelude::*;

    use super::*;
    use crate::testing;

    proptest! {
        #[test]
        fn gradients(n in 1usize..3, h in 1usize..5, w in 1usize..5, c in 1usize..4, kind in 0usize..4, seed: u64) {
            let image = vec![n, h, w, c];
            let mask = [vec![n, h, w], vec![n, h, w, 1], vec![n, h, w, c]];
            let options = testing::options(seed);
            if let Some(mask) = mask.get(kind) {
                let shapes = [image.clone(), image, mask.clone()];
                testing::checked(&|x: &[Var<'_, f64>]| l1(x[0], x[1], Some(x[2])), &shapes, &options)?;
                testing::checked(&|x: &[Var<'_, f64>]| l2(x[0], x[1], Some(x[2])), &shapes, &options)?;
            } else {
                let shapes = [image.clone(), image];
                testing::checked(&|x: &[Var<'_, f64>]| l1(x[0], x[1], None), &shapes, &options)?;
                testing::checked(&|x: &[Var<'_, f64>]| l2(x[0], x[1], None), &shapes, &options)?;
            }
        }
    }

    #[test]
    fn a_weight_of_one_is_no_weight() {
        // Large enough for the parallel path, and of a length that no chunk divides.
        let (h, w) = (211, 307);
        let image = |seed: usize| {
            Array4::from_shape_fn((1, h, w, 3), |(_, i, j, k)| {
                ((i * 7 + j * 13 + k * 5 + seed) % 101) as f32 / 100.0
            })
        };
        let (a, b) = (image(0), image(31));
        let expected = |f: fn(f64) -> f64| {
            let sum: f64 = a.iter().zip(&b).map(|(&a, &b)| f(f64::from(a) - f64::from(b))).sum();
            sum / a.len() as f64
        };
        let (absolute, squared) = (expected(f64::abs), expected(|d| d * d));
        let tape = Tape::<f32>::train(0);
        let (x, y) = (tape.leaf(a.clone()), tape.constant(b.clone()));
        let ones = tape.constant(ndarray::ArrayD::from_elem(IxDyn(&[1, h, w]), 1.0f32));
        for (loss, expected) in [
            (l1(x, y, None), absolute),
            (l1(x, y, Some(ones)), absolute),
            (l2(x, y, None), squared),
            (l2(x, y, Some(ones)), squared),
        ] {
            assert_relative_eq!(f64::from(loss.item()), expected, epsilon = 1e-6);
        }
        let plain = l2(x, y, None).backward();
        let weighted = l2(x, y, Some(ones)).backward();
        assert_eq!(plain.wrt(x), weighted.wrt(x));
        let expected = 2.0 * (a[[0, 200, 300, 2]] - b[[0, 200, 300, 2]]) / a.len() as f32;
        assert_relative_eq!(
            plain.wrt(x).expect("a leaf")[[0, 200, 300, 2]],
            expected,
            epsilon = 1e-9
        );
    }

    #[test]
    fn equal_values_have_no_derivative() {
        let tape = Tape::<f32>::train(0);
        let x = tape.leaf(ndarray::arr1(&[0.5, 0.25]));
        let gradients = l1(x, x.detach(), None).backward();
        assert_eq!(gradients.wrt(x).expect("a leaf").as_slice(), [0.0, 0.0]);
    }

    #[test]
    #[should_panic(expected = "l1: the mask does not fit the image")]
    fn a_mask_of_another_size() {
        let tape = Tape::<f32>::eval();
        let image = tape.constant(Array4::zeros((1, 4, 5, 3)));
        let _ = l1(image, image, Some(tape.constant(ndarray::Array3::zeros((1, 5, 4)))));
    }
}
