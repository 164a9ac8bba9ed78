//! Depth up to a scale.

use autodiff_lite::{Real, Var};

use super::pixels::{DepthMean, Pixels};
use crate::scalar::{record, wanted};

/// The scale-invariant logarithmic error.
///
/// ```text
/// mean(D²) - λ mean(D)²,       D = ln d - ln d*
/// ```
///
/// image by image. With `λ` of 1 it is the variance of `D` and does not change when the prediction is scaled;
/// with 0 it is the mean squared logarithmic error; 0.5 is published. As `ln(1/d) = -ln d`, it is the same on
/// depth and on disparity. It is not invariant to a shift, so it is for depth that is metric up to its unit,
/// and for no estimate of MiDaS.
///
/// # Shapes
/// Three images of one shape, `[N, H, W]` or `[N, H, W, 1]` → a scalar. A target that is not above zero is a
/// hole and does not count; a prediction that counts and is not above zero has no logarithm, and the value is
/// then not finite.
/// # Gradient
/// To the prediction.
/// # Panics
/// If the shapes differ.
/// # References
/// Eigen, Puhrsch, Fergus 2014, *Depth Map Prediction from a Single Image using a Multi-Scale Deep Network*,
/// equation 4.
#[track_caller]
pub fn log_depth<'t, F: Real>(
    prediction: Var<'t, F>,
    target: Var<'t, F>,
    mask: Var<'t, F>,
    lambda: f64,
    mean: DepthMean,
) -> Var<'t, F> {
    let pixels = Pixels::new("log_depth", prediction, Some(target), mask);
    let (x, y) = (prediction.value(), target.value());
    let (x, y) = (x.as_slice(), y.as_slice());
    // Not a number is no hole.
    let measured = |&&p: &&u32| y[p as usize] > F::zero() || y[p as usize].is_nan();
    let away = |p: u32| Real::to_f64(x[p as usize]).ln() - Real::to_f64(y[p as usize]).ln();
    let all = pixels.each().flatten().filter(measured).count();
    let mut gradient = wanted(prediction);
    let mut total = 0.0;
    for places in pixels.each() {
        let (mut count, mut sum, mut squares) = (0, 0.0, 0.0);
        for &p in places.iter().filter(measured) {
            let away = away(p);
            count += 1;
            sum += away;
            squares += away * away;
        }
        if count == 0 {
            continue;
        }
        let weight = mean.weight(count, all, pixels.images());
        let middle = sum / f64::from(count as u32);
        total += weight * (squares - lambda * sum * middle);
        if let Some(gradient) = &mut gradient {
            for &p in places.iter().filter(measured) {
                let derivative = 2.0 * weight * (away(p) - lambda * middle);
                gradient[p as usize] = F::from_f64(derivative / Real::to_f64(x[p as usize]));
            }
        }
    }
    record("log_depth", [prediction], total, [gradient])
}
