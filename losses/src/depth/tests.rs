//! What each depth loss claims not to see, and that it sees nothing outside the mask.

use approx::assert_relative_eq;
use autodiff_lite::testkit::{check, function};
use autodiff_lite::{Tape, Var};
use ndarray::{Array3, ArrayD};
use proptest::prelude::*;

use super::*;
use crate::testing;

/// The same, with options of its own.
type Configured<'a> = dyn for<'t> Fn(Var<'t, f64>, Var<'t, f64>, Var<'t, f64>) -> Var<'t, f64> + 'a;

type Loss = for<'t> fn(Var<'t, f64>, Var<'t, f64>, Var<'t, f64>) -> Var<'t, f64>;

fn least_squares<'t>(x: Var<'t, f64>, y: Var<'t, f64>, m: Var<'t, f64>) -> Var<'t, f64> {
    ScaleShiftInvariant::least_squares().loss(x, y, m)
}

fn published<'t>(x: Var<'t, f64>, y: Var<'t, f64>, m: Var<'t, f64>) -> Var<'t, f64> {
    ScaleShiftInvariant::published().loss(x, y, m)
}

fn trimmed<'t>(x: Var<'t, f64>, y: Var<'t, f64>, m: Var<'t, f64>) -> Var<'t, f64> {
    ScaleShiftInvariant::trimmed().loss(x, y, m)
}

fn logarithmic<'t>(x: Var<'t, f64>, y: Var<'t, f64>, m: Var<'t, f64>) -> Var<'t, f64> {
    log_depth(x, y, m, 1.0, DepthMean::Images)
}

/// Every loss that takes images as they come.
const ALL: [Loss; 4] = [least_squares, published, trimmed, logarithmic];

fn value(loss: Loss, x: &ArrayD<f64>, y: &ArrayD<f64>, mask: &ArrayD<f64>) -> f64 {
    let tape = Tape::<f64>::eval();
    let [x, y, mask] = [x, y, mask].map(|a| tape.constant(a.clone()));
    loss(x, y, mask).item()
}

/// A depth map, another one, and a mask with this share of the pixels.
fn scene(shape: [usize; 3], share: f64, seed: u64) -> [ArrayD<f64>; 3] {
    let draw = |seed| testing::random(&shape, 0.5, 3.0, seed);
    let mask = testing::random(&shape, 0.0, 1.0, seed ^ 0xA5).mapv(|u| f64::from(u < share));
    [draw(seed), draw(seed ^ 0x5A), mask]
}

fn mean() -> impl Strategy<Value = DepthMean> {
    prop_oneof![Just(DepthMean::Pixels), Just(DepthMean::Images)]
}

fn shapes() -> impl Strategy<Value = [usize; 3]> {
    (1usize..3, 1usize..7, 1usize..7).prop_map(|(n, h, w)| [n, h, w])
}

