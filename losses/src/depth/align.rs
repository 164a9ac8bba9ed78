//! Disparity, and one disparity brought onto another.

use autodiff_lite::{Backward, Real, Tensor, Var};

use super::pixels::Pixels;
use crate::kernels::alignment::ScaleShift;

/// `1 / z`, and `+∞` where `z` is `+∞`.
///
/// Infinitely far would be a disparity of 0; but `+∞` marks that nothing was seen, and the mark is kept so
/// that the losses here leave such pixels alone. They have no gradient.
///
/// # Shapes
/// Any → the same; depth above zero in any unit, its reciprocal.
pub fn disparity<F: Real>(depth: Var<'_, F>) -> Var<'_, F> {
    depth.map(
        |z| if z == F::infinity() { z } else { F::one() / z },
        |z, d| if z == F::infinity() { F::zero() } else { -d * d },
    )
}

/// The prediction times the scale plus the shift that bring it closest to the target, image by image.
///
/// ```text
/// (s, t) = argmin Σ (s d + t - d*)²,       s = ρ σ* / σ,   t = mean(d*) - s mean(d)
/// ```
///
/// with `ρ` the correlation and `σ`, `σ*` the standard deviations over the pixels that count. What MiDaS
/// predicts is disparity up to a scale and a shift, so this is how a rendered disparity is compared to it.
///
/// - **A prediction turned inside out** (near is far) has a negative scale under least squares, and aligns
///   as well as the right one. `least_correlation` in place of a smaller `ρ` forbids that: above it nothing
///   changes; below, the squared distance keeps falling as `ρ` grows, and value and derivative meet where the two
///   meet. Least squares with `s ≥ 0`, a floor of 0, would leave such a prediction without any gradient.
///   With -1 the floor is never reached: the published form.
/// - **A constant prediction**, or one pixel, has no best scale: the aligned image is the mean of the target
///   there and has no gradient (the limits from different directions differ, so none would be right).
///
/// # Shapes
/// Three images of one shape, `[N, H, W]` or `[N, H, W, 1]` → the same; `+∞` where a pixel does not count.
/// # Gradient
/// To the prediction, through scale and shift as well.
/// # Cost
/// A few passes over the pixels that count.
/// # Panics
/// If the shapes differ.
/// # References
/// Ranftl et al. 2020, *Towards Robust Monocular Depth Estimation*, equations 2 and 4.
#[track_caller]
pub fn align_scale_shift<'t, F: Real>(
    prediction: Var<'t, F>,
    target: Var<'t, F>,
    mask: Var<'t, F>,
    least_correlation: f64,
) -> Var<'t, F> {
    let tape = prediction.tape();
    let pixels = Pixels::new("align_scale_shift", prediction, Some(target), mask);
    let (x, y) = (prediction.value(), target.value());
    let (x, y) = (x.as_slice(), y.as_slice());
    let mut aligned = tape.pool().filled(&prediction.shape(), F::infinity());
    let out = aligned.as_slice_mut();
    let mut fits = Vec::with_capacity(pixels.images());
    for places in pixels.each() {
        let fit = ScaleShift::fit(x, y, places, least_correlation);
        for &p in places {
            out[p as usize] = F::from_f64(fit.apply(Real::to_f64(x[p as usize])));
        }
        fits.push(fit);
    }
    let inputs = [prediction, target];
    tape.record_fn("align_scale_shift", &inputs, aligned, move |cx: &mut Backward<'_, F>| {
        if !cx.needs(0) {
            return;
        }
        let (x, y, g) = (cx.input(0), cx.input(1), cx.grad_out());
        let [x, y, g] = [&x, &y, &g].map(Tensor::as_slice);
        let out = cx.grad_slice_mut(0);
        for (places, fit) in pixels.each().zip(&fits) {
            if fit.is_flat() {
                continue;
            }
            let at = |p: u32| {
                let p = p as usize;
                let (x, y) = (Real::to_f64(x[p]) - fit.mean_x, Real::to_f64(y[p]) - fit.mean_y);
                (x, y, Real::to_f64(g[p]))
            };
            // out = s (x - mean x) + mean y
            let (mut mean, mut at_scale) = (0.0, 0.0);
            for &p in places {
                let (x, _, g) = at(p);
                mean += g;
                at_scale += g * x;
            }
            mean /= places.len() as f64;
            for &p in places {
                let (x, y, g) = at(p);
                let derivative = if fit.floored { -fit.scale * x } else { y - 2.0 * fit.scale * x };
                let derivative = fit.scale * (g - mean) + at_scale * derivative / fit.spread_x;
                out[p as usize] += F::from_f64(derivative);
            }
        }
    })
}
