//! Convolution and its transpose, with bias and activation in the same pass.

use crate::kernels::activation::Activation;
use crate::kernels::conv::{Conv, ConvGeometry, ConvSizes};
use crate::{Backward, Real, Tensor, Var};

use super::linear::{before_activation, check_activation, give_bias};

impl<F: Real> Var<'_, F> {
    /// Convolution:
    ///
    /// ```text
    /// y[n,i,j,o] = activation( b[o] + Σ x[n, i s - p + u d, j s - p + v d, c] w[o,c,u,v] )
    /// H' = (H + 2p - d (KH - 1) - 1) / s + 1
    /// ```
    ///
    /// # Shapes
    /// `self [N, H, W, C]`, `weight [O, C, KH, KW]` (PyTorch's layout), `bias [O]` → `[N, H', W', O]`.
    ///
    /// # Cost
    /// `2 N H' W' O C KH KW` flops, each gradient as many; Winograd does a quarter of them where
    /// it pays ([`ConvAlgorithm`](crate::kernels::conv::ConvAlgorithm)). The bench `conv` has
    /// the rates.
    ///
    /// # Panics
    /// If sizes differ, or the window does not fit the padded input.
    #[track_caller]
    #[inline(never)]
    pub fn conv2d(
        self,
        weight: Self,
        bias: Option<Self>,
        geometry: ConvGeometry,
        activation: Activation,
    ) -> Self {
        let axes = ["O", "C", "KH", "KW"];
        let fitting = |x, w| {
            ConvSizes::new(x, w, &geometry).ok_or("the window does not fit the padded input")
        };
        self.convolution(
            "conv2d",
            weight,
            bias,
            axes,
            fitting,
            ConvDirection::Forward,
            geometry,
            activation,
        )
    }

    /// Transposed convolution: the gradient of the input of [`conv2d`](Self::conv2d) with the same weight; it costs
    /// what that costs.
    ///
    /// # Shapes
    /// `self [N, H, W, C]`, `weight [C, O, KH, KW]` (PyTorch's layout), `bias [O]` → `[N, H', W', O]` with
    /// `H' = (H - 1) s - 2p + d (KH - 1) + 1 + output_padding`, and `W'` likewise.
    ///
    /// # Panics
    /// If sizes differ, the output would be empty, or `output_padding` is not below the stride.
    #[track_caller]
    #[inline(never)]
    pub fn conv_transpose2d(
        self,
        weight: Self,
        bias: Option<Self>,
        geometry: ConvGeometry,
        output_padding: usize,
        activation: Activation,
    ) -> Self {
        // The convolution whose input's gradient this is.
        let fitting = |x: [usize; 4], w: [usize; 4]| {
            let size = |axis: usize| {
                geometry.transposed_size(axis, x[1 + axis], w[2 + axis], output_padding)
            };
            size(0)
                .zip(size(1))
                .and_then(|(h, wide)| ConvSizes::new([x[0], h, wide, w[1]], w, &geometry))
                .filter(|s| s.output == [x[1], x[2]])
                .ok_or("no output size belongs to this input, window and padding")
        };
        let (name, axes) = ("conv_transpose2d", ["C", "O", "KH", "KW"]);
        self.convolution(
            name,
            weight,
            bias,
            axes,
            fitting,
            ConvDirection::Transposed,
            geometry,
            activation,
        )
    }

    #[track_caller]
    fn convolution(
        self,
        name: &'static str,
        weight: Self,
        bias: Option<Self>,
        axes: [&'static str; 4],
        fitting: impl Fn([usize; 4], [usize; 4]) -> Result<ConvSizes, &'static str>,
        direction: ConvDirection,
        geometry: ConvGeometry,
        activation: Activation,
    ) -> Self {
        check_activation(self.tape, name, activation);
        let (x, w, b) = (self.value(), weight.value(), bias.map(Self::value));
        if geometry.stride.contains(&0) || geometry.dilation.contains(&0) {
            let operands = [("input", x.shape(), "N, H, W, C"), ("weight", w.shape(), "")];
            self.tape.refuse(name, "a stride or a dilation of 0", &operands);
        }
        let sizes = self.tape.check(name, |shapes| {
            let xs = shapes.axes("input", x.shape(), ["N", "H", "W", "C"])?;
            let ws = shapes.axes("weight", w.shape(), axes)?;
            if let Some(b) = &b {
                shapes.axes("bias", b.shape(), ["O"])?;
            }
            fitting(xs, ws).map_err(|message| shapes.error(message))
        });
        let conv = Conv::new(sizes, geometry.algorithm);
        let mut y = self.tape.array(&direction.output_shape(&sizes));
        direction.run(
            &conv,
            [&x, &w].map(Tensor::as_slice),
            b.as_ref().map(Tensor::as_slice),
            activation,
            y.as_slice_mut(),
            &mut self.tape.buffer(direction.scratch::<F>(&conv)),
        );
        let mut inputs = vec![self, weight];
        inputs.extend(bias);
        self.tape.record_fn(name, &inputs, y, move |cx: &mut Backward<'_, F>| {
            let g = before_activation(cx, activation);
            let grad = g.as_slice();
            let (x, w) = (cx.input(0), cx.input(1));
            if cx.needs(0) {
                let back = direction.back();
                let scratch = &mut cx.scratch(back.scratch::<F>(&conv));
                let operands = [grad, w.as_slice()];
                cx.give_with(0, |gx| {
                    back.run(&conv, operands, None, Activation::None, gx, scratch);
                });
            }
            if cx.needs(1) {
                let scratch = &mut cx.scratch(conv.grad_weight_scratch::<F>());
                let (input, output) = match direction {
                    ConvDirection::Forward => (x.as_slice(), grad),
                    ConvDirection::Transposed => (grad, x.as_slice()),
                };
                cx.give_with(1, |gw| conv.grad_weight(input, output, gw, scratch));
            }
            give_bias(cx, 2, grad);
            cx.recycle(g);
        })
    }
}

