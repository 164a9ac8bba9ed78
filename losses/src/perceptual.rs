//! How alike two images look: by the maps of a network, or without one.

use autodiff_lite::{Backward, Real, Tensor, Var};

use crate::kernels::chunks;
use crate::scalar::{same_shape, scalar, seed};

/// Added to the length of a pixel's features before they are divided by it.
const EPSILON: f64 = 1e-10;
/// Pixels in a chunk at least.
const CHUNK: usize = 64;

/// The distance of two images in the maps of a network, as LPIPS has it: at each pixel features of
/// length one, their squared differences weighted by channel; means over pixels, sums over maps, the mean
/// over the batch.
///
/// ```text
/// Σ_l mean_hw Σ_c w_lc (u_lc - v_lc)²        u, v = features / (‖features‖ + 1e-10)
/// ```
///
/// With VGG16's maps before its pools and the learned weights this is LPIPS; the networks are the
/// caller's affair (`nets::Vgg16`, `nets::LpipsWeights`).
///
/// # Shapes
/// `maps` and `target`: as many maps `[N, H_l, W_l, C_l]` as `weights` has rows of `C_l` → a scalar.
/// # Gradient
/// To both sides; zero where a pixel has no features.
/// # Panics
/// If the numbers of maps differ, there is none, or shapes do not fit.
/// # References
/// Zhang et al. 2018, *The unreasonable effectiveness of deep features as a perceptual metric*,
/// equation 1.
#[track_caller]
pub fn lpips<'t, F: Real>(
    maps: &[Var<'t, F>],
    target: &[Var<'t, F>],
    weights: &[&[F]],
) -> Var<'t, F> {
    assert!(
        maps.len() == target.len() && maps.len() == weights.len() && !maps.is_empty(),
        "lpips: {} maps against {} with {} rows of weights",
        maps.len(),
        target.len(),
        weights.len()
    );
    let terms = maps.iter().zip(target).zip(weights);
    let terms: Vec<_> = terms.map(|((&a, &b), w)| (F::one(), map_distance(a, b, w))).collect();
    maps[0].tape().lincomb(&terms)
}

#[track_caller]
fn map_distance<'t, F: Real>(a: Var<'t, F>, b: Var<'t, F>, weights: &[F]) -> Var<'t, F> {
    let (name, tape) = ("lpips", a.tape());
    same_shape(name, ["maps", "target"], a, b);
    let channels = tape.check(name, |shapes| {
        let [.., channels] = shapes.axes("maps", &a.shape(), ["N", "H", "W", "C"])?;
        if weights.len() != channels {
            return Err(shapes.error(format!("{} weights for {channels} channels", weights.len())));
        }
        Ok(channels)
    });
    let (x, y) = (a.value(), b.value());
    let [x, y] = [&x, &y].map(Tensor::as_slice);
    let mut kept = tape.buffer(channels);
    kept.copy_from_slice(weights);
    let pixels = x.len() / channels.max(1);
    let pixel = |x: &[F], y: &[F]| {
        let (p, q) = (inverse(x), inverse(y));
        let terms = x.iter().zip(y).zip(weights);
        Real::to_f64(terms.fold(F::zero(), |sum, ((&x, &y), &w)| {
            let d = x * p - y * q;
            sum + w * d * d
        }))
    };
    let total = chunks::sum(pixels, CHUNK, 4 * channels, |range| {
        let range = range.start * channels..range.end * channels;
        let rows = x[range.clone()].chunks_exact(channels).zip(y[range].chunks_exact(channels));
        rows.map(|(x, y)| pixel(x, y)).sum()
    });
    let count = pixels.max(1) as f64;
    let value = scalar(tape, total / count);
    tape.record_fn(name, &[a, b], value, move |cx: &mut Backward<'_, F>| {
        let inputs = [cx.input(0), cx.input(1)];
        let scale = seed(cx) * F::from_f64(2.0 / count);
        for i in 0..2 {
            let [x, y] = [i, 1 - i].map(|i| inputs[i].as_slice());
            let pixels = |first: usize, out: &mut [F]| {
                let range = first * channels..first * channels + out.len();
                let rows = x[range.clone()].chunks_exact(channels);
                let rows = rows.zip(y[range].chunks_exact(channels));
                for ((x, y), out) in rows.zip(out.chunks_exact_mut(channels)) {
                    pull(x, y, &kept, scale, out);
                }
            };
            cx.give_with(i, |out| chunks::fill_pixels(out, channels, CHUNK, pixels));
        }
    })
}

