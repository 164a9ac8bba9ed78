//! The fused linear layer.

use crate::kernels::activation::Activation;
use crate::kernels::columns::column_sums;
use crate::kernels::dropout::Kept;
use crate::kernels::elementwise;
use crate::kernels::gemm::Matrix;
use crate::kernels::product::{gemm, gemm_then};
use crate::{Backward, Op, PoolVec, Real, ShapeError, Shapes, Tape, Tensor, Var};

use super::dropout::{keep_mask, keep_scale};

/// What follows the product of a [linear layer](Var::linear_then) in the same pass.
#[derive(Clone, Copy, Debug)]
pub struct LinearThen<'t, F: Real = f32> {
    /// Acts on the sum with the bias.
    pub activation: Activation,
    /// The probability of an element to be [dropped](Var::dropout) after that; on training tapes alone.
    pub dropout: f64,
    /// Added last, of the shape of the output.
    pub residual: Option<Var<'t, F>>,
}

impl<F: Real> Default for LinearThen<'_, F> {
    /// Nothing.
    fn default() -> Self {
        Self { activation: Activation::None, dropout: 0.0, residual: None }
    }
}

/// The rule of [`Var::linear_then`].
struct Linear<F: Real> {
    /// Rows of the input, its columns and those of the output.
    sizes: [usize; 3],
    activation: Activation,
    /// What dropout kept, if it was there, and what that was multiplied by.
    mask: Option<PoolVec<u32>>,
    scale: F,
    has_bias: bool,
    has_residual: bool,
}

impl<F: Real> Op<F> for Linear<F> {
    fn name(&self) -> &'static str {
        "linear"
    }

    fn pullback(&self, cx: &mut Backward<'_, F>) {
        let kept = self.mask.as_ref().map(|bits| Kept { bits, scale: self.scale });
        let whole = if self.has_residual { Some(cx.take_grad_out()) } else { None };
        // A residual sum hands its gradient on as it is.
        let own = match (&whole, &kept) {
            (None, _) => Some(before_dropout(cx, self.activation, kept)),
            (Some(_), None) => None,
            (Some(whole), Some(kept)) => {
                let mut own = cx.array(whole.shape());
                kept.apply_to(whole.as_slice(), own.as_slice_mut());
                Some(own)
            }
        };
        let g = own.as_ref().or(whole.as_ref()).expect("one of both is there");
        self.give_factors(cx, g.as_slice());
        if self.has_bias {
            give_bias(cx, 2, g.as_slice());
        }
        if let Some(own) = own {
            cx.recycle(own);
        }
        if let Some(whole) = whole {
            cx.give(2 + usize::from(self.has_bias), whole);
        }
    }
}

impl<F: Real> Linear<F> {
    /// Gives input and weight their gradients, from that of their product.
    fn give_factors(&self, cx: &mut Backward<'_, F>, grad: &[F]) {
        let [rows, d, o] = self.sizes;
        let (x, w, one, zero) = (cx.input(0), cx.input(1), F::one(), F::zero());
        let (x, w) = (Matrix::rows(x.as_slice(), d), Matrix::rows(w.as_slice(), d));
        cx.add_with(0, |gx, add| {
            let beta = if add { one } else { zero };
            gemm([rows, o, d], one, Matrix::rows(grad, o), w, beta, gx);
        });
        cx.add_with(1, |gw, add| {
            let beta = if add { one } else { zero };
            gemm([o, rows, d], one, Matrix::transposed(grad, o), x, beta, gw);
        });
    }
}

impl<'t, F: Real> Var<'t, F> {
    /// `activation(x Wᵀ + b)` in one pass over the output.
    ///
    /// # Shapes
    /// `self [.., D]`, `weight [O, D]` (PyTorch's layout), `bias [O]` → `[.., O]`.
    ///
    /// # Cost
    /// `2 rows D O` flops forward, twice that backward.
    ///
    /// # Panics
    /// If sizes differ, `x` has no axis, or the slope of a leaky ReLU is not within (0, 1], as in all operations that take an
    /// activation.
    #[track_caller]
    #[inline(never)]
    pub fn linear(self, weight: Self, bias: Option<Self>, activation: Activation) -> Self {
        self.linear_then(weight, bias, LinearThen { activation, ..LinearThen::default() })
    }

