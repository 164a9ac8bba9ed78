//! Image losses value by value: L1 and L2, on the whole image or weighted by a mask.

use autodiff_lite::{Backward, CONTIGUOUS, Op, Real, ShapeError, Var};

use crate::kernels::compare;
use crate::scalar::{same_shape, scalar, seed};

/// Mean absolute difference, `mean(w |a - b|)`.
///
/// The mean is over all values, also where the weight is zero: the form of DIB-R, whose gradient does not
/// grow when the object is small. Without a mask `w = 1`; the common background then counts as right.
///
/// # Shapes
/// `image` and `target` of one shape, `[N, H, W, C]` usually; `mask` has the same axes without the last,
/// or with a last axis of one → a scalar.
/// # Gradient
/// To all inputs that want one; zero where the values are equal.
/// # Cost
/// Two reads of the image forward; backward reads it again rather than keeping a copy.
/// # Panics
/// If the shapes do not fit.
///
/// ```
/// use autodiff_lite::Tape;
/// let tape = Tape::<f32>::train(0);
/// let image = tape.leaf(ndarray::arr1(&[0.2, 0.9]));
/// let target = tape.constant(ndarray::arr1(&[0.5, 0.5]));
/// let loss = losses::l1(image, target, None);
/// assert!((loss.item() - 0.35).abs() < 1e-6);
/// assert_eq!(loss.backward().wrt(image).unwrap().as_slice(), Some(&[-0.5, 0.5][..]));
/// ```
#[track_caller]
pub fn l1<'t, F: Real>(
    image: Var<'t, F>,
    target: Var<'t, F>,
    mask: Option<Var<'t, F>>,
) -> Var<'t, F> {
    compare(Distance::Absolute, image, target, mask)
}

/// Mean squared difference, `mean(w (a - b)²)`.
///
/// Shapes, weights, gradient and cost as in [`l1`]. On soft masks this is the mask loss of MCMR.
///
/// # Panics
/// If the shapes do not fit.
#[track_caller]
pub fn l2<'t, F: Real>(
    image: Var<'t, F>,
    target: Var<'t, F>,
    mask: Option<Var<'t, F>>,
) -> Var<'t, F> {
    compare(Distance::Squared, image, target, mask)
}

#[derive(Clone, Copy, Debug)]
enum Distance {
    Absolute,
    Squared,
}

/// Binds `$f(a, b)` to the distance and `$slope(a, b)` to its derivative by `a`, both inlined.
macro_rules! with_distance {
    ($distance:expr, |$f:ident, $slope:ident| $body:expr) => {
        match $distance {
            Distance::Absolute => {
                let $f = |a: F, b: F| (a - b).abs();
                let $slope = |a: F, b: F| {
                    let one = |yes: bool| if yes { F::one() } else { F::zero() };
                    one(a > b) - one(a < b)
                };
                let _ = (&$f, &$slope);
                $body
            }
            Distance::Squared => {
                let $f = |a: F, b: F| (a - b) * (a - b);
                let $slope = |a: F, b: F| (a - b) + (a - b);
                let _ = (&$f, &$slope);
                $body
            }
        }
    };
}

#[track_caller]
fn compare<'t, F: Real>(
    distance: Distance,
    image: Var<'t, F>,
    target: Var<'t, F>,
    mask: Option<Var<'t, F>>,
) -> Var<'t, F> {
    let op =
        ImageLoss { distance, channels: mask.map_or(1, |m| channels(distance.name(), image, m)) };
    same_shape(distance.name(), ["image", "target"], image, target);
    let (a, b) = (image.value(), target.value());
    let (a, b) = (a.as_slice().expect(CONTIGUOUS), b.as_slice().expect(CONTIGUOUS));
    let total = with_distance!(distance, |f, slope| match mask {
        None => compare::sum(a, b, f),
        Some(mask) => {
            let mask = mask.value();
            compare::weighted_sum(a, b, mask.as_slice().expect(CONTIGUOUS), op.channels, f)
        }
    });
    let tape = image.tape();
    let value = scalar(tape, total / a.len().max(1) as f64);
    match mask {
        None => tape.record(&[image, target], value, op),
        Some(mask) => tape.record(&[image, target, mask], value, op),
    }
}

/// How many values of the image lie under one value of the mask.
#[track_caller]
fn channels<F: Real>(op: &'static str, image: Var<'_, F>, mask: Var<'_, F>) -> usize {
    let (x, m) = (image.shape(), mask.shape());
    let leading = &x[..x.len().saturating_sub(1)];
    let one_channel = m.split_last().is_some_and(|(&last, rest)| last == 1 && rest == leading);
    if m == leading || one_channel {
        x.last().copied().unwrap_or(1)
    } else if m == x {
        1
    } else {
        ShapeError::new(op, "the mask does not fit the image")
            .operand("image", &x, "")
            .operand("mask", &m, "")
            .at(image.tape().path())
            .panic()
    }
}

impl Distance {
    fn name(self) -> &'static str {
        match self {
            Self::Absolute => "l1",
            Self::Squared => "l2",
        }
    }
}

struct ImageLoss {
    distance: Distance,
    channels: usize,
}

impl<F: Real> Op<F> for ImageLoss {
    fn name(&self) -> &'static str {
        self.distance.name()
    }

    fn pullback(&self, cx: &mut Backward<'_, F>) {
        let (a, b) = (cx.input(0), cx.input(1));
        let (x, y) = (a.as_slice().expect(CONTIGUOUS), b.as_slice().expect(CONTIGUOUS));
        let mask = (cx.input_count() == 3).then(|| cx.input(2));
        let scale = seed(cx) / F::from_f64(x.len().max(1) as f64);
        for i in 0..2 {
            if !cx.needs(i) {
                continue;
            }
            let mut gradient = cx.array(a.shape());
            let out = gradient.as_slice_mut().expect(CONTIGUOUS);
            let scale = if i == 0 { scale } else { -scale };
            with_distance!(self.distance, |f, slope| match &mask {
                None => compare::slopes(x, y, scale, out, slope),
                Some(mask) => {
                    let mask = mask.as_slice().expect(CONTIGUOUS);
                    compare::weighted_slopes(x, y, mask, self.channels, scale, out, slope);
                }
            });
            cx.give(i, gradient);
        }
        if let Some(mask) = mask
            && cx.needs(2)
        {
            let mut gradient = cx.array(mask.shape());
            let out = gradient.as_slice_mut().expect(CONTIGUOUS);
            with_distance!(self.distance, |f, slope| {
                compare::pixel_sums(x, y, self.channels, scale, out, f);
            });
            cx.give(2, gradient);
        }
    }
}
