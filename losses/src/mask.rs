//! Losses between a soft silhouette and a mask.

use autodiff_lite::{Backward, Real, Var};

use crate::kernels::compare;
use crate::scalar::{same_shape, scalar, seed};

/// Keeps the quotient finite when both masks are empty.
const EPSILON: f64 = 1e-10;

/// One minus the soft intersection over union, averaged over the batch.
///
/// ```text
/// 1 - (1/N) Σ_n  Σ a b / (Σ (a + b - a b) + 1e-10)
/// ```
///
/// # Shapes
/// `prediction` and `target` of one shape, `[N, ..]` with values in `[0, 1]` → a scalar.
/// # Gradient
/// To both inputs.
/// # Cost
/// One read forward, one read and one write backward.
/// # Panics
/// If the shapes differ or have no axis.
/// # References
/// `kaolin.metrics.render.mask_iou`, the mask loss of DIB-R and img2mesh.
///
/// ```
/// use autodiff_lite::Tape;
/// let tape = Tape::<f64>::eval();
/// let half = tape.constant(ndarray::arr2(&[[1.0, 1.0, 0.0, 0.0]]));
/// let quarter = tape.constant(ndarray::arr2(&[[1.0, 0.0, 0.0, 0.0]]));
/// assert!((losses::mask_iou(half, quarter).item() - 0.5).abs() < 1e-9);
/// ```
#[track_caller]
pub fn mask_iou<'t, F: Real>(prediction: Var<'t, F>, target: Var<'t, F>) -> Var<'t, F> {
    let name = "mask_iou";
    let tape = prediction.tape();
    same_shape(name, ["prediction", "target"], prediction, target);
    let shape = prediction.shape();
    let Some(&images) = shape.first() else {
        tape.refuse(name, "a batch axis expected", &[("prediction", &shape, "N, ..")])
    };
    let (a, b) = (prediction.value(), target.value());
    let (a, b) = (a.as_slice(), b.as_slice());
    let len = (a.len() / images.max(1)).max(1);
    // Intersection and union of each image.
    let mut sums = tape.buffer(2 * images);
    let mut total = 0.0;
    for (n, (a, b)) in a.chunks(len).zip(b.chunks(len)).enumerate() {
        let both = compare::sum(a, b, |a, b| a * b);
        let either = compare::sum(a, b, |a, b| a + b - a * b) + EPSILON;
        total += both / either;
        sums[2 * n] = F::from_f64(both);
        sums[2 * n + 1] = F::from_f64(either);
    }
    let value = scalar(tape, 1.0 - total / images.max(1) as f64);
    tape.record_fn(name, &[prediction, target], value, move |cx: &mut Backward<'_, F>| {
        let inputs = [cx.input(0), cx.input(1)];
        let scale = -seed(cx) / F::from_f64((sums.len() / 2).max(1) as f64);
        for i in 0..2 {
            let images = inputs[1 - i].as_slice().chunks(len);
            cx.give_with(i, |out| {
                // d(I/U) = (b U - I (1 - b)) / U² = b (1/U + I/U²) - I/U²
                for (n, (out, image)) in out.chunks_mut(len).zip(images).enumerate() {
                    let (both, either) = (sums[2 * n], sums[2 * n + 1]);
                    let constant = scale * both / (either * either);
                    let factor = scale / either + constant;
                    compare::derivatives(image, image, F::one(), out, |b, _| b * factor - constant);
                }
            });
        }
    })
}