proptest! {
    #[test]
    fn gradients(shape in (1usize..3, 4usize..8, 4usize..8).prop_map(|(n, h, w)| [n, h, w]), share in 0.3f64..1.0, floor in prop_oneof![Just(-1.0), Just(0.4)], mean in mean(), seed: u64) {
        let [x, y, mask] = scene(shape, share, seed);
        let options = testing::options(seed);
        // Of very few pixels the spread may be next to nothing, and derivatives as steep as it is small; and any change
        // reorders them.
        prop_assume!(mask.outer_iter().all(|m| m.sum() == 0.0 || m.sum() >= 6.0));
        let checked = |f: &Configured<'_>| {
            let whole = function(|v| {
                let tape = v[0].tape();
                // As a sum rather than a mean, so that the derivative of one pixel is not small.
                let loss = f(v[0], tape.constant(y.clone()), tape.constant(mask.clone()));
                loss.scale(x.len() as f64)
            });
            check(&whole, std::slice::from_ref(&x), &options).map_err(|e| TestCaseError::fail(e.to_string()))
        };
        checked(&|x, y, m| depth_l2(x, y, m, mean))?;
        checked(&|x, y, m| depth_l1_trimmed(x, y, m, 0.2, mean))?;
        checked(&|x, y, m| depth_gradients(x, y, m, 3, mean))?;
        checked(&|x, y, m| log_depth(x, y, m, 0.5, mean))?;
        // Infinite outside the mask, so taken up by a loss that knows.
        checked(&|x, y, m| depth_l2(align_scale_shift(x, y, m, floor), y, m, mean))?;
        checked(&|x, y, m| depth_l2(normalize_depth(x, m), y, m, mean))?;
        checked(&|x, y, m| depth_l2(disparity(x), y, m, mean))?;
        checked(&|x, y, m| ScaleShiftInvariant { mean, ..ScaleShiftInvariant::least_squares() }.loss(x, y, m))?;
        checked(&|x, y, m| ScaleShiftInvariant { mean, ..ScaleShiftInvariant::trimmed() }.loss(x, y, m))?;
    }

    /// Scale and shift of the prediction cost nothing, nor those of the target where that is said.
    #[test]
    fn scale_and_shift(shape in shapes(), share in 0.2f64..1.0, s in 0.1f64..9.0, t in -5.0f64..5.0, seed: u64) {
        let [x, y, mask] = scene(shape, share, seed);
        let moved = |a: &ArrayD<f64>, s: f64| a.mapv(|v| s * v + t);
        for loss in [least_squares as Loss, published, trimmed] {
            let plain = value(loss, &x, &y, &mask);
            prop_assert!((value(loss, &moved(&x, s), &y, &mask) - plain).abs() < 1e-7 * (1.0 + plain));
            // Aligned to begin with: nothing is left.
            prop_assert!(value(loss, &moved(&y, s), &y, &mask) < 1e-7);
        }
        let plain = value(trimmed, &x, &y, &mask);
        prop_assert!((value(trimmed, &x, &moved(&y, s), &mask) - plain).abs() < 1e-7 * (1.0 + plain));
        // Turned inside out is as good as right in the published form alone.
        prop_assert!(value(published, &moved(&y, -s), &y, &mask) < 1e-7);
        let counted = mask.outer_iter().all(|m| m.sum() > 4.0);
        if counted {
            prop_assert!(value(least_squares, &moved(&y, -s), &y, &mask) > 1e-4);
            prop_assert!(value(trimmed, &moved(&y, -s), &y, &mask) > 1e-4);
        }
    }

    /// A scale costs nothing in logarithms, and near and far may change places.
    #[test]
    fn scale_and_inverse(shape in shapes(), share in 0.2f64..1.0, s in 0.1f64..9.0, lambda in 0.0f64..1.0, seed: u64) {
        let [x, y, mask] = scene(shape, share, seed);
        let plain = value(logarithmic, &x, &y, &mask);
        prop_assert!((value(logarithmic, &x.mapv(|v| s * v), &y, &mask) - plain).abs() < 1e-9);
        prop_assert!((value(logarithmic, &x, &y.mapv(|v| s * v), &mask) - plain).abs() < 1e-9);
        prop_assert!(value(logarithmic, &y.mapv(|v| s * v), &y, &mask).abs() < 1e-12);
        let of = |x: &ArrayD<f64>, y: &ArrayD<f64>| {
            let tape = Tape::<f64>::eval();
            let [x, y, m] = [x, y, &mask].map(|a| tape.constant(a.clone()));
            log_depth(x, y, m, lambda, DepthMean::Pixels).item()
        };
        let inverse = |a: &ArrayD<f64>| a.mapv(|v| 1.0 / v);
        prop_assert!((of(&inverse(&x), &inverse(&y)) - of(&x, &y)).abs() < 1e-12);
    }

    /// Outside the mask anything may stand, the mark of the background first of all: neither value nor
    /// gradient changes, and there is no gradient there.
    #[test]
    fn nothing_outside_the_mask(shape in shapes(), share in 0.0f64..1.0, junk in prop_oneof![Just(f64::INFINITY), Just(f64::NAN), Just(-1.0), Just(0.0)], seed: u64) {
        let [x, y, mask] = scene(shape, share, seed);
        let spoilt = |a: &ArrayD<f64>| ndarray::Zip::from(a).and(&mask).map_collect(|&v, &m| if m > 0.5 { v } else { junk });
        for loss in ALL {
            let gradient = |x: &ArrayD<f64>, y: &ArrayD<f64>| {
                let tape = Tape::<f64>::train(0);
                let x = tape.leaf(x.clone());
                let loss = loss(x, tape.constant(y.clone()), tape.constant(mask.clone()));
                (loss.item(), loss.backward().wrt(x).expect("a leaf").to_owned())
            };
            let (plain, spoilt) = (gradient(&x, &y), gradient(&spoilt(&x), &spoilt(&y)));
            prop_assert!(spoilt.0.is_finite());
            prop_assert_eq!(plain.0.to_bits(), spoilt.0.to_bits());
            prop_assert_eq!(&plain.1, &spoilt.1);
            for (g, m) in spoilt.1.iter().zip(&mask) {
                let right = if *m > 0.5 { g.is_finite() } else { *g == 0.0 };
                prop_assert!(right);
            }
        }
    }

    /// A pixel under the mask that the renderer left empty counts as little as one outside.
    #[test]
    fn the_mark_of_the_background_masks(shape in shapes(), share in 0.3f64..1.0, hole in 0.0f64..0.5, other: bool, seed: u64) {
        let [mut x, mut y, mask] = scene(shape, share, seed);
        let holes = testing::random(&shape, 0.0, 1.0, seed ^ 0x77).mapv(|u| u < hole);
        let smaller = ndarray::Zip::from(&mask).and(&holes).map_collect(|&m, &h| if h { 0.0 } else { m });
        let plain = ALL.map(|loss| value(loss, &x, &y, &smaller));
        let target = if other { &mut y } else { &mut x };
        target.zip_mut_with(&holes, |v, &h| if h { *v = f64::INFINITY });
        prop_assert_eq!(ALL.map(|loss| value(loss, &x, &y, &mask)), plain);
    }
}

