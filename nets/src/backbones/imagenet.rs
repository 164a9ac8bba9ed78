//! What images are before networks that were trained on ImageNet see them.

use autodiff_lite::{Real, Var};
use ndarray::Array1;

/// Mean of the red, green and blue of ImageNet's images in `[0, 1]`, as torchvision's weights expect them.
pub const IMAGENET_MEAN: [f32; 3] = [0.485, 0.456, 0.406];
/// Standard deviation of the same.
pub const IMAGENET_DEVIATION: [f32; 3] = [0.229, 0.224, 0.225];

/// Images with ImageNet's mean and deviation taken out: `(x - mean) · (1 / deviation)`, which torchvision's weights expect.
///
/// ```
/// use autodiff_lite::Tape;
/// use nets::{IMAGENET_MEAN, imagenet_normalized};
///
/// let tape = Tape::eval();
/// let [r, g, b] = IMAGENET_MEAN;
/// let image = tape.constant(ndarray::arr1(&[r, g + 0.224, b]).into_shape_with_order((1, 1, 1, 3))?);
/// let normal = imagenet_normalized(image).value();
/// assert!(normal.iter().zip([0.0, 1.0, 0.0]).all(|(x, y)| (x - y).abs() < 1e-6));
/// # Ok::<(), ndarray::ShapeError>(())
/// ```
///
/// # Shapes
/// `images [.., 3]` in `[0, 1]`, red, green, blue → the same.
///
/// # Panics
/// If the last axis is not of three.
#[track_caller]
pub fn imagenet_normalized<F: Real>(images: Var<'_, F>) -> Var<'_, F> {
    let tape = images.tape();
    let row = |values: [f32; 3]| {
        tape.constant(Array1::from(values.map(|x| F::from_f64(f64::from(x))).to_vec()))
    };
    (images - row(IMAGENET_MEAN)) * row(IMAGENET_DEVIATION.map(f32::recip))
}
