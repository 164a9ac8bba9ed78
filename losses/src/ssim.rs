//! Structural similarity as a loss.

use autodiff_lite::{Backward, Real, Var};

use crate::kernels::ssim::{self, DERIVATIVES, Plane};
use crate::scalar::{same_shape, scalar, seed};

/// One minus the mean structural similarity: 0 for equal images.
///
/// ```text
/// S = (2 μx μy + C1) (2 σxy + C2) / ((μx² + μy² + C1) (σx² + σy² + C2)),     C1 = 1e-4, C2 = 9e-4
/// ```
///
/// with means and covariances under an 11 x 11 Gaussian window of standard deviation 1.5 and zero
/// padding, averaged over all pixels and channels; for values in `[0, 1]`.
///
/// # Shapes
/// `image` and `target` `[N, H, W, C]` → a scalar.
/// # Gradient
/// To both inputs.
/// # Cost
/// Two passes of five windows forward; four image-sized buffers are kept for backward.
/// # Panics
/// If the shapes differ or have not four axes.
/// # References
/// Wang, Bovik, Sheikh, Simoncelli 2004, *Image Quality Assessment: From Error Visibility to Structural
/// Similarity*.
#[track_caller]
pub fn ssim_loss<'t, F: Real>(image: Var<'t, F>, target: Var<'t, F>) -> Var<'t, F> {
    loss("ssim_loss", image, target, 0)
}

/// [`ssim_loss`] averaged over the pixels whose window lies within the image: nothing is padded, and five rows and columns
/// at each border count only as neighbours.
///
/// # Shapes
/// As for [`ssim_loss`], and so are gradient and cost.
/// # Panics
/// As [`ssim_loss`], and if the image has fewer than 11 rows or columns.
/// # References
/// The mean that scikit-image's `structural_similarity` takes, with `gaussian_weights=True, sigma=1.5,
/// use_sample_covariance=False, data_range=1`.
#[track_caller]
pub fn ssim_loss_valid<'t, F: Real>(image: Var<'t, F>, target: Var<'t, F>) -> Var<'t, F> {
    loss("ssim_loss_valid", image, target, ssim::RADIUS)
}

