//! Structural similarity as a loss.

use autodiff_lite::{Backward, CONTIGUOUS, Op, PoolVec, Real, Shapes, Var};

use crate::kernels::ssim::{self, Plane, SLOPES};
use crate::scalar::{same_shape, scalar, seed};

/// One minus the mean structural similarity: 0 for equal images.
///
/// ```text
/// S = (2 μx μy + C1) (2 σxy + C2) / ((μx² + μy² + C1) (σx² + σy² + C2)),     C1 = 1e-4, C2 = 9e-4
/// ```
///
/// with means and covariances under an 11 x 11 Gaussian window of standard deviation 1.5 and zero
/// padding, averaged over all pixels and channels; for values in `[0, 1]`.
///
/// # Shapes
/// `image` and `target` `[N, H, W, C]` → a scalar.
/// # Gradient
/// To both inputs.
/// # Cost
/// Two passes of five windows forward; four image-sized buffers are kept for backward.
/// # Panics
/// If the shapes differ or have not four axes.
/// # References
/// Wang, Bovik, Sheikh, Simoncelli 2004, *Image Quality Assessment: From Error Visibility to Structural
/// Similarity*.
#[track_caller]
pub fn ssim_loss<'t, F: Real>(image: Var<'t, F>, target: Var<'t, F>) -> Var<'t, F> {
    let name = "ssim_loss";
    let tape = image.tape();
    same_shape(name, ["image", "target"], image, target);
    let axes = Shapes::of(name).at(tape.path()).axes("image", &image.shape(), ["N", "H", "W", "C"]);
    let [images, height, width, channels] = axes.unwrap_or_else(|error| error.panic());
    let plane = Plane { images, height, width, channels };
    let (x, y) = (image.value(), target.value());
    let mut slopes = tape.wants_grad(&[image, target]).then(|| tape.buffer(SLOPES * plane.len()));
    let similarity = if plane.is_empty() {
        1.0
    } else {
        let mut scratch = tape.buffer(plane.scratch_len());
        let (x, y) = (x.as_slice().expect(CONTIGUOUS), y.as_slice().expect(CONTIGUOUS));
        ssim::ssim(x, y, plane, &mut scratch, slopes.as_deref_mut())
    };
    tape.record(&[image, target], scalar(tape, 1.0 - similarity), SsimLoss { plane, slopes })
}

struct SsimLoss<F: Real> {
    plane: Plane,
    slopes: Option<PoolVec<F>>,
}

impl<F: Real> Op<F> for SsimLoss<F> {
    fn name(&self) -> &'static str {
        "ssim_loss"
    }

    fn pullback(&self, cx: &mut Backward<'_, F>) {
        let Some(slopes) = self.slopes.as_deref().filter(|_| !self.plane.is_empty()) else {
            return;
        };
        let inputs = [cx.input(0), cx.input(1)];
        let scale = -seed(cx) / F::from_f64(self.plane.len() as f64);
        let mut scratch = cx.scratch(self.plane.scratch_len());
        for i in 0..2 {
            if cx.needs(i) {
                let mut gradient = cx.array(inputs[i].shape());
                ssim::ssim_grad(
                    inputs[i].as_slice().expect(CONTIGUOUS),
                    inputs[1 - i].as_slice().expect(CONTIGUOUS),
                    self.plane,
                    slopes,
                    i,
                    scale,
                    &mut scratch,
                    gradient.as_slice_mut().expect(CONTIGUOUS),
                );
                cx.give(i, gradient);
            }
        }
    }
}
