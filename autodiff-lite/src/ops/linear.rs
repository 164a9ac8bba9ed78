//! The fused linear layer.

use crate::kernels::activation::Activation;
use crate::kernels::columns::column_sums;
use crate::kernels::elementwise;
use crate::kernels::gemm::{Matrix, gemm, gemm_then};
use crate::{Backward, Real, Tensor, Var};

impl<F: Real> Var<'_, F> {
    /// `activation(x Wᵀ + b)`: `x [.., D]`, `weight [O, D]` (PyTorch's layout), `bias [O]` to
    /// `[.., O]`, in one pass over the output.
    ///
    /// `2 rows D O` flops forward, twice that backward.
    ///
    /// # Panics
    /// If sizes differ, or `x` has no axis.
    #[track_caller]
    pub fn linear(self, weight: Self, bias: Option<Self>, activation: Activation) -> Self {
        let (x, w, b) = (self.value(), weight.value(), bias.map(Self::value));
        let [rows, d, o] = self.tape.check("linear", |shapes| {
            let Some((&d, leading)) = x.shape().split_last() else {
                return Err(shapes.error("the input has no axis"));
            };
            let rows: usize = leading.iter().product();
            shapes.axes("input", &[rows, d], ["..", "D"])?;
            let [o, _] = shapes.axes("weight", w.shape(), ["O", "D"])?;
            if let Some(b) = &b {
                shapes.axes("bias", b.shape(), ["O"])?;
            }
            Ok([rows, d, o])
        });
        let mut shape = x.shape().to_vec();
        if let Some(last) = shape.last_mut() {
            *last = o;
        }
        let mut y = self.tape.array(&shape);
        let bias_slice = b.as_ref().map(Tensor::as_slice);
        gemm_then(
            [rows, d, o],
            F::one(),
            Matrix::rows(x.as_slice(), d),
            Matrix::transposed(w.as_slice(), d),
            F::zero(),
            y.as_slice_mut(),
            |part, [_, column]| finish(part, bias_slice.map(|b| &b[column..]), activation),
        );
        let mut inputs = vec![self, weight];
        inputs.extend(bias);
        self.tape.record_fn("linear", &inputs, y, move |cx: &mut Backward<'_, F>| {
            let g = before_activation(cx, activation);
            let grad = g.as_slice();
            let (x, w, one, zero) = (cx.input(0), cx.input(1), F::one(), F::zero());
            let (x, w) = (Matrix::rows(x.as_slice(), d), Matrix::rows(w.as_slice(), d));
            cx.give_with(0, |gx| gemm([rows, o, d], one, Matrix::rows(grad, o), w, zero, gx));
            cx.give_with(1, |gw| gemm([o, rows, d], one, Matrix::transposed(grad, o), x, zero, gw));
            give_bias(cx, 2, grad);
            cx.recycle(g);
        })
    }
}

fn finish<F: Real>(row: &mut [F], bias: Option<&[F]>, activation: Activation) {
    if let Some(bias) = bias {
        for (y, &b) in row.iter_mut().zip(bias) {
            *y += b;
        }
    }
    if activation != Activation::None {
        for y in row {
            *y = activation.apply(*y);
        }
    }
}

/// The gradient before the activation, from that of the output, in place.
pub(crate) fn before_activation<F: Real>(
    cx: &mut Backward<'_, F>,
    activation: Activation,
) -> Tensor<F> {
    let mut g = cx.take_grad_out();
    if activation != Activation::None {
        let y = cx.output();
        let y = y.as_slice();
        let g = g.as_slice_mut();
        match activation {
            // Named one by one, so that each loop vectorises.
            Activation::Relu => {
                elementwise::update(g, y, y, |g, y, _| if y > F::zero() { g } else { F::zero() });
            }
            Activation::LeakyRelu(slope) => {
                let slope = F::from_f64(slope);
                elementwise::update(g, y, y, |g, y, _| if y > F::zero() { g } else { g * slope });
            }
            _ => elementwise::update(g, y, y, |g, y, _| g * activation.derivative(y)),
        }
    }
    g
}

/// Gives input `i` the sums of `g`'s rows, as long as the last axis.
pub(crate) fn give_bias<F: Real>(cx: &mut Backward<'_, F>, i: usize, g: &[F]) {
    if i < cx.input_count() {
        cx.give_with(i, |gb| column_sums(g, gb));
    }
}

#[cfg(test)]
mod tests {
    use crate::kernels::activation::Activation;
    use crate::testkit::gradcheck;

    gradcheck!(plain: |x, w| x.linear(w, None, Activation::None),
        shapes [[[3, 5], [2, 5]], [[5], [3, 5]], [[2, 3, 4], [1, 4]], [[0, 4], [2, 4]]]);
    gradcheck!(with_bias: |x, w, b| x.linear(w, Some(b), Activation::Tanh),
        shapes [[[3, 5], [2, 5], [2]], [[1, 1], [17, 1], [17]]]);
    gradcheck!(sigmoid: |x, w, b| x.linear(w, Some(b), Activation::Sigmoid),
        shapes [[[3, 5], [2, 5], [2]]]);

    #[test]
    fn rectifiers_act_on_the_sum() {
        let tape = crate::Tape::<f32>::train(0);
        let x = tape.leaf(ndarray::arr2(&[[1.0, -2.0]]));
        let w = tape.leaf(ndarray::arr2(&[[3.0, 1.0], [0.5, 1.0]]));
        let b = tape.leaf(ndarray::arr1(&[-2.0, 0.5]));
        // 3 - 2 - 2 = -1 and 0.5 - 2 + 0.5 = -1; then +1 with another bias.
        let y = x.linear(w, Some(b), Activation::LeakyRelu(0.1));
        assert_eq!(y.value().as_slice(), [-0.1, -0.1]);
        let gradients = y.backward_with(ndarray::arr2(&[[1.0, 2.0]]));
        assert_eq!(gradients.wrt(b).map(|g| g.sum()), Some(0.1 + 0.2));
        let y = x.linear(w, Some(tape.constant(ndarray::arr1(&[2.0, 0.0]))), Activation::Relu);
        assert_eq!(y.value().as_slice(), [3.0, 0.0]);
    }

    #[test]
    #[should_panic(expected = "D is 3 in input and 4 in weight")]
    fn sizes_must_agree() {
        let tape = crate::Tape::<f32>::eval();
        let x = tape.constant(ndarray::Array2::<f32>::zeros((2, 3)));
        let w = tape.constant(ndarray::Array2::<f32>::zeros((2, 4)));
        let _ = x.linear(w, None, Activation::None);
    }
}