/// `1 / (‖x‖ + ε)`.
fn inverse<F: Real>(x: &[F]) -> F {
    let square = x.iter().fold(F::zero(), |sum, &x| sum + x * x);
    F::one() / (square.sqrt() + F::from_f64(EPSILON))
}

/// The gradient of one pixel's distance by `x`.
fn pull<F: Real>(x: &[F], y: &[F], weights: &[F], scale: F, out: &mut [F]) {
    let (p, q) = (inverse(x), inverse(y));
    let length = F::one() / p - F::from_f64(EPSILON);
    let mut along = F::zero();
    for (((out, &x), &y), &w) in out.iter_mut().zip(x).zip(y).zip(weights) {
        *out = scale * w * (x * p - y * q);
        along += *out * x;
    }
    // u = x p with p = 1 / (‖x‖ + ε): du = p dx - x p² (x · dx) / ‖x‖.
    let back = if length > F::zero() { along * p * p / length } else { F::zero() };
    let p = if length > F::zero() { p } else { F::zero() };
    out.iter_mut().zip(x).for_each(|(out, &x)| *out = *out * p - x * back);
}

/// How unlike two images are at all scales, without a network: the mean absolute difference of their
/// Laplacian pyramids.
///
/// ```text
/// (1 / (K + 1)) (Σ_k mean |d_k - up(d_(k+1))| + mean |d_K|)       d_0 = w (x - y), d_(k+1) = means of 2 x 2
/// ```
///
/// The substitute for [`lpips`] when no weights are given. It sees edges at every scale apart from tone,
/// and a shift by a pixel in a few bands only, but knows nothing of what is depicted: its figures must not
/// be compared with those of LPIPS.
///
/// # Shapes
/// `image` and `target` `[N, H, W, C]`, `mask [N, H, W, 1]`; K is `levels`, or less where a side of
/// less than 8 would be halved → a scalar.
/// # Gradient
/// To both images and the mask.
/// # Panics
/// If the shapes do not fit.
/// # References
/// Bojanowski et al. 2018, *Optimizing the latent space of generative networks* (its Lap1 loss, here
/// with means, so that a level's weight does not depend on the size; their kernel is Gaussian).
#[track_caller]
pub fn pyramid<'t, F: Real>(
    image: Var<'t, F>,
    target: Var<'t, F>,
    mask: Option<Var<'t, F>>,
    levels: usize,
) -> Var<'t, F> {
    same_shape("pyramid", ["image", "target"], image, target);
    let mut rest = image.sub(target);
    if let Some(mask) = mask {
        rest = rest.mul(mask);
    }
    let mut terms = Vec::new();
    for _ in 0..levels {
        let [_, h, w, _] = rest.dims();
        if h.min(w) < 8 {
            break;
        }
        let half = rest.adaptive_avg_pool2d(h.div_ceil(2), w.div_ceil(2));
        terms.push(rest.sub(half.resize_bilinear(h, w, false)).abs().mean());
        rest = half;
    }
    terms.push(rest.abs().mean());
    let weight = F::from_f64(1.0 / terms.len() as f64);
    let terms: Vec<_> = terms.into_iter().map(|term| (weight, term)).collect();
    image.tape().lincomb(&terms)
}

#[cfg(test)]
mod tests {
    use autodiff_lite::Tape;
    use ndarray::{Array4, ArrayD};
    use proptest::prelude::*;

