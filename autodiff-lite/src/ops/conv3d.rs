//! Convolution over three axes: sums of convolutions over two.

use std::ops::Range;

use crate::kernels::activation::Activation;
use crate::kernels::conv::{Conv, ConvAlgorithm, ConvGeometry, ConvSizes};
use crate::kernels::elementwise;
use crate::{Backward, Pool, Real, Tensor, Var};

use super::linear::{before_activation, check_activation, give_bias};

/// Stride, padding and dilation of a convolution over three axes, each as (slices, rows, columns).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Conv3dGeometry {
    /// Voxels between the windows of neighbouring outputs; at least 1.
    pub stride: [usize; 3],
    /// Zeros on each side of the input.
    pub padding: [usize; 3],
    /// Voxels between the taps of a window; at least 1.
    pub dilation: [usize; 3],
    /// Which algorithm may run on the slices.
    pub algorithm: ConvAlgorithm,
}

impl Default for Conv3dGeometry {
    fn default() -> Self {
        Self { stride: [1; 3], padding: [0; 3], dilation: [1; 3], algorithm: ConvAlgorithm::Auto }
    }
}

impl Conv3dGeometry {
    /// Stride 1, no padding, no dilation.
    pub fn new() -> Self {
        Self::default()
    }

    /// The same stride along all axes.
    #[must_use]
    pub fn stride(self, stride: usize) -> Self {
        Self { stride: [stride; 3], ..self }
    }

    /// The same padding on all six sides.
    #[must_use]
    pub fn padding(self, padding: usize) -> Self {
        Self { padding: [padding; 3], ..self }
    }

    /// The same dilation along all axes.
    #[must_use]
    pub fn dilation(self, dilation: usize) -> Self {
        Self { dilation: [dilation; 3], ..self }
    }

    /// Along the slices alone, or along rows and columns.
    fn plane(&self, axes: [usize; 2]) -> ConvGeometry {
        ConvGeometry {
            stride: axes.map(|k| self.stride[k]),
            padding: axes.map(|k| self.padding[k]),
            dilation: axes.map(|k| self.dilation[k]),
            algorithm: self.algorithm,
        }
    }
}

impl<F: Real> Var<'_, F> {
    /// Convolution over three axes; the formula is that of [`conv2d`](Self::conv2d) with one axis more.
    ///
    /// # Shapes
    /// `self [N, D, H, W, C]`, `weight [O, C, KD, KH, KW]` (PyTorch's layout), `bias [O]` → `[N, D', H', W', O]`.
    ///
    /// # Cost
    /// For each of the KD slices of the window one convolution over two axes of all slices of the input that it meets,
    /// with the kernels of [`conv2d`](Self::conv2d), and a sum. Where the stride along the slices is 1 these are as many
    /// images at once as there are slices, else one at a time.
    ///
    /// # Panics
    /// If sizes differ, or the window does not fit the padded input.
    #[track_caller]
    #[inline(never)]
    pub fn conv3d(
        self,
        weight: Self,
        bias: Option<Self>,
        geometry: Conv3dGeometry,
        activation: Activation,
    ) -> Self {
        check_activation(self.tape, "conv3d", activation);
        let (x, w, b) = (self.value(), weight.value(), bias.map(Self::value));
        if geometry.stride.contains(&0) || geometry.dilation.contains(&0) {
            let operands = [("input", x.shape(), "N, D, H, W, C"), ("weight", w.shape(), "")];
            self.tape.refuse("conv3d", "a stride or a dilation of 0", &operands);
        }
        let sizes = self.tape.check("conv3d", |shapes| {
            let xs = shapes.axes("input", x.shape(), ["N", "D", "H", "W", "C"])?;
            let ws = shapes.axes("weight", w.shape(), ["O", "C", "KD", "KH", "KW"])?;
            if let Some(b) = &b {
                shapes.axes("bias", b.shape(), ["O"])?;
            }
            Sizes::new(xs, ws, geometry)
                .ok_or_else(|| shapes.error("the window does not fit the padded input"))
        });
        let mut y = self.tape.array(&sizes.output_shape());
        let pool = self.tape.pool();
        sizes.forward(pool, x.as_slice(), w.as_slice(), y.as_slice_mut());
        if let Some(b) = &b {
            for voxel in y.as_slice_mut().chunks_exact_mut(b.len().max(1)) {
                elementwise::add_to(b.as_slice(), voxel);
            }
        }
        activation.apply_all(y.as_slice_mut());
        let mut inputs = vec![self, weight];
        inputs.extend(bias);
        self.tape.record_fn("conv3d", &inputs, y, move |cx: &mut Backward<'_, F>| {
            let g = before_activation(cx, activation);
            let (x, w, pool) = (cx.input(0), cx.input(1), cx.pool().clone());
            let [x, w] = [&x, &w].map(Tensor::as_slice);
            cx.give_with(0, |gx| sizes.grad_input(&pool, g.as_slice(), w, gx));
            cx.give_with(1, |gw| sizes.grad_weight(&pool, x, g.as_slice(), gw));
            give_bias(cx, 2, g.as_slice());
            cx.recycle(g);
        })
    }
}