#[test]
fn nothing_counts() {
    let tape = Tape::<f32>::train(0);
    let x = tape.leaf(Array3::from_elem((2, 3, 4), f32::INFINITY));
    let mask = tape.constant(Array3::zeros((2, 3, 4)));
    let full = tape.constant(Array3::ones((2, 3, 4)));
    let every = |mask| {
        let mean = DepthMean::Images;
        [
            ScaleShiftInvariant::least_squares().loss(disparity(x), x.detach(), mask),
            ScaleShiftInvariant::trimmed().loss(x, x.detach(), mask),
            log_depth(x, x.detach(), mask, 0.5, mean),
            depth_l2(x, x.detach(), mask, mean),
        ]
    };
    for loss in [mask, full].into_iter().flat_map(every) {
        assert_eq!(loss.item(), 0.0);
        assert!(loss.backward().wrt(x).is_none_or(|g| g.iter().all(|&g| g == 0.0)));
    }
}

#[test]
fn constants_and_single_pixels_have_no_gradient() {
    let ramp = Array3::from_shape_fn((1, 3, 4), |(_, i, j)| 1.0 + (4 * i + j) as f64);
    let one = Array3::from_shape_fn((1, 3, 4), |(_, i, j)| f64::from(i == 1 && j == 2));
    let tape = Tape::<f64>::train(0);
    let (flat, y) = (tape.leaf(Array3::from_elem((1, 3, 4), 0.3)), tape.constant(ramp.clone()));
    let (full, one) = (tape.constant(Array3::ones((1, 3, 4))), tape.constant(one));
    for (loss, name) in [(least_squares as Loss, "least squares"), (trimmed, "trimmed")] {
        for mask in [full, one] {
            let loss = loss(flat, y, mask);
            assert!(loss.item().is_finite(), "{name}");
            let gradient = loss.backward();
            assert!(gradient.wrt(flat).expect("a leaf").iter().all(|&g| g == 0.0), "{name}");
        }
    }
    // The best constant is the mean: half the variance is left.
    let data = ScaleShiftInvariant { gradient_weight: 0.0, ..ScaleShiftInvariant::published() };
    let variance = (12.0 * 12.0 - 1.0) / 12.0;
    assert_relative_eq!(data.loss(flat, y, full).item(), 0.5 * variance, epsilon = 1e-9);
}