    use super::*;
    use crate::testing;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn gradients_of_maps(n in 1usize..3, h in 1usize..4, c in 1usize..6, seed: u64) {
            let shapes = [vec![n, h, 2, c], vec![n, h, 2, c], vec![n, 1, 1, 2], vec![n, 1, 1, 2]];
            let weights = testing::random(&[c], 0.0, 1.0, seed ^ 2);
            let weights: Vec<f64> = weights.iter().copied().collect();
            let f = testing::function(|x| lpips(&[x[0], x[2]], &[x[1], x[3]], &[&weights[..], &[1.0, 0.5][..]]));
            // A pixel whose features nearly vanish turns quickly.
            let options = testing::options(seed).kinks(&[0.0]);
            testing::checked(&f, &shapes, &testing::Options { tolerance: 1e-4, ..options })?;
        }

        #[test]
        fn lengths_do_not_count(c in 1usize..9, factor in 0.1f64..10.0, seed: u64) {
            let x = testing::random(&[1, 2, 3, c], 0.1, 1.0, seed);
            let y = testing::random(&[1, 2, 3, c], 0.1, 1.0, seed ^ 1);
            let weights = vec![0.7; c];
            let of = |x: &ArrayD<f64>, y: &ArrayD<f64>| {
                let tape = Tape::<f64>::eval();
                lpips(&[tape.constant(x.clone())], &[tape.constant(y.clone())], &[&weights[..]]).item()
            };
            prop_assert!((of(&x, &y) - of(&(&x * factor), &y)).abs() < 1e-8);
            prop_assert!((of(&x, &y) - of(&y, &x)).abs() < 1e-12);
            prop_assert_eq!(of(&x, &x), 0.0);
        }
    }

    #[test]
    fn by_hand() {
        // Features along the first and along the second axis: differences of one in each channel.
        let tape = Tape::<f64>::train(0);
        let a = tape
            .leaf(Array4::from_shape_vec((1, 1, 2, 2), vec![3.0, 0.0, 0.0, 0.0]).expect("four"));
        let b = tape.constant(
            Array4::from_shape_vec((1, 1, 2, 2), vec![0.0, 5.0, 0.0, 0.0]).expect("four"),
        );
        let loss = lpips(&[a], &[b], &[&[0.25, 4.0][..]]);
        assert!((loss.item() - 4.25 / 2.0).abs() < 1e-9);
        // Along its own direction a feature may grow for nothing; a pixel of zeros has no derivative.
        let gradients = loss.backward();
        let found: Vec<_> = gradients.wrt(a).expect("a leaf").iter().copied().collect();
        let expected = [0.0, -4.0 / 3.0, 0.0, 0.0];
        assert!(found.iter().zip(expected).all(|(f, e)| (f - e).abs() < 1e-9), "{found:?}");
    }

    #[test]
    fn a_pyramid_has_gradients_and_grows_with_the_difference() {
        let options = testing::options(7);
        let shapes = [vec![1, 9, 16, 2], vec![1, 9, 16, 2], vec![1, 9, 16, 1]];
        let f = testing::function(|x| pyramid(x[0], x[1], Some(x[2]), 2));
        testing::checked(&f, &shapes, &options).expect("the rule");
        let tape = Tape::<f64>::eval();
        let image = testing::random(&[2, 32, 24, 3], 0.0, 1.0, 1);
        let zero = tape.constant(&image * 0.0);
        let loss = |s: f64| pyramid(tape.constant(&image * s), zero, None, 9).item();
        assert_eq!(pyramid(zero, zero, None, 9).item(), 0.0);
        assert!((loss(0.5) - 2.0 * loss(0.25)).abs() < 1e-12 && loss(0.5) > 0.0);
    }

    /// A plain tone lies in the last level alone, a board of single pixels in the first alone.
    #[test]
    fn levels_tell_scales_apart() {
        let tape = Tape::<f64>::eval();
        let image = |f: fn(usize, usize) -> f64| {
            tape.constant(Array4::from_shape_fn((1, 32, 32, 1), |(_, i, j, _)| f(i, j)))
        };
        let black = image(|_, _| 0.0);
        let tone = pyramid(image(|_, _| 0.6), black, None, 2).item();
        assert!((tone - 0.2).abs() < 1e-12, "{tone}");
        let board = image(|i, j| if (i + j) % 2 == 0 { 1.0 } else { -1.0 });
        assert!((pyramid(board, black, None, 2).item() - 1.0 / 3.0).abs() < 1e-12);
    }
}
