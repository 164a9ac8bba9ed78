//! Steps in depth should lie where the target has them.

use autodiff_lite::{Real, Var};

use super::pixels::{DepthMean, Pixels};
use crate::scalar::{record, wanted};

/// The mean absolute gradient of the difference of two depth maps, at several scales.
///
/// ```text
/// Σ_k (1/M_k) Σ_i ( |R_i,right - R_i| + |R_i,below - R_i| ),       R = a - b
/// ```
///
/// At scale `k` the images are every `2^k`-th pixel of every `2^k`-th row, taken and not averaged; a
/// difference counts where both of its ends do, and `M_k` is how many of those pixels count. It is zero
/// exactly where the two differ by a constant on each connected part of the mask: shifts cost nothing, edges
/// in the wrong place cost much.
///
/// # Shapes
/// Three images of one shape, `[N, H, W]` or `[N, H, W, 1]` → a scalar.
/// # Gradient
/// To the prediction.
/// # Cost
/// One and a third passes over the images.
/// # Panics
/// If the shapes differ, or there are 32 scales or more.
/// # References
/// Ranftl et al. 2020, *Towards Robust Monocular Depth Estimation*, equation 11 (4 scales), after Li and
/// Snavely 2018, *MegaDepth*; counted by scales as in the code published with it.
#[track_caller]
pub fn depth_gradients<'t, F: Real>(
    prediction: Var<'t, F>,
    target: Var<'t, F>,
    mask: Var<'t, F>,
    scales: usize,
    mean: DepthMean,
) -> Var<'t, F> {
    assert!(scales < 32, "depth_gradients: {scales} scales, expected less than 32");
    let tape = prediction.tape();
    let pixels = Pixels::new("depth_gradients", prediction, Some(target), mask);
    let [height, width] = pixels.size;
    let (x, y) = (prediction.value(), target.value());
    let (x, y) = (x.as_slice(), y.as_slice());
    let mut counts = tape.indices(x.len());
    counts.fill(0);
    pixels.each().flatten().for_each(|&p| counts[p as usize] = 1);
    let mut gradient = wanted(prediction);
    let mut total = 0.0;
    for step in (0..scales).map(|k| 1_usize << k) {
        let is_sampled = |p: u32| {
            let (row, column) = (p as usize / width % height, p as usize % width);
            row.is_multiple_of(step) && column.is_multiple_of(step)
        };
        let sampled = |places: &[u32]| places.iter().filter(|&&p| is_sampled(p)).count();
        let all = pixels.each().map(sampled).sum();
        for places in pixels.each() {
            let weight = mean.weight(sampled(places), all, pixels.images());
            for p in places.iter().filter(|&&p| is_sampled(p)).map(|&p| p as usize) {
                let (row, column) = (p / width % height, p % width);
                let right = (column + step < width).then_some(p + step);
                let below = (row + step < height).then_some(p + step * width);
                for q in [right, below].into_iter().flatten().filter(|&q| counts[q] == 1) {
                    let away = |p: usize| Real::to_f64(x[p]) - Real::to_f64(y[p]);
                    let derivative = away(q) - away(p);
                    total += weight * derivative.abs();
                    if let Some(gradient) = &mut gradient
                        && derivative != 0.0
                    {
                        let push = F::from_f64(weight.copysign(derivative));
                        gradient[q] += push;
                        gradient[p] -= push;
                    }
                }
            }
        }
    }
    record("depth_gradients", [prediction], total, [gradient])
}