    /// `residual + dropout(activation(x Wᵀ + b))` in one pass over the output; cost as [`linear`](Self::linear).
    ///
    /// The gradient is made in one pass too; where an activation and a residual sum come together the sum is an operation
    /// of its own, since the derivative is told from the output.
    ///
    /// # Shapes
    /// `self [.., D]`, `weight [O, D]`, `bias [O]`, a residual `[.., O]` → `[.., O]`.
    ///
    /// # Panics
    /// If sizes differ, `x` has no axis, or the probability is not within `[0, 1)`.
    #[track_caller]
    #[inline(never)]
    pub fn linear_then(self, weight: Self, bias: Option<Self>, then: LinearThen<'t, F>) -> Self {
        let LinearThen { activation, dropout, residual } = then;
        check_activation(self.tape, "linear", activation);
        if let (Some(residual), true) = (residual, activation != Activation::None) {
            let then = LinearThen { activation, dropout, residual: None };
            return residual + self.linear_then(weight, bias, then);
        }
        let (x, w, b) = (self.value(), weight.value(), bias.map(Self::value));
        let shortcut = residual.map(Self::value);
        let [rows, d, o] =
            self.tape.check("linear", |shapes| sizes(shapes, [&x, &w], [&b, &shortcut]));
        let mut shape = x.shape().to_vec();
        if let Some(last) = shape.last_mut() {
            *last = o;
        }
        let mask = keep_mask(self.tape, rows * o, dropout);
        let scale = keep_scale(dropout);
        let mut y = self.tape.array(&shape);
        let finish = Then {
            bias: b.as_ref().map(Tensor::as_slice),
            activation,
            kept: mask.as_ref().map(|bits| Kept { bits, scale }),
            residual: shortcut.as_ref().map(Tensor::as_slice),
        };
        gemm_then(
            [rows, d, o],
            F::one(),
            Matrix::rows(x.as_slice(), d),
            Matrix::transposed(w.as_slice(), d),
            F::zero(),
            y.as_slice_mut(),
            |part, [row, column]| finish.apply(part, row * o + column, column),
        );
        let mut inputs = vec![self, weight];
        inputs.extend(bias);
        inputs.extend(residual);
        let (has_bias, has_residual) = (bias.is_some(), residual.is_some());
        let rule = Linear { sizes: [rows, d, o], activation, mask, scale, has_bias, has_residual };
        self.tape.record(&inputs, y, rule)
    }
}

/// Rows of the input, its columns and those of the output. Of the operands the first two are input and weight, the others the
/// bias and a residual.
fn sizes<F: Real>(
    shapes: &mut Shapes,
    [x, w]: [&Tensor<F>; 2],
    [bias, residual]: [&Option<Tensor<F>>; 2],
) -> Result<[usize; 3], ShapeError> {
    let (rows, [d]) = shapes.last_axes("input", x.shape(), ["D"])?;
    let [o, _] = shapes.axes("weight", w.shape(), ["O", "D"])?;
    if let Some(bias) = bias {
        shapes.axes("bias", bias.shape(), ["O"])?;
    }
    if let Some(residual) = residual {
        let shape = [&x.shape()[..x.ndim() - 1], &[o]].concat();
        if residual.shape() != shape {
            return Err(shapes.error(format!("a residual of shape {shape:?} expected")));
        }
    }
    Ok([rows, d, o])
}

/// What is done with a part of a row of the product.
struct Then<'a, F> {
    bias: Option<&'a [F]>,
    activation: Activation,
    kept: Option<Kept<'a, F>>,
    residual: Option<&'a [F]>,
}

impl<F: Real> Then<'_, F> {
    /// The part begins with element `first` of the output, in this column.
    fn apply(&self, part: &mut [F], first: usize, column: usize) {
        if let Some(bias) = self.bias {
            for (y, &b) in part.iter_mut().zip(&bias[column..]) {
                *y += b;
            }
        }
        self.activation.apply_all(part);
        if let Some(kept) = &self.kept {
            kept.apply(first, part);
        }
        if let Some(residual) = self.residual {
            for (y, &x) in part.iter_mut().zip(&residual[first..]) {
                *y += x;
            }
        }
    }
}

/// The gradient before activation and dropout, from that of the output, in place.
fn before_dropout<F: Real>(
    cx: &mut Backward<'_, F>,
    activation: Activation,
    kept: Option<Kept<'_, F>>,
) -> Tensor<F> {
    let Some(kept) = kept else { return before_activation(cx, activation) };
    let y = cx.output();
    let mut g = cx.take_grad_out();
    let (y, scale) = (y.as_slice(), kept.scale);
    let gradient = g.as_slice_mut();
    if activation == Activation::Relu {
        // What was dropped is 0 in the output, as what the rectifier stopped.
        elementwise::update(
            gradient,
            y,
            y,
            |g, y, _| if y > F::zero() { g * scale } else { F::zero() },
        );
        return g;
    }
    kept.apply_all(gradient);
    if activation != Activation::None {
        elementwise::update(gradient, y, y, |g, y, _| g * activation.derivative(y / scale));
    }
    g
}