/// All sizes of one convolution.
#[derive(Clone, Copy)]
struct Sizes {
    batch: usize,
    /// Slices of the input, of the output, of the window.
    slices: [usize; 3],
    /// Along rows and columns, of one slice.
    plane: ConvSizes,
    geometry: Conv3dGeometry,
}

/// Slices of one image that a slice of the window takes from the input to the output.
struct Run {
    input: Range<usize>,
    output: Range<usize>,
}

impl Sizes {
    fn new(
        [n, d, h, w, c]: [usize; 5],
        [o, i, kd, kh, kw]: [usize; 5],
        geometry: Conv3dGeometry,
    ) -> Option<Self> {
        let plane = ConvSizes::new([1, h, w, c], [o, i, kh, kw], &geometry.plane([1, 2]))?;
        let deep = geometry.plane([0, 0]).output_size(0, d, kd)?;
        Some(Self { batch: n, slices: [d, deep, kd], plane, geometry })
    }

    fn output_shape(&self) -> [usize; 5] {
        let [rows, columns] = self.plane.output;
        [self.batch, self.slices[1], rows, columns, self.plane.out_channels]
    }

    fn conv(&self, slices: usize) -> Conv {
        Conv::new(ConvSizes { batch: slices, ..self.plane }, self.geometry.algorithm)
    }

    /// What slice `k` of the window does, in the order of images and slices.
    fn runs(&self, k: usize) -> Vec<Run> {
        let [input, output, _] = self.slices;
        let [stride, padding, dilation] =
            [self.geometry.stride[0], self.geometry.padding[0], self.geometry.dilation[0]];
        let from = |out: usize| {
            (out * stride + k * dilation).checked_sub(padding).filter(|&slice| slice < input)
        };
        let mut runs: Vec<Run> = Vec::new();
        for n in 0..self.batch {
            let first = runs.len();
            for out in 0..output {
                let Some(slice) = from(out) else { continue };
                let (slice, out) = (n * input + slice, n * output + out);
                match runs[first..].last_mut() {
                    Some(run) if run.input.end == slice && run.output.end == out => {
                        (run.input.end, run.output.end) = (slice + 1, out + 1);
                    }
                    _ => runs.push(Run { input: slice..slice + 1, output: out..out + 1 }),
                }
            }
        }
        runs
    }

    /// Slice `k` of the window, `[O, C, KH, KW]`.
    fn window<F: Real>(&self, w: &[F], k: usize, out: &mut [F]) {
        let size = self.plane.kernel[0] * self.plane.kernel[1];
        let whole = size * self.slices[2];
        for (from, to) in w.chunks_exact(whole.max(1)).zip(out.chunks_exact_mut(size.max(1))) {
            to.copy_from_slice(&from[k * size..(k + 1) * size]);
        }
    }

    fn forward<F: Real>(&self, pool: &Pool, x: &[F], w: &[F], y: &mut [F]) {
        let (from, to) = (self.plane.input_len(), self.plane.output_len());
        let mut window = pool.vec(self.plane.weight_len());
        y.fill(F::zero());
        for k in 0..self.slices[2] {
            self.window(w, k, &mut window);
            for Run { input, output } in self.runs(k) {
                let conv = self.conv(input.len());
                let mut part = pool.vec(output.len() * to);
                let mut scratch = pool.vec(conv.forward_scratch::<F>());
                let x = &x[input.start * from..input.end * from];
                conv.forward(x, &window, None, Activation::None, &mut part, &mut scratch);
                elementwise::add_to(&part, &mut y[output.start * to..output.end * to]);
            }
        }
    }