/// Binary cross-entropy of probabilities, averaged over all values.
///
/// ```text
/// -mean(t ln p + (1 - t) ln(1 - p))
/// ```
///
/// Logarithms are cut off at -100, and the derivative where `p (1 - p) < 1e-12`, so that `p` of exactly 0 or 1
/// gives finite figures.
///
/// # Shapes
/// `prediction` with values in `[0, 1]` and `target` of one shape → a scalar.
/// # Gradient
/// To `prediction` only; the target is data.
/// # Panics
/// If the shapes differ.
/// # References
/// The definition and both limits are those of PyTorch's `binary_cross_entropy`.
#[track_caller]
pub fn mask_bce<'t, F: Real>(prediction: Var<'t, F>, target: Var<'t, F>) -> Var<'t, F> {
    let name = "mask_bce";
    let tape = prediction.tape();
    same_shape(name, ["prediction", "target"], prediction, target);
    let (p, t) = (prediction.value(), target.value());
    let (p, t) = (p.as_slice(), t.as_slice());
    let floor = F::from_f64(-100.0);
    let total = compare::sum(p, t, |p, t| {
        let (yes, no) = (p.ln(), (F::one() - p).ln());
        let yes = if yes > floor { yes } else { floor };
        let no = if no > floor { no } else { floor };
        if p.is_nan() {
            return p;
        }
        -(t * yes + (F::one() - t) * no)
    });
    let value = scalar(tape, total / p.len().max(1) as f64);
    tape.record_fn(name, &[prediction, target], value, |cx: &mut Backward<'_, F>| {
        let (p, t) = (cx.input(0), cx.input(1));
        let scale = seed(cx) / F::from_f64(p.len().max(1) as f64);
        let least = F::from_f64(1e-12);
        let pull = |p: F, t: F| {
            let variance = p * (F::one() - p);
            (p - t) / if variance > least { variance } else { least }
        };
        cx.give_with(0, |out| {
            compare::derivatives(p.as_slice(), t.as_slice(), scale, out, pull);
        });
    })
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use autodiff_lite::Tape;
    use ndarray::arr2;
    use proptest::prelude::*;

    use super::*;
    use crate::testing;

    proptest! {
        #[test]
        fn gradients(n in 1usize..4, h in 1usize..6, w in 1usize..6, seed: u64) {
            let options = testing::options(seed).range(0.02, 0.98);
            let shapes = [vec![n, h, w], vec![n, h, w]];
            testing::checked(&|x: &[Var<'_, f64>]| mask_iou(x[0], x[1]), &shapes, &options)?;
            let target = testing::random(&[n, h, w], 0.0, 1.0, seed ^ 7);
            testing::checked(&|x: &[Var<'_, f64>]| mask_bce(x[0], x[0].tape().constant(target.clone())), &shapes[..1], &options)?;
        }
    }

    #[test]
    fn not_a_number_stays_visible() {
        let tape = Tape::<f64>::eval();
        let [p, t] = [f64::NAN, 1.0].map(|x| tape.constant(ndarray::arr1(&[x, 0.5])));
        assert!(mask_bce(p, t).value().iter().all(|x| x.is_nan()));
    }

    #[test]
    fn the_value_of_kaolins_own_test() {
        // Two 4 x 4 masks from the test of kaolin.metrics.render.mask_iou, which expects 0.3105.
        let lhs = arr2(&[
            [0.0, 0.2, 0.1, 1.0, 0.5, 0.5, 0.9, 0.9, 0.0, 1.0, 1.0, 0.9, 0.8, 0.7, 0.2, 0.1],
            [1.0; 16],
        ]);
        let rhs = arr2(&[
            [0.1, 0.3, 0.3, 0.9, 0.5, 0.5, 1.0, 0.3, 0.0, 0.9, 0.9, 0.8, 1.0, 1.0, 0.0, 0.0],
            [0.3, 0.6, 0.7, 0.7, 0.8, 0.9, 0.9, 1.0, 1.0, 0.9, 0.9, 0.5, 0.8, 0.7, 0.8, 0.5],
        ]);
        let tape = Tape::<f64>::eval();
        let loss = mask_iou(tape.constant(lhs.clone()), tape.constant(rhs.clone())).item();
        assert_relative_eq!(loss, 0.3105, epsilon = 1e-5);
        // The second pair by hand: all ones against a mask of mean 0.75.
        let one = |a: &ndarray::Array2<f64>| a.slice(ndarray::s![1..2, ..]).to_owned();
        let loss = mask_iou(tape.constant(one(&lhs)), tape.constant(one(&rhs))).item();
        assert_relative_eq!(loss, 0.25, epsilon = 1e-9);
    }

    #[test]
    fn empty_masks_are_finite() {
        let tape = Tape::<f32>::train(0);
        let x = tape.leaf(ndarray::Array3::zeros((2, 3, 3)));
        let loss = mask_iou(x, x.detach());
        assert_eq!(loss.item(), 1.0);
        assert!(loss.backward().is_finite());
    }

    #[test]
    fn cross_entropy_by_hand() {
        let tape = Tape::<f64>::train(0);
        let p = tape.leaf(arr2(&[[0.25, 0.5, 0.0, 1.0]]));
        let t = tape.constant(arr2(&[[1.0, 0.0, 1.0, 1.0]]));
        let loss = mask_bce(p, t);
        // A probability of zero for what is there costs 100, the limit; of one, nothing.
        let expected = (4.0f64.ln() + 2.0f64.ln() + 100.0) / 4.0;
        assert_relative_eq!(loss.item(), expected, epsilon = 1e-12);
        assert!(loss.backward().is_finite());
    }
}