/// Refuses an activation that the kernels cannot apply.
#[track_caller]
pub(crate) fn check_activation<F: Real>(tape: &Tape<F>, op: &'static str, activation: Activation) {
    if let Some(fault) = activation.fault() {
        tape.refuse(op, fault, &[]);
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
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::LinearThen;
    use crate::kernels::activation::Activation;
    use crate::testkit::gradcheck;

    gradcheck!(plain: |x, w| x.linear(w, None, Activation::None),
        shapes [[[3, 5], [2, 5]], [[5], [3, 5]], [[2, 3, 4], [1, 4]], [[0, 4], [2, 4]]]);
    gradcheck!(with_bias: |x, w, b| x.linear(w, Some(b), Activation::Tanh),
        shapes [[[3, 5], [2, 5], [2]], [[1, 1], [17, 1], [17]]]);
    gradcheck!(dropped: |x, w, b| {
        let then = LinearThen { activation: Activation::Sigmoid, dropout: 0.4, residual: None };
        x.linear_then(w, Some(b), then)
    }, shapes [[[3, 5], [2, 5], [2]], [[2, 3, 4], [17, 4], [17]]]);
    gradcheck!(rectified_and_dropped: |x, w, b| {
        let then = LinearThen { activation: Activation::Relu, dropout: 0.3, residual: None };
        x.linear_then(w, Some(b), then)
    }, shapes [[[3, 5], [2, 5], [2]], [[7, 4], [40, 4], [40]]]);
    gradcheck!(onto_a_residual: |x, w, b, r| {
        let then = LinearThen { dropout: 0.4, residual: Some(r), ..LinearThen::default() };
        x.linear_then(w, Some(b), then)
    }, shapes [[[3, 5], [2, 5], [2], [3, 2]], [[2, 3, 4], [17, 4], [17], [2, 3, 17]]]);
    gradcheck!(onto_its_input: |x, w| {
        x.linear_then(w, None, LinearThen { residual: Some(x), ..LinearThen::default() })
    }, shapes [[[3, 5], [5, 5]]]);
    gradcheck!(activated_onto_a_residual: |x, w, r| {
        let then = LinearThen { activation: Activation::Tanh, residual: Some(r), dropout: 0.2 };
        x.linear_then(w, None, then)
    }, shapes [[[3, 5], [2, 5], [3, 2]]]);

    /// The parts, one operation each, draw the same bits.
    #[test]
    fn it_is_what_it_is_made_of() {
        for (rows, o) in [(5, 7), (70, 130)] {
            let noise = |n: usize, k: f32| (0..n).map(|i| (i as f32 * 0.61 + k).sin()).collect();
            let array =
                |m: usize, n: usize, k| ndarray::Array2::from_shape_vec((m, n), noise(m * n, k));
            let run = |fused: bool| {
                let tape = crate::Tape::<f32>::train(4);
                let [x, w, r] = [(rows, 64, 0.0), (o, 64, 1.0), (rows, o, 2.0)]
                    .map(|(m, n, k)| tape.leaf(array(m, n, k).unwrap()));
                let b = tape.leaf(ndarray::Array1::from_vec(noise(o, 3.0)));
                let (y, z) = if fused {
                    let then =
                        LinearThen { activation: Activation::Relu, dropout: 0.3, residual: None };
                    let onto =
                        LinearThen { dropout: 0.3, residual: Some(r), ..LinearThen::default() };
                    (x.linear_then(w, Some(b), then), x.linear_then(w, Some(b), onto))
                } else {
                    (
                        x.linear(w, Some(b), Activation::Relu).dropout(0.3),
                        r + x.linear(w, Some(b), Activation::None).dropout(0.3),
                    )
                };
                let gradients = (y.square().sum() + z.square().sum()).backward();
                let all = [x, w, b, r].map(|v| gradients.wrt(v).unwrap().clone());
                (y.value(), z.value(), all)
            };
            let ((y, z, all), (y2, z2, all2)) = (run(true), run(false));
            assert!(y == y2 && z == z2);
            for (a, b) in all.iter().zip(&all2) {
                a.iter().zip(b).for_each(|(a, b)| assert!((a - b).abs() < 2e-4 * (1.0 + b.abs())));
            }
        }
    }

    #[test]
    #[should_panic(expected = "a residual of shape [3, 2] expected")]
    fn a_residual_has_the_shape_of_the_output() {
        let tape = crate::Tape::<f64>::eval();
        let [x, w, r] =
            [[3, 4], [2, 4], [2, 2]].map(|s| tape.constant(ndarray::Array2::<f64>::zeros(s)));
        let _ = x.linear_then(w, None, LinearThen { residual: Some(r), ..LinearThen::default() });
    }

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
