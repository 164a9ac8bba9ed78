//! Losses between images, masks and depth maps.

use autodiff_lite::Shapes;
use losses::{DepthMean, Robustness, ScaleShiftInvariant};
use pyo3::prelude::*;

use crate::arrays::{Floats, whole};
use crate::error;
use crate::recorded::{Arguments, Recorded, fits, record};
use crate::wanted::Wanted;

/// Checks that two arrays are alike.
fn check_alike(op: &'static str, [a, b]: [(&str, &Floats<'_>); 2]) -> PyResult<()> {
    if a.1.shape() == b.1.shape() {
        return Ok(());
    }
    let error =
        autodiff_lite::ShapeError::new(op, format!("{} and {} of one shape expected", a.0, b.0));
    Err(error::value(error.operand(a.0, a.1.shape(), "").operand(b.0, b.1.shape(), "")))
}

/// Checks that two arrays are masks: of bytes up to 255 the losses would be numbers too, but wrong ones.
fn check_units(op: &str, masks: [(&str, &Floats<'_>); 2]) -> PyResult<()> {
    masks.iter().try_for_each(|(name, mask)| mask.check_unit(&format!("{op}: {name}")))
}

/// Checks an image, a target, and a mask that is like the image, or has a single channel or none.
fn check_masked(
    op: &'static str,
    image: &Floats<'_>,
    target: &Floats<'_>,
    mask: Option<&Floats<'_>>,
) -> PyResult<()> {
    check_alike(op, [("image", image), ("target", target)])?;
    let Some(mask) = mask else { return Ok(()) };
    let (x, m) = (image.shape(), mask.shape());
    let leading = &x[..x.len().saturating_sub(1)];
    let one = m.split_last().is_some_and(|(&last, rest)| last == 1 && rest == leading);
    if m == x || m == leading || one {
        return Ok(());
    }
    let error = autodiff_lite::ShapeError::new(op, "the mask does not fit the image");
    Err(error::value(error.operand("image", x, "").operand("mask", m, "")))
}

/// Differences weighed by a mask where there is one: each with its docstring, and the function of the tape behind it.
macro_rules! masked_losses {
    ($($(#[$docs:meta])* $name:ident;)+) => {$(
        $(#[$docs])*
        #[pyfunction]
        #[pyo3(signature = (image, target, mask=None, *, wrt=None))]
        pub(crate) fn $name(
            py: Python<'_>,
            image: Floats<'_>,
            target: Floats<'_>,
            mask: Option<Floats<'_>>,
            wrt: Option<Wanted>,
        ) -> PyResult<Recorded> {
            let op = stringify!($name);
            check_masked(op, &image, &target, mask.as_ref())?;
            let [x, y] = [("image", &image), ("target", &target)];
            match &mask {
                None => record!(py, Arguments::new(op, [x, y], wrt.as_ref())?, |x, y| {
                    losses::$name(x, y, None)
                }),
                Some(mask) => {
                    let inputs = [x, y, ("mask", mask)];
                    record!(py, Arguments::new(op, inputs, wrt.as_ref())?, |x, y, mask| {
                        losses::$name(x, y, Some(mask))
                    })
                }
            }
        }
    )+};
}

masked_losses! {
    /// The mean absolute difference, weighed by a mask where there is one.
    ///
    /// image, target: any shape, alike. mask: like the image, or without its channels. The mean is over all values. Value: a float.
    /// Gradients: image, target, mask; at equal values 0.
    l1;
    /// The mean squared difference, weighed by a mask where there is one.
    ///
    /// image, target: any shape, alike. mask: like the image, or without its channels. The mean is over all values. Value: a float.
    /// Gradients: image, target, mask.
    l2;
}

/// 1 - SSIM, with a Gaussian window of 11 x 11 and standard deviation 1.5, values in [0, 1].
///
/// image, target: [N, H, W, C], alike. valid: only pixels whose window lies within the image count (scikit-image's mean with
/// gaussian_weights); else borders are padded with 0. Value: a float. Gradients: image, target.
#[pyfunction]
#[pyo3(signature = (image, target, *, valid=false, wrt=None))]
pub(crate) fn ssim_loss(
    py: Python<'_>,
    image: Floats<'_>,
    target: Floats<'_>,
    valid: bool,
    wrt: Option<Wanted>,
) -> PyResult<Recorded> {
    let op = "ssim_loss";
    check_alike(op, [("image", &image), ("target", &target)])?;
    let mut shapes = Shapes::of(op);
    let [_, h, w, _] = fits(shapes.axes("image", image.shape(), ["N", "H", "W", "C"]))?;
    if valid && h.min(w) < 11 {
        return Err(error::value(shapes.error("no window of 11 pixels lies within the image")));
    }
    let inputs = [("image", &image), ("target", &target)];
    record!(py, Arguments::new(op, inputs, wrt.as_ref())?, |image, target| {
        if valid {
            losses::ssim_loss_valid(image, target)
        } else {
            losses::ssim_loss(image, target)
        }
    })
}

/// 1 - intersection over union of soft masks, averaged over the images: kaolin's `mask_iou`.
///
/// prediction, target: [N, ...] in [0, 1], alike. Value: a float. Gradients: prediction, target. Raises ValueError for values outside.
#[pyfunction]
#[pyo3(signature = (prediction, target, *, wrt=None))]
pub(crate) fn mask_iou(
    py: Python<'_>,
    prediction: Floats<'_>,
    target: Floats<'_>,
    wrt: Option<Wanted>,
) -> PyResult<Recorded> {
    let inputs = [("prediction", &prediction), ("target", &target)];
    check_alike("mask_iou", inputs)?;
    if prediction.shape().is_empty() {
        return Err(error::value("mask_iou: a batch axis expected, found a single number"));
    }
    check_units("mask_iou", inputs)?;
    record!(py, Arguments::new("mask_iou", inputs, wrt.as_ref())?, |prediction, target| {
        losses::mask_iou(prediction, target)
    })
}

/// The mean binary cross entropy of masks.
///
/// prediction, target: in [0, 1], alike. Value: a float. Gradient: prediction. Raises ValueError for values outside.
#[pyfunction]
#[pyo3(signature = (prediction, target, *, wrt=None))]
pub(crate) fn mask_bce(
    py: Python<'_>,
    prediction: Floats<'_>,
    target: Floats<'_>,
    wrt: Option<Wanted>,
) -> PyResult<Recorded> {
    let inputs = [("prediction", &prediction), ("target", &target)];
    check_alike("mask_bce", inputs)?;
    check_units("mask_bce", inputs)?;
    record!(py, Arguments::leading(1, "mask_bce", inputs, wrt.as_ref())?, |prediction, target| {
        losses::mask_bce(prediction, target)
    })
}

/// Checks a depth map, its target and its mask.
fn check_depth(op: &'static str, [a, b, mask]: [(&str, &Floats<'_>); 3]) -> PyResult<()> {
    check_alike(op, [a, b])?;
    check_alike(op, [a, mask])?;
    if matches!(*a.1.shape(), [_, _, _] | [_, _, _, 1]) {
        return Ok(());
    }
    Err(error::value(format!("{op}: images [N, H, W] expected, found {:?}", a.1.shape())))
}

/// Eigen's loss of the logarithms of depth, which a factor of all depths changes by 1 - weight only.
///
/// prediction, target, mask: [N, H, W], alike; pixels count where the mask is above 1/2. weight: 0.5 is published, 1 ignores the scale.
/// Value: a float. Gradient: prediction.
#[pyfunction]
#[pyo3(signature = (prediction, target, mask, weight=0.5, *, wrt=None))]
pub(crate) fn log_depth(
    py: Python<'_>,
    prediction: Floats<'_>,
    target: Floats<'_>,
    mask: Floats<'_>,
    weight: f64,
    wrt: Option<Wanted>,
) -> PyResult<Recorded> {
    let inputs = [("prediction", &prediction), ("target", &target), ("mask", &mask)];
    check_depth("log_depth", inputs)?;
    record!(
        py,
        Arguments::leading(1, "log_depth", inputs, wrt.as_ref())?,
        |prediction, target, mask| {
            losses::log_depth(prediction, target, mask, weight, DepthMean::Pixels)
        }
    )
}

/// MiDaS's loss between disparities (1 / depth), which scale and shift of the prediction do not change.
///
/// prediction, target, mask: [N, H, W], alike; pixels count where the mask is above 1/2. robust: by median and mean distance, a fifth of the
/// pixels left out, instead of least squares. gradient_weight, scales: of the gradient term. Value: a float. Gradient: prediction.
#[pyfunction]
#[pyo3(signature = (prediction, target, mask, *, robust=false, gradient_weight=0.5, scales=4, wrt=None))]
pub(crate) fn scale_shift_invariant(
    py: Python<'_>,
    prediction: Floats<'_>,
    target: Floats<'_>,
    mask: Floats<'_>,
    robust: bool,
    gradient_weight: f64,
    #[pyo3(from_py_with = whole)] scales: usize,
    wrt: Option<Wanted>,
) -> PyResult<Recorded> {
    let op = "scale_shift_invariant";
    let inputs = [("prediction", &prediction), ("target", &target), ("mask", &mask)];
    check_depth(op, inputs)?;
    if scales >= 32 {
        return Err(error::value(format!("{op}: {scales} scales, expected less than 32")));
    }
    let published = ScaleShiftInvariant::least_squares();
    let robustness = if robust { Robustness::Trimmed { share: 0.2 } } else { published.robustness };
    let loss = ScaleShiftInvariant { robustness, gradient_weight, scales, ..published };
    record!(py, Arguments::leading(1, op, inputs, wrt.as_ref())?, |prediction, target, mask| {
        loss.loss(prediction, target, mask)
    })
}
