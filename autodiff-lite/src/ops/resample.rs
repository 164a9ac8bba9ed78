//! Bilinear resizing and sampling.

use crate::kernels::resample::{self, resize_blends};
use crate::kernels::sampling::{self, Padding, Sampling};
use crate::{Backward, Real, Tensor, Var};

impl<F: Real> Var<'_, F> {
    /// Another size of images: bilinear, without antialiasing, as PyTorch's `interpolate`. With `align_corners` the
    /// outermost pixel centres stay where they are, else the outer edges of the image.
    ///
    /// # Shapes
    /// `[N, H, W, C]` → `[N, height, width, C]`.
    ///
    /// # Panics
    /// If the input has not four axes, or is empty where the output is not.
    #[track_caller]
    #[inline(never)]
    pub fn resize_bilinear(self, height: usize, width: usize, align_corners: bool) -> Self {
        let x = self.value();
        let sizes = self.tape.check("resize_bilinear", |shapes| {
            let sizes = shapes.axes("input", x.shape(), ["N", "H", "W", "C"])?;
            if sizes[1] * sizes[2] == 0 && height * width > 0 {
                return Err(shapes.error("an empty image has no pixels to blend"));
            }
            Ok(sizes)
        });
        let rows = resize_blends::<F>(sizes[1], height, align_corners);
        let columns = resize_blends::<F>(sizes[2], width, align_corners);
        let mut y = self.tape.array(&[sizes[0], height, width, sizes[3]]);
        resample::resize(sizes, &rows, &columns, x.as_slice(), y.as_slice_mut());
        self.tape.record_fn("resize_bilinear", &[self], y, move |cx: &mut Backward<'_, F>| {
            let g = cx.grad_out();
            let g = g.as_slice();
            resample::resize_grad(sizes, &rows, &columns, g, cx.grad_slice_mut(0));
        })
    }

    /// Images at points, bilinear; PyTorch's `grid_sample`.
    ///
    /// Gradients to image and points; kinks where a point crosses a pixel centre.
    ///
    /// # Shapes
    /// `self [N, H, W, C]`, `points [N, P, 2]` → `[N, P, C]`. A point is (x, y), x to the right and y *down*, (-1, -1) the
    /// top left and (1, 1) the bottom right: the centres of the corner pixels with `align_corners`, else the corners of
    /// the image.
    ///
    /// # Panics
    /// If sizes differ.
    #[track_caller]
    #[inline(never)]
    pub fn bilinear_sample(self, points: Self, padding: Padding, align_corners: bool) -> Self {
        let (x, p) = (self.value(), points.value());
        let sampling = self.tape.check("bilinear_sample", |shapes| {
            let image = shapes.axes("input", x.shape(), ["N", "H", "W", "C"])?;
            let [_, count, two] = shapes.axes("points", p.shape(), ["N", "P", "_"])?;
            if two != 2 {
                return Err(shapes.error("points of 2 coordinates expected"));
            }
            Ok(Sampling { image, points: count, padding, align_corners })
        });
        let mut y = self.tape.array(&[sampling.image[0], sampling.points, sampling.image[3]]);
        sampling::sample(&sampling, x.as_slice(), p.as_slice(), y.as_slice_mut());
        let inputs = [self, points];
        self.tape.record_fn("bilinear_sample", &inputs, y, move |cx: &mut Backward<'_, F>| {
            let (x, p, g) = (cx.input(0), cx.input(1), cx.grad_out());
            let [x, p, g] = [&x, &p, &g].map(Tensor::as_slice);
            if cx.needs(0) {
                sampling::sample_grad_image(&sampling, p, g, cx.grad_slice_mut(0));
            }
            if cx.needs(1) {
                sampling::sample_grad_points(&sampling, x, p, g, cx.grad_slice_mut(1));
            }
        })
    }

    /// This plus what several images show at the same points, each read as by [`bilinear_sample`](Self::bilinear_sample).
    ///
    /// One pass an image over the sum, where separate readings would each be written, kept and added. Gradients to
    /// all.
    ///
    /// # Shapes
    /// `self [N, P, C]`, `images [N, H, W, C]` of any `H` and `W` each, `points [N, P, 2]` → `[N, P, C]`.
    ///
    /// # Panics
    /// If sizes differ.
    #[track_caller]
    #[inline(never)]
    pub fn add_bilinear_samples(
        self,
        images: &[Self],
        points: Self,
        padding: Padding,
        align_corners: bool,
    ) -> Self {
        let p = points.value();
        let samplings = self.tape.check("add_bilinear_samples", |shapes| {
            let [_, count, two] = shapes.axes("points", p.shape(), ["N", "P", "_"])?;
            shapes.axes("sum", &self.shape(), ["N", "P", "C"])?;
            if two != 2 {
                return Err(shapes.error("points of 2 coordinates expected"));
            }
            let sampling = |image: &Self| {
                // Sizes of images are their own.
                let shape = image.shape();
                let [n, _, _, c] = shape[..] else {
                    return Err(shapes.clone().error("images of four axes expected"));
                };
                shapes.clone().axes("image", &[n, c], ["N", "C"])?;
                let image = [n, shape[1], shape[2], c];
                Ok(Sampling { image, points: count, padding, align_corners })
            };
            images.iter().map(sampling).collect::<Result<Vec<_>, _>>()
        });
        let mut y = self.tape.array(&self.shape());
        let out = y.as_slice_mut();
        out.copy_from_slice(self.value().as_slice());
        for (sampling, image) in samplings.iter().zip(images) {
            let (x, p) = (image.value(), p.as_slice());
            sampling::sample_add(sampling, x.as_slice(), p, out);
        }
        let mut inputs = vec![self, points];
        inputs.extend(images);
        self.tape.record_fn("add_bilinear_samples", &inputs, y, move |cx: &mut Backward<'_, F>| {
            let (p, whole) = (cx.input(1), cx.take_grad_out());
            let (p, g) = (p.as_slice(), whole.as_slice());
            for (i, sampling) in samplings.iter().enumerate() {
                if cx.needs(2 + i) {
                    sampling::sample_grad_image(sampling, p, g, cx.grad_slice_mut(2 + i));
                }
                if cx.needs(1) {
                    let x = cx.input(2 + i);
                    let x = x.as_slice();
                    sampling::sample_grad_points(sampling, x, p, g, cx.grad_slice_mut(1));
                }
            }
            cx.give(0, whole);
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::Tape;
    use crate::kernels::sampling::Padding;
    use crate::testkit::{Options, gradcheck};
    use ndarray::{Array3, Array4};

    gradcheck!(up: |x| x.resize_bilinear(7, 5, false), shapes [[[2, 3, 4, 3]], [[1, 1, 1, 1]], [[1, 2, 5, 17]]]);
    gradcheck!(down: |x| x.resize_bilinear(2, 3, false), shapes [[[2, 5, 4, 3]], [[1, 7, 1, 1]]]);
    gradcheck!(corners: |x| x.resize_bilinear(5, 1, true), shapes [[[2, 3, 4, 3]], [[1, 1, 1, 1]]]);

    fn kinked() -> Options {
        Options::default().pieces()
    }
    gradcheck!(zeros: |x, p| x.bilinear_sample(p, Padding::Zeros, false),
        shapes [[[2, 3, 4, 3], [2, 9, 2]], [[1, 1, 1, 1], [1, 5, 2]], [[1, 5, 2, 17], [1, 4, 2]]], options kinked());
    gradcheck!(zeros_corners: |x, p| x.bilinear_sample(p, Padding::Zeros, true),
        shapes [[[2, 3, 4, 3], [2, 9, 2]], [[1, 1, 1, 1], [1, 5, 2]]], options kinked());
    gradcheck!(border: |x, p| x.bilinear_sample(p, Padding::Border, false),
        shapes [[[2, 3, 4, 3], [2, 9, 2]], [[1, 1, 1, 1], [1, 5, 2]]], options kinked());
    gradcheck!(several: |y, p, a, b| y.add_bilinear_samples(&[a, b], p, Padding::Border, false),
        shapes [[[2, 9, 3], [2, 9, 2], [2, 3, 4, 3], [2, 2, 2, 3]], [[1, 4, 17], [1, 4, 2], [1, 5, 2, 17], [1, 1, 1, 17]]],
        options kinked());
    gradcheck!(border_corners: |x, p| x.bilinear_sample(p, Padding::Border, true),
        shapes [[[2, 3, 4, 3], [2, 9, 2]]], options kinked());

    fn ramp(h: usize, w: usize) -> Array4<f64> {
        Array4::from_shape_fn((1, h, w, 1), |(_, i, j, _)| (10 * i + j) as f64)
    }

    /// A bilinear reading of a linear ramp is the ramp at the point.
    #[test]
    fn a_ramp_is_read_as_it_is() {
        let tape = Tape::<f64>::eval();
        let x = tape.constant(ramp(4, 6));
        let points = [[-0.3, 0.2], [0.0, 0.0], [0.61, -0.47]];
        let p = Array3::from_shape_fn((1, 3, 2), |(_, k, axis)| points[k][axis]);
        let y = x.bilinear_sample(tape.constant(p.clone()), Padding::Zeros, true).value();
        for (y, [u, v]) in y.iter().zip(points) {
            let (column, row) = ((u + 1.0) * 2.5, (v + 1.0) * 1.5);
            assert!((y - (10.0 * row + column)).abs() < 1e-12);
        }
        let y = x.bilinear_sample(tape.constant(p), Padding::Border, false).value();
        for (y, [u, v]) in y.iter().zip(points) {
            let (column, row) = ((u + 1.0) * 3.0 - 0.5, (v + 1.0) * 2.0 - 0.5);
            assert!((y - (10.0 * row + column)).abs() < 1e-12);
        }
        let y = x.resize_bilinear(7, 11, true).value();
        assert!((y[[0, 3, 5, 0]] - 17.5).abs() < 1e-12);
        let y = x.resize_bilinear(2, 3, false).value();
        assert!((y[[0, 0, 0, 0]] - 5.5).abs() < 1e-12);
    }

    #[test]
    fn an_image_of_no_width_has_no_gradient() {
        let tape = Tape::<f64>::train(0);
        let x = tape.leaf(ramp(4, 6));
        let gradients = x.resize_bilinear(3, 0, false).sum().backward();
        assert!(gradients.wrt(x).is_none_or(|g| g.iter().all(|&g| g == 0.0)));
    }

    #[test]
    fn outside_is_zero_or_the_border() {
        let tape = Tape::<f64>::eval();
        let x = tape.constant(ramp(2, 2));
        let far = [[-9.0, -9.0], [9.0, 9.0], [f64::NAN, 0.0], [-1.0, -1.0]];
        let p = tape.constant(Array3::from_shape_fn((1, 4, 2), |(_, k, axis)| far[k][axis]));
        let zeros = x.bilinear_sample(p, Padding::Zeros, false).value();
        // (-1, -1) is the corner of the image, where a quarter of the first pixel (0) is read.
        assert_eq!(zeros.as_slice(), [0.0, 0.0, 0.0, 0.0]);
        let border = x.bilinear_sample(p, Padding::Border, false).value();
        assert_eq!(border.iter().take(2).copied().collect::<Vec<_>>(), [0.0, 11.0]);
        assert!(border.iter().all(|y| y.is_finite()));
    }
}
