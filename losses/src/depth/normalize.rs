//! Depth of no scale and shift, robust against outliers.

use autodiff_lite::{Backward, Real, Tape, Var};

use super::pixels::Pixels;
use crate::kernels::alignment::is_constant;
use crate::scalar::sign;

/// The image less its median, over the mean absolute distance from it; image by image.
///
/// ```text
/// t = median(d),   s = mean |d - t|,   (d - t) / s
/// ```
///
/// The median is taken over the pixels that count, and of an even number it is the lower of the two in the
/// middle. (A code in circulation takes it over the masked zeros as well, which shifts it by an amount that
/// depends on the size of the object.) A constant image becomes zero and has no gradient.
///
/// # Shapes
/// Two images of one shape, `[N, H, W]` or `[N, H, W, 1]` → the same; `+∞` where a pixel does not count.
/// # Gradient
/// To the image, through median and distance as well.
/// # Cost
/// Linear in the pixels that count.
/// # Panics
/// If the shapes differ.
/// # References
/// Ranftl et al. 2020, *Towards Robust Monocular Depth Estimation*, equations 5 and 6.
#[track_caller]
pub fn normalize_depth<'t, F: Real>(image: Var<'t, F>, mask: Var<'t, F>) -> Var<'t, F> {
    let tape = image.tape();
    let pixels = Pixels::new("normalize_depth", image, None, mask);
    let value = image.value();
    let x = value.as_slice();
    let mut normal = tape.pool().filled(&image.shape(), F::infinity());
    let out = normal.as_slice_mut();
    let mut medians = tape.indices(pixels.images());
    // One over the mean distance of each image from its median; 0 where it is constant.
    let mut inverses = tape.buffer(pixels.images());
    for ((places, middle), inverse) in
        pixels.each().zip(medians.iter_mut()).zip(inverses.iter_mut())
    {
        *inverse = F::zero();
        let Some(median) = median(tape, x, places) else { continue };
        *middle = median;
        let center = Real::to_f64(x[median as usize]);
        let (mut distance, mut spread, mut squares) = (0.0, 0.0, 0.0);
        for &p in places {
            let value = Real::to_f64(x[p as usize]);
            distance += (value - center).abs();
            spread += (value - center) * (value - center);
            squares += value * value;
        }
        let flat = is_constant(spread, squares);
        let scale = if flat { 0.0 } else { places.len() as f64 / distance };
        *inverse = F::from_f64(scale);
        for &p in places {
            out[p as usize] = F::from_f64((Real::to_f64(x[p as usize]) - center) * scale);
        }
    }
    tape.record_fn("normalize_depth", &[image], normal, move |cx: &mut Backward<'_, F>| {
        let (z, g) = (cx.output(), cx.grad_out());
        let (z, g) = (z.as_slice(), g.as_slice());
        let out = cx.grad_slice_mut(0);
        let images = pixels.each().zip(medians.iter()).zip(inverses.iter());
        for ((places, &median), &inverse) in images {
            if inverse == F::zero() {
                continue;
            }
            let inverse = Real::to_f64(inverse);
            let at = |p: u32| (Real::to_f64(z[p as usize]), Real::to_f64(g[p as usize]));
            // z = (x - t) / s: dz_i/ds = -z_i / s, and s moves with the sign of each z over the count.
            let (mut total, mut at_scale, mut signs) = (0.0, 0.0, 0.0);
            for &p in places {
                let (z, g) = at(p);
                total += g;
                at_scale -= g * z * inverse;
                signs += sign(z);
            }
            let count = places.len() as f64;
            for &p in places {
                let (z, g) = at(p);
                out[p as usize] += F::from_f64(g * inverse + at_scale * sign(z) / count);
            }
            out[median as usize] -= F::from_f64(total * inverse + at_scale * signs / count);
        }
    })
}

/// The place of the (lower) median.
fn median<F: Real>(tape: &Tape<F>, x: &[F], places: &[u32]) -> Option<u32> {
    let middle = places.len().checked_sub(1)? / 2;
    let mut order = tape.indices(places.len());
    order.copy_from_slice(places);
    let value = |p: u32| Real::to_f64(x[p as usize]);
    let by_value = |a: &u32, b: &u32| value(*a).total_cmp(&value(*b)).then(a.cmp(b));
    let (_, &mut median, _) = order.select_nth_unstable_by(middle, by_value);
    Some(median)
}