/// With the floor a relief turned inside out is pushed towards the right one; without, it is content.
#[test]
fn the_floor_turns_a_relief_back() {
    let relief = Array3::from_shape_fn((1, 4, 4), |(_, i, j)| ((3 * i + 5 * j) % 7) as f64);
    let tape = Tape::<f64>::train(0);
    let x = tape.leaf(relief.mapv(|v| 1.0 - 0.1 * v));
    let (y, mask) = (tape.constant(relief.clone()), tape.constant(Array3::ones((1, 4, 4))));
    let pull = |options: ScaleShiftInvariant| {
        let gradient = options.loss(x, y, mask).backward();
        let gradient = gradient.wrt(x).expect("a leaf").to_owned();
        // Along the right relief the loss falls.
        -gradient.iter().zip(&relief).map(|(g, v)| g * (v - 3.0)).sum::<f64>()
    };
    assert!(pull(ScaleShiftInvariant::published()).abs() < 1e-9);
    // A relief that is exactly inverted is at the far pole, where the derivative along the right one is zero:
    // a step off it is enough.
    let tilted = tape.leaf(Array3::from_shape_fn((1, 4, 4), |(_, i, j)| {
        1.0 - 0.1 * relief[[0, i, j]] + 0.05 * (i as f64 - j as f64)
    }));
    let correlation = |x: &[f64]| {
        let all: Vec<u32> = (0..16).collect();
        crate::ScaleShift::fit(x, relief.as_slice().expect("row-major"), &all, -1.0).correlation
    };
    let gradient =
        ScaleShiftInvariant { gradient_weight: 0.0, ..ScaleShiftInvariant::least_squares() }
            .loss(tilted, y, mask)
            .backward();
    let value = tilted.value();
    let stepped: Vec<f64> = value
        .iter()
        .zip(gradient.wrt(tilted).expect("a leaf"))
        .map(|(x, g)| x - 0.01 * g)
        .collect();
    let before = value.iter().copied().collect::<Vec<_>>();
    assert!(correlation(&before) < -0.5);
    assert!(correlation(&stepped) > correlation(&before) + 1e-4);
}

/// Figures by hand: an edge in the wrong place is seen at the first scale, and not at the second.
#[test]
fn gradients_by_hand() {
    let tape = Tape::<f64>::eval();
    let x = tape.constant(Array3::from_shape_fn((1, 1, 4), |(_, _, j)| [0.0, 0.0, 0.0, 6.0][j]));
    let y = tape.constant(Array3::zeros((1, 1, 4)));
    let ones = tape.constant(Array3::ones((1, 1, 4)));
    let of = |scales| depth_gradients(x, y, ones, scales, DepthMean::Pixels).item();
    assert_eq!([of(0), of(1), of(2)], [0.0, 6.0 / 4.0, 6.0 / 4.0]);
    // Both ends must count.
    let mask = tape.constant(Array3::from_shape_fn((1, 1, 4), |(_, _, j)| f64::from(j != 3)));
    assert_eq!(depth_gradients(x, y, mask, 2, DepthMean::Pixels).item(), 0.0);
}

#[test]
fn the_furthest_fifth_is_left_out() {
    let tape = Tape::<f64>::train(0);
    let away = [1.0, -1.0, 2.0, 100.0, -3.0];
    let x = tape.leaf(Array3::from_shape_fn((1, 1, 5), |(_, _, j)| away[j]));
    let (y, mask) =
        (tape.constant(Array3::zeros((1, 1, 5))), tape.constant(Array3::ones((1, 1, 5))));
    let loss = depth_l1_trimmed(x, y, mask, 0.2, DepthMean::Pixels);
    assert_relative_eq!(loss.item(), 7.0 / 10.0, epsilon = 1e-12);
    let gradient = loss.backward();
    let gradient = gradient.wrt(x).expect("a leaf");
    assert_eq!(gradient.as_slice(), [0.1, -0.1, 0.1, 0.0, -0.1]);
}

#[test]
fn what_is_not_a_number_is_neither_trimmed_nor_a_hole() {
    let tape = Tape::<f64>::eval();
    let of = |bad: usize| {
        tape.constant(Array3::from_shape_fn(
            (1, 1, 5),
            |(_, _, j)| if j == bad { f64::NAN } else { 1.0 },
        ))
    };
    let (good, mask) = (of(9), tape.constant(Array3::ones((1, 1, 5))));
    assert!(depth_l1_trimmed(of(2), good, mask, 0.2, DepthMean::Pixels).item().is_nan());
    assert!(log_depth(good, of(2), mask, 0.5, DepthMean::Pixels).item().is_nan());
    assert_eq!(log_depth(good, good, mask, 0.5, DepthMean::Pixels).item(), 0.0);
}

#[test]
#[should_panic(expected = "depth_l2: images of one shape and one channel expected")]
fn shapes_must_agree() {
    let tape = Tape::<f32>::eval();
    let x = tape.constant(Array3::zeros((1, 2, 3)));
    let _ = depth_l2(x, x, tape.constant(Array3::zeros((1, 3, 2))), DepthMean::Pixels);
}
