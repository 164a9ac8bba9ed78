//! Colours as CIE Lab, and losses of lightness and colour in it.

use autodiff_lite::{Backward, Real, Var};

use crate::kernels::{chunks, lab};
use crate::l2;

/// Pixels in a chunk at least.
const CHUNK: usize = 1024;
/// Nanoseconds' worth of arithmetic in a pixel.
const COST: usize = 100;

/// sRGB in `[0, 1]` to CIE Lab: L in `[0, 100]`, a and b within about ±110, white D65.
///
/// # Shapes
/// `image [.., 3]` → `[.., 3]`.
/// # Gradient
/// None to a value outside `[0, 1]`, which is clamped. Finite everywhere: the curve is straight near
/// black.
/// # Cost
/// Six powers a pixel; backward computes them again.
/// # Panics
/// If the last axis is not 3.
/// # References
/// CIE 015; matrix and white as in the code of Simoni et al. 2021, *Multi-Category Mesh Reconstruction
/// From Image Collections*.
///
/// ```
/// use autodiff_lite::Tape;
/// let tape = Tape::<f64>::eval();
/// let red = losses::rgb_to_lab(tape.constant(ndarray::arr1(&[1.0, 0.0, 0.0]))).value();
/// assert!((red[0] - 53.24).abs() < 0.01 && (red[1] - 80.1).abs() < 0.05);
/// ```
#[track_caller]
pub fn rgb_to_lab<F: Real>(image: Var<'_, F>) -> Var<'_, F> {
    let x = image.value();
    if x.shape().last() != Some(&3) {
        let message = "three colours expected in the last axis";
        image.tape().refuse("rgb_to_lab", message, &[("image", x.shape(), ".., 3")]);
    }
    let mut y = image.tape().array(x.shape());
    let pixels = x.as_slice().as_chunks::<3>().0;
    let out = y.as_slice_mut().as_chunks_mut::<3>().0;
    chunks::fill(out, CHUNK, COST, |first, out| {
        let pixels = &pixels[first..first + out.len()];
        out.iter_mut().zip(pixels).for_each(|(out, &rgb)| *out = lab::lab(rgb));
    });
    image.tape().record_fn("rgb_to_lab", &[image], y, |cx: &mut Backward<'_, F>| {
        let (x, g) = (cx.input(0), cx.grad_out());
        let [pixels, g] = [&x, &g].map(|x| x.as_slice().as_chunks::<3>().0);
        let out = cx.grad_slice_mut(0).as_chunks_mut::<3>().0;
        chunks::fill(out, CHUNK, COST, |first, out| {
            for (i, out) in out.iter_mut().enumerate() {
                let g = g[first + i];
                // Most of a masked image asks for nothing.
                if g != [F::zero(); 3] {
                    let own = lab::lab_grad(pixels[first + i], g);
                    (0..3).for_each(|k| out[k] += own[k]);
                }
            }
        });
    })
}

/// Mean squared difference of lightness, `mean(w (L - L')²)`, over all pixels.
///
/// # Shapes
/// `lab` and `target` `[N, H, W, 3]` of [`rgb_to_lab`], `mask [N, H, W]` or `[N, H, W, 1]` → a scalar, in
/// squared units of L: hundreds, hence the small weights of the published sums.
/// # Panics
/// If the shapes do not fit.
/// # References
/// The pixel loss of Simoni et al. 2021 (which repeats L three times, to the same mean), for masks of 0
/// and 1.
#[track_caller]
pub fn lab_lightness<'t, F: Real>(
    lab: Var<'t, F>,
    target: Var<'t, F>,
    mask: Option<Var<'t, F>>,
) -> Var<'t, F> {
    part(lab, target, mask, 0..1)
}

/// Mean squared difference of colour, `mean(w ((a - a')² + (b - b')²) / 2)`, over all pixels.
///
/// # Shapes
/// As for [`lab_lightness`], and so are panics.
/// # References
/// The colour loss of Simoni et al. 2021, for masks of 0 and 1.
#[track_caller]
pub fn lab_color<'t, F: Real>(
    lab: Var<'t, F>,
    target: Var<'t, F>,
    mask: Option<Var<'t, F>>,
) -> Var<'t, F> {
    part(lab, target, mask, 1..3)
}

