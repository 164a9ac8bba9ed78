//! How far two aligned depth maps are apart.

use autodiff_lite::{Real, Tape, Var};

use super::pixels::{DepthMean, Pixels};
use crate::scalar::{record, wanted};

/// Half the mean squared difference over the pixels that count, `Σ (a - b)² / 2M`.
///
/// # Shapes
/// Three images of one shape, `[N, H, W]` or `[N, H, W, 1]` → a scalar.
/// # Gradient
/// To the prediction.
/// # Panics
/// If the shapes differ.
#[track_caller]
pub fn depth_l2<'t, F: Real>(
    prediction: Var<'t, F>,
    target: Var<'t, F>,
    mask: Var<'t, F>,
    mean: DepthMean,
) -> Var<'t, F> {
    let pixels = Pixels::new("depth_l2", prediction, Some(target), mask);
    let (x, y) = (prediction.value(), target.value());
    let (x, y) = (x.as_slice(), y.as_slice());
    let mut gradient = wanted(prediction);
    let mut total = 0.0;
    for places in pixels.each() {
        let weight = mean.weight(places.len(), pixels.count(), pixels.images());
        for &p in places {
            let p = p as usize;
            let away = Real::to_f64(x[p]) - Real::to_f64(y[p]);
            total += 0.5 * weight * away * away;
            if let Some(gradient) = &mut gradient {
                gradient[p] = F::from_f64(weight * away);
            }
        }
    }
    record("depth_l2", [prediction], total, [gradient])
}

/// Half the mean absolute difference without its largest, `Σ' |a - b| / 2M`.
///
/// In each image the share `trim` of the pixels that are furthest apart is left out of the sum, though not
/// of the count `M`: in an estimate they are its mistakes. Of equal ones the first are kept.
///
/// # Shapes
/// Three images of one shape, `[N, H, W]` or `[N, H, W, 1]` → a scalar.
/// # Gradient
/// To the prediction; none from pixels that are left out.
/// # Cost
/// Linear in the pixels that count.
/// # Panics
/// If the shapes differ, or `trim` is not in `[0, 1]`.
/// # References
/// Ranftl et al. 2020, *Towards Robust Monocular Depth Estimation*, equation 7 (`trim` 0.2).
#[track_caller]
pub fn depth_l1_trimmed<'t, F: Real>(
    prediction: Var<'t, F>,
    target: Var<'t, F>,
    mask: Var<'t, F>,
    trim: f64,
    mean: DepthMean,
) -> Var<'t, F> {
    assert!((0.0..=1.0).contains(&trim), "depth_l1_trimmed: trim {trim}, expected 0 to 1");
    let pixels = Pixels::new("depth_l1_trimmed", prediction, Some(target), mask);
    let (x, y) = (prediction.value(), target.value());
    let (x, y) = (x.as_slice(), y.as_slice());
    let away = |p: u32| Real::to_f64(x[p as usize]) - Real::to_f64(y[p as usize]);
    let mut gradient = wanted(prediction);
    let mut total = 0.0;
    for places in pixels.each() {
        let weight = 0.5 * mean.weight(places.len(), pixels.count(), pixels.images());
        // Not a number is never trimmed: it would be lost without a trace.
        let key = |p: u32| (if away(p).is_nan() { -1.0 } else { away(p).abs() }, p);
        let keep = (places.len() as f64 * (1.0 - trim)) as usize;
        let first_out = nth(prediction.tape(), places, keep, key);
        for &p in places {
            if first_out.is_some_and(|out| !before(key(p), out)) {
                continue;
            }
            let away = away(p);
            total += weight * away.abs();
            if let Some(gradient) = &mut gradient {
                // Not a number keeps its sign, zero has none.
                let derivative = if away == 0.0 { 0.0 } else { weight.copysign(away) };
                gradient[p as usize] = F::from_f64(derivative);
            }
        }
    }
    record("depth_l1_trimmed", [prediction], total, [gradient])
}

/// The key of place `n` in ascending order; `None` if there are no more than `n`.
fn nth<F: Real>(
    tape: &Tape<F>,
    places: &[u32],
    n: usize,
    key: impl Fn(u32) -> (f64, u32),
) -> Option<(f64, u32)> {
    if n >= places.len() {
        return None;
    }
    let mut order = tape.indices(places.len());
    order.copy_from_slice(places);
    let (_, &mut found, _) = order.select_nth_unstable_by(n, |&a, &b| {
        let (a, b) = (key(a), key(b));
        a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))
    });
    Some(key(found))
}

fn before(a: (f64, u32), b: (f64, u32)) -> bool {
    a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)).is_lt()
}