/// A convolution, or the gradient of its input: each is the other's gradient.
#[derive(Clone, Copy, PartialEq, Eq)]
enum ConvDirection {
    Forward,
    Transposed,
}

impl ConvDirection {
    fn back(self) -> Self {
        match self {
            Self::Forward => Self::Transposed,
            Self::Transposed => Self::Forward,
        }
    }

    fn output_shape(self, s: &ConvSizes) -> [usize; 4] {
        match self {
            Self::Forward => [s.batch, s.output[0], s.output[1], s.out_channels],
            Self::Transposed => [s.batch, s.input[0], s.input[1], s.in_channels],
        }
    }

    fn scratch<F: Real>(self, conv: &Conv) -> usize {
        match self {
            Self::Forward => conv.forward_scratch::<F>(),
            Self::Transposed => conv.grad_input_scratch::<F>(),
        }
    }

    fn run<F: Real>(
        self,
        conv: &Conv,
        [x, w]: [&[F]; 2],
        bias: Option<&[F]>,
        activation: Activation,
        y: &mut [F],
        scratch: &mut [F],
    ) {
        match self {
            Self::Forward => conv.forward(x, w, bias, activation, y, scratch),
            Self::Transposed => conv.grad_input(x, w, bias, activation, y, scratch),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::kernels::activation::Activation;
    use crate::kernels::conv::ConvGeometry;
    use crate::testkit::{self, Options, gradcheck};
    use crate::{Tape, Var};
    use proptest::prelude::*;

    const SAME: Activation = Activation::None;

    #[test]
    #[should_panic(expected = "conv2d: a stride or a dilation of 0")]
    fn windows_move() {
        let tape = crate::Tape::<f32>::eval();
        let x = tape.constant(ndarray::Array4::<f32>::zeros((1, 4, 4, 2)));
        let w = tape.constant(ndarray::Array4::<f32>::zeros((3, 2, 1, 1)));
        let _ = x.conv2d(w, None, ConvGeometry::new().stride(0), Activation::None);
    }

    gradcheck!(one_pixel: |x, w| x.conv2d(w, None, ConvGeometry::new(), SAME),
        shapes [[[1, 1, 1, 1], [1, 1, 1, 1]], [[2, 3, 2, 3], [17, 3, 1, 1]]]);
    gradcheck!(with_bias: |x, w, b| x.conv2d(w, Some(b), ConvGeometry::new().padding(1), Activation::Tanh),
        shapes [[[1, 5, 4, 3], [2, 3, 3, 3], [2]], [[2, 3, 3, 1], [1, 1, 3, 3], [1]]]);
    gradcheck!(transposed: |x, w, b| x.conv_transpose2d(w, Some(b), ConvGeometry::new().stride(2).padding(1), 1, Activation::Sigmoid),
        shapes [[[1, 3, 4, 2], [2, 3, 3, 3], [3]], [[2, 1, 1, 1], [1, 1, 4, 4], [1]]]);

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        #[test]
        fn any_geometry(
            n in 1usize..3, h in 1usize..8, w in 1usize..8,
            c in prop::sample::select(vec![1usize, 3, 17]), o in prop::sample::select(vec![1usize, 3, 17]),
            kernel in (1usize..4, 1usize..4), stride in (1usize..4, 1usize..4),
            padding in (0usize..3, 0usize..3), dilation in (1usize..3, 1usize..3),
        ) {
            let geometry = ConvGeometry {
                stride: [stride.0, stride.1],
                padding: [padding.0, padding.1],
                dilation: [dilation.0, dilation.1],
                ..ConvGeometry::new()
            };
            prop_assume!(geometry.output_size(0, h, kernel.0).is_some());
            prop_assume!(geometry.output_size(1, w, kernel.1).is_some());
            let options = Options { probes: 24, ..Options::default() };
            testkit::assert_gradients(
                &move |v: &[Var<'_, f64>]| v[0].conv2d(v[1], Some(v[2]), geometry, SAME),
                &[vec![n, h, w, c], vec![o, c, kernel.0, kernel.1], vec![o]],
                &options,
            );
            prop_assume!(geometry.transposed_size(0, h, kernel.0, 0).is_some_and(|s| s > 0));
            prop_assume!(geometry.transposed_size(1, w, kernel.1, 0).is_some_and(|s| s > 0));
            testkit::assert_gradients(
                &move |v: &[Var<'_, f64>]| v[0].conv_transpose2d(v[1], Some(v[2]), geometry, 0, SAME),
                &[vec![n, h, w, c], vec![c, o, kernel.0, kernel.1], vec![o]],
                &options,
            );
        }
    }

    #[test]
    #[should_panic(expected = "C is 3 in input and 4 in weight")]
    fn channels_must_agree() {
        let tape = Tape::<f32>::eval();
        let x = tape.constant(ndarray::Array4::<f32>::zeros((1, 5, 5, 3)));
        let w = tape.constant(ndarray::Array4::<f32>::zeros((2, 4, 3, 3)));
        let _ = x.conv2d(w, None, ConvGeometry::new(), SAME);
    }

    #[test]
    #[should_panic(expected = "the window does not fit")]
    fn the_window_must_fit() {
        let tape = Tape::<f32>::eval();
        let x = tape.constant(ndarray::Array4::<f32>::zeros((1, 2, 5, 3)));
        let w = tape.constant(ndarray::Array4::<f32>::zeros((2, 3, 3, 3)));
        let _ = x.conv2d(w, None, ConvGeometry::new(), SAME);
    }
}