    fn grad_input<F: Real>(&self, pool: &Pool, gy: &[F], w: &[F], gx: &mut [F]) {
        let (to, from) = (self.plane.input_len(), self.plane.output_len());
        let mut window = pool.vec(self.plane.weight_len());
        gx.fill(F::zero());
        for k in 0..self.slices[2] {
            self.window(w, k, &mut window);
            for Run { input, output } in self.runs(k) {
                let conv = self.conv(input.len());
                let mut part = pool.vec(input.len() * to);
                let mut scratch = pool.vec(conv.grad_input_scratch::<F>());
                let gy = &gy[output.start * from..output.end * from];
                conv.grad_input(gy, &window, None, Activation::None, &mut part, &mut scratch);
                elementwise::add_to(&part, &mut gx[input.start * to..input.end * to]);
            }
        }
    }

    fn grad_weight<F: Real>(&self, pool: &Pool, x: &[F], gy: &[F], gw: &mut [F]) {
        let (from, to) = (self.plane.input_len(), self.plane.output_len());
        let size = self.plane.kernel[0] * self.plane.kernel[1];
        let whole = (size * self.slices[2]).max(1);
        let mut part = pool.vec(self.plane.weight_len());
        gw.fill(F::zero());
        for k in 0..self.slices[2] {
            for Run { input, output } in self.runs(k) {
                let conv = self.conv(input.len());
                let mut scratch = pool.vec(conv.grad_weight_scratch::<F>());
                let x = &x[input.start * from..input.end * from];
                let gy = &gy[output.start * to..output.end * to];
                conv.grad_weight(x, gy, &mut part, &mut scratch);
                let windows = gw.chunks_exact_mut(whole).zip(part.chunks_exact(size.max(1)));
                for (window, part) in windows {
                    elementwise::add_to(part, &mut window[k * size..(k + 1) * size]);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Tape;
    use crate::testkit::gradcheck;
    use ndarray::{Array5, arr1};

    const SAME: Activation = Activation::None;

    gradcheck!(one_voxel: |x, w| x.conv3d(w, None, Conv3dGeometry::new(), SAME),
        shapes [[[1, 1, 1, 1, 1], [1, 1, 1, 1, 1]], [[2, 3, 2, 2, 3], [4, 3, 1, 1, 1]]]);
    gradcheck!(with_bias: |x, w, b| x.conv3d(w, Some(b), Conv3dGeometry::new().padding(1), Activation::Tanh),
        shapes [[[1, 3, 4, 2, 2], [3, 2, 3, 3, 3], [3]], [[2, 2, 3, 3, 1], [1, 1, 2, 3, 2], [1]]]);
    gradcheck!(strided: |x, w| x.conv3d(w, None, Conv3dGeometry::new().stride(2).padding(1), SAME),
        shapes [[[2, 5, 4, 3, 2], [2, 2, 3, 3, 3]]]);
    gradcheck!(dilated: |x, w| x.conv3d(w, None, Conv3dGeometry { stride: [1, 2, 1], padding: [2, 0, 1], dilation: [2, 1, 3], ..Conv3dGeometry::new() }, SAME),
        shapes [[[1, 4, 5, 6, 1], [2, 1, 2, 2, 2]]]);

    /// A window of ones sums the neighbourhood of 27.
    #[test]
    fn values_by_hand() {
        let tape = Tape::<f32>::eval();
        let x = tape.constant(Array5::ones((1, 3, 3, 3, 1)));
        let w = tape.constant(Array5::ones((1, 1, 3, 3, 3)));
        let b = tape.constant(arr1(&[-20.0]));
        let y = x.conv3d(w, Some(b), Conv3dGeometry::new().padding(1), Activation::Relu).value();
        assert_eq!((y[[0, 1, 1, 1, 0]], y[[0, 0, 1, 1, 0]]), (7.0, 0.0));
        assert_eq!(x.conv3d(w, None, Conv3dGeometry::new(), SAME).value().as_slice(), [27.0]);
    }

    #[test]
    #[should_panic(expected = "conv3d: the window does not fit the padded input")]
    fn the_window_must_fit() {
        let tape = Tape::<f32>::eval();
        let x = tape.constant(Array5::zeros((1, 2, 5, 5, 1)));
        let _ = x.conv3d(
            tape.constant(Array5::zeros((1, 1, 3, 3, 3))),
            None,
            Conv3dGeometry::new(),
            SAME,
        );
    }
}