#[track_caller]
fn part<'t, F: Real>(
    lab: Var<'t, F>,
    target: Var<'t, F>,
    mask: Option<Var<'t, F>>,
    range: std::ops::Range<usize>,
) -> Var<'t, F> {
    let axis = lab.rank().saturating_sub(1);
    l2(lab.slice_axis(axis, range.clone()), target.slice_axis(axis, range), mask)
}

#[cfg(test)]
mod tests {
    use autodiff_lite::Tape;
    use ndarray::{Array4, arr2};
    use proptest::prelude::*;

    use super::*;
    use crate::testing;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn gradients(n in 1usize..3, w in 1usize..5, seed: u64) {
            // 0.04045 is a kink of the curve, 0 and 1 those of the clamp.
            let options = testing::options(seed).range(-0.1, 1.1).kinks(&[0.0, 0.04045, 1.0]);
            let shape = [vec![n, 2, w, 3]];
            testing::checked(&|x: &[Var<'_, f64>]| rgb_to_lab(x[0]), &shape, &options)?;
            let target = testing::random(&shape[0], 0.0, 1.0, seed ^ 3);
            let mask = testing::random(&shape[0][..3], 0.0, 1.0, seed ^ 5);
            let loss = testing::function(|x| {
                let [lab, target] = [x[0], x[0].tape().constant(target.clone())].map(rgb_to_lab);
                let mask = Some(x[0].tape().constant(mask.clone()));
                lab_color(lab, target, mask).scale(0.03).add(lab_lightness(lab, target, None))
            });
            testing::checked(&loss, &shape, &testing::Options { tolerance: 1e-5, ..options })?;
        }

        /// A gray has no colour, and the brighter is the lighter.
        #[test]
        fn grays(v in 0.0f64..1.0, w in 0.0f64..1.0) {
            let [a, b] = [v, w].map(|v| lab::lab([v; 3]));
            prop_assert!(a[1].abs() < 1e-3 && a[2].abs() < 1e-3, "{a:?}");
            prop_assert_eq!(v < w, a[0] < b[0]);
        }
    }

    /// The corners of the cube as colour tables print them.
    #[test]
    fn known_colors() {
        let known = [
            ([1.0, 1.0, 1.0], [100.0, 0.0, 0.0]),
            ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
            ([1.0, 0.0, 0.0], [53.24, 80.09, 67.20]),
            ([0.0, 1.0, 0.0], [87.73, -86.18, 83.18]),
            ([0.0, 0.0, 1.0], [32.30, 79.19, -107.86]),
        ];
        for (rgb, expected) in known {
            let found = lab::lab::<f64>(rgb);
            for k in 0..3 {
                assert!((found[k] - expected[k]).abs() < 0.02, "{found:?} of {rgb:?}");
            }
            let single = lab::lab::<f32>(rgb.map(|v| v as f32));
            assert!((0..3).all(|k| (f64::from(single[k]) - found[k]).abs() < 1e-3));
        }
    }

    #[test]
    fn masked_means_by_hand() {
        let tape = Tape::<f64>::train(0);
        let white = Array4::from_elem((1, 1, 2, 3), 1.0);
        let black = tape.leaf(Array4::zeros((1, 1, 2, 3)));
        let [a, b] = [black, tape.constant(white)].map(rgb_to_lab);
        let mask = tape.constant(arr2(&[[0.0, 1.0]])).reshape(&[1, 1, 2]);
        let loss = lab_lightness(a, b, Some(mask));
        assert!((loss.item() - 5000.0).abs() < 1e-2, "half of 100²: {}", loss.item());
        assert!(lab_color(a, b, Some(mask)).item() < 1e-4);
        let gradients = loss.backward();
        let gradient = gradients.wrt(black).expect("a leaf");
        assert!(gradient.iter().take(3).all(|&g| g == 0.0));
        assert!(gradient.iter().skip(3).all(|&g| g < 0.0));
    }
}