#[track_caller]
fn loss<'t, F: Real>(
    name: &'static str,
    image: Var<'t, F>,
    target: Var<'t, F>,
    margin: usize,
) -> Var<'t, F> {
    let tape = image.tape();
    same_shape(name, ["image", "target"], image, target);
    let axes = ["N", "H", "W", "C"];
    let [images, height, width, channels] =
        tape.check(name, |shapes| shapes.axes("image", &image.shape(), axes));
    let plane = Plane { images, height, width, channels, margin };
    if plane.counted() == 0 && !plane.is_empty() {
        let message = format!("no window of {} pixels lies within the image", 2 * margin + 1);
        tape.refuse(name, message, &[("image", &image.shape(), "N, H, W, C")]);
    }
    let (x, y) = (image.value(), target.value());
    let mut derivatives =
        tape.wants_grad(&[image, target]).then(|| tape.buffer(DERIVATIVES * plane.len()));
    let similarity = if plane.is_empty() {
        1.0
    } else {
        let mut scratch = tape.buffer(plane.scratch_len());
        let (x, y) = (x.as_slice(), y.as_slice());
        ssim::ssim(x, y, plane, &mut scratch, derivatives.as_deref_mut())
    };
    let value = scalar(tape, 1.0 - similarity);
    tape.record_fn(name, &[image, target], value, move |cx: &mut Backward<'_, F>| {
        let Some(derivatives) = derivatives.as_deref().filter(|_| !plane.is_empty()) else {
            return;
        };
        let inputs = [cx.input(0), cx.input(1)];
        let scale = -seed(cx) / F::from_f64(plane.counted() as f64);
        let mut scratch = cx.scratch(plane.scratch_len());
        for i in 0..2 {
            let [x, y] = [i, 1 - i].map(|i| inputs[i].as_slice());
            cx.give_with(i, |out| {
                ssim::ssim_grad(x, y, plane, derivatives, i, scale, &mut scratch, out);
            });
        }
    })
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use autodiff_lite::Tape;
    use ndarray::Array4;
    use proptest::prelude::*;

    use super::*;
    use crate::testing;

    /// The definition, window by window.
    fn plain(x: &Array4<f64>, y: &Array4<f64>, margin: usize) -> f64 {
        let (n, h, w, c) = x.dim();
        let gauss = |d: isize| (-(d * d) as f64 / 4.5).exp();
        let norm: f64 = (-5..=5).map(gauss).sum();
        let mut total = 0.0;
        let mut count = 0;
        for (b, i, j, k) in ndarray::indices((n, h, w, c)) {
            let within = |i: usize, size: usize| i >= margin && i + margin < size;
            if !within(i, h) || !within(j, w) {
                continue;
            }
            count += 1;
            let [mut m, mut u, mut p, mut r, mut q] = [0.0; 5];
            for di in -5isize..=5 {
                for dj in -5isize..=5 {
                    let (s, t) = (i as isize + di, j as isize + dj);
                    if s < 0 || t < 0 || s >= h as isize || t >= w as isize {
                        continue;
                    }
                    let g = gauss(di) * gauss(dj) / (norm * norm);
                    let (x, y) =
                        (x[[b, s as usize, t as usize, k]], y[[b, s as usize, t as usize, k]]);
                    m += g * x;
                    u += g * y;
                    p += g * x * x;
                    r += g * y * y;
                    q += g * x * y;
                }
            }
            total += (2.0 * m * u + 1e-4) * (2.0 * (q - m * u) + 9e-4)
                / ((m * m + u * u + 1e-4) * (p - m * m + r - u * u + 9e-4));
        }
        total / count as f64
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn gradients(n in 1usize..3, h in 1usize..9, w in 1usize..14, c in 1usize..4, seed: u64) {
            let shapes = [vec![n, h, w, c], vec![n, h, w, c]];
            let options = testing::options(seed).range(0.0, 1.0);
            testing::checked(&|x: &[Var<'_, f64>]| ssim_loss(x[0], x[1]), &shapes, &options)?;
        }

        #[test]
        fn the_definition(n in 1usize..3, h in 1usize..26, w in 1usize..26, c in 1usize..4, seed: u64) {
            let x = testing::random(&[n, h, w, c], 0.0, 1.0, seed);
            let y = testing::random(&[n, h, w, c], 0.0, 1.0, seed ^ 1);
            let tape = Tape::<f64>::eval();
            let loss = ssim_loss(tape.constant(x.clone()), tape.constant(y.clone())).item();
            let four = |a: &ndarray::ArrayD<f64>| a.clone().into_shape_with_order((n, h, w, c)).expect("four axes");
            prop_assert!((1.0 - loss - plain(&four(&x), &four(&y), 0)).abs() < 1e-12);
        }

        #[test]
        fn within_the_image(n in 1usize..3, h in 11usize..26, w in 11usize..20, c in 1usize..3, seed: u64) {
            let x = testing::random(&[n, h, w, c], 0.0, 1.0, seed);
            let y = testing::random(&[n, h, w, c], 0.0, 1.0, seed ^ 1);
            let tape = Tape::<f64>::eval();
            let loss = ssim_loss_valid(tape.constant(x.clone()), tape.constant(y.clone())).item();
            let four = |a: &ndarray::ArrayD<f64>| a.clone().into_shape_with_order((n, h, w, c)).expect("four axes");
            prop_assert!((1.0 - loss - plain(&four(&x), &four(&y), 5)).abs() < 1e-12);
            let shapes = [vec![1, 12, 11, 2], vec![1, 12, 11, 2]];
            let options = testing::Options { probes: 40, ..testing::options(seed).range(0.0, 1.0) };
            testing::checked(&|x: &[Var<'_, f64>]| ssim_loss_valid(x[0], x[1]), &shapes, &options)?;
        }
    }

    #[test]
    #[should_panic(expected = "ssim_loss_valid: no window of 11 pixels lies within the image")]
    fn an_image_without_a_window() {
        let tape = Tape::<f32>::eval();
        let x = tape.constant(Array4::zeros((1, 10, 30, 1)));
        let _ = ssim_loss_valid(x, x);
    }

    #[test]
    fn equal_images_lose_nothing() {
        let tape = Tape::<f32>::train(0);
        let x = tape.leaf(Array4::from_shape_fn((2, 40, 30, 3), |(n, i, j, k)| {
            ((n + 3 * i + 7 * j + k) % 17) as f32 / 17.0
        }));
        let loss = ssim_loss(x, x.detach());
        assert_relative_eq!(loss.item(), 0.0, epsilon = 1e-5);
        assert!(loss.backward().norm() < 1e-5);
    }
}
