//! The fused graph convolution.

use crate::kernels::activation::Activation;
use crate::kernels::gemm::{Joined, Matrix};
use crate::kernels::isa::Isa;
use crate::kernels::product::gemm_joined;
use crate::kernels::sparse::{csr_add_rows, csr_times_rows};
use crate::{Backward, Op, PoolVec, Real, ShapeError, Shapes, SparseMatrix, Tensor, Var};

use super::linear::{before_activation, check_activation, give_bias};

/// The parameters of a [graph convolution](Var::graph_conv).
#[derive(Clone, Copy, Debug)]
pub struct GraphWeights<'t, F: Real = f32> {
    /// Weighs a vertex's own features.
    pub own: Var<'t, F>,
    /// Weighs the features that reach a vertex over the graph.
    pub across: Var<'t, F>,
    /// Whether both weights are `[O, D]`, as in PyTorch's linear layer, or `[D, O]`.
    pub output_first: bool,
    /// `[O]`, added to each vertex.
    pub bias: Option<Var<'t, F>>,
    /// `[O]`, added to what each vertex sends.
    pub across_bias: Option<Var<'t, F>>,
}

/// The rule of [`Var::graph_conv`].
struct GraphConv<F: Real> {
    sizes: Sizes,
    transpose: SparseMatrix<F>,
    activation: Activation,
    /// Whether there are biases.
    bias: bool,
    across_bias: bool,
}

impl<F: Real> Op<F> for GraphConv<F> {
    fn name(&self) -> &'static str {
        "graph_conv"
    }

    fn pullback(&self, cx: &mut Backward<'_, F>) {
        let sizes = self.sizes;
        let Sizes { batch, v, d, o, .. } = sizes;
        let whole = before_activation(cx, self.activation);
        let g = whole.as_slice();
        // The gradient of what the vertices sent.
        let mut sent: PoolVec<F> = cx.scratch(g.len());
        csr_times_rows(Isa::best(), self.transpose.view(), v, batch, o, g, &mut sent);
        let weights = [cx.input(1), cx.input(2)];
        let gradients = [g, &sent[..]];
        cx.give_with(0, |gx| {
            let left = gradients.map(|g| Matrix::rows(g, o));
            let right = weights.each_ref().map(|w| sizes.weight_turned(w.as_slice()));
            let size = [sizes.rows(), o, d];
            gemm_joined(Joined::Sum, size, F::one(), &left, &right, F::zero(), &mut [gx], None);
        });
        sizes.give_weights(cx, gradients);
        if self.bias {
            give_bias(cx, 3, g);
        }
        if self.across_bias {
            give_bias(cx, 3 + usize::from(self.bias), &sent);
        }
        cx.recycle(whole);
    }
}

impl<'t, F: Real> Var<'t, F> {
    /// `activation(x W + b + A (x U + c))` for each batch element, with `W` the [own](GraphWeights::own) weight and `U`
    /// the one [across](GraphWeights::across).
    ///
    /// The graph is applied after the weight, as is cheaper while `O <= D`. No gradient to the entries of `A`.
    ///
    /// # Shapes
    /// `self [.., V, D]`, `graph [V, V]`, weights as [`GraphWeights`] says → `[.., V, O]`.
    ///
    /// # Cost
    /// `4 V D O` flops and `2 entries O`, the gradient twice as many; nothing is kept for it.
    ///
    /// # Panics
    /// If sizes differ, or `x` has fewer than two axes.
    #[track_caller]
    #[inline(never)]
    pub fn graph_conv(
        self,
        graph: &SparseMatrix<F>,
        weights: &GraphWeights<'t, F>,
        activation: Activation,
    ) -> Self {
        let tape = self.tape;
        check_activation(tape, "graph_conv", activation);
        let (x, own, across) = (self.value(), weights.own.value(), weights.across.value());
        let [bias, sent] = [weights.bias, weights.across_bias].map(|b| b.map(Var::value));
        let sizes = tape.check("graph_conv", |shapes| {
            let operands = [x.shape(), own.shape(), across.shape()];
            let biases = [&bias, &sent].map(|b| b.as_ref().map(|b| b.shape()));
            Sizes::of(shapes, graph, operands, biases, weights.output_first)
        });
        let mut shape = x.shape().to_vec();
        if let Some(last) = shape.last_mut() {
            *last = sizes.o;
        }
        let mut y = tape.array(&shape);
        let mut z = tape.buffer(y.len());
        let matrices = [&own, &across].map(|w| sizes.weight(w.as_slice()));
        let biases = [&bias, &sent].map(|b| b.as_ref().map(Tensor::as_slice));
        // Both weights in one product: the input, often the largest operand, is read once.
        gemm_joined(
            Joined::Columns,
            [sizes.rows(), sizes.d, sizes.o],
            F::one(),
            &[Matrix::rows(x.as_slice(), sizes.d)],
            &matrices,
            F::zero(),
            &mut [y.as_slice_mut(), &mut z[..]],
            Some(&|part: &mut [F], [which, _, column]: [usize; 3]| {
                if let Some(bias) = biases[which] {
                    part.iter_mut().zip(&bias[column..]).for_each(|(y, &b)| *y += b);
                }
            }),
        );
        csr_add_rows(
            Isa::best(),
            graph.view(),
            sizes.v,
            sizes.batch,
            sizes.o,
            &z,
            y.as_slice_mut(),
            activation,
        );
        let mut inputs = vec![self, weights.own, weights.across];
        inputs.extend(weights.bias);
        inputs.extend(weights.across_bias);
        let [bias, across_bias] = [weights.bias, weights.across_bias].map(|b| b.is_some());
        let rule =
            GraphConv { sizes, transpose: graph.transposed(), activation, bias, across_bias };
        tape.record(&inputs, y, rule)
    }
}

#[derive(Clone, Copy)]
struct Sizes {
    batch: usize,
    v: usize,
    d: usize,
    o: usize,
    output_first: bool,
}

impl Sizes {
    /// From the shapes of the input and both weights, and of the biases that are there.
    fn of<F: Real>(
        shapes: &mut Shapes,
        graph: &SparseMatrix<F>,
        [x, own, across]: [&[usize]; 3],
        [bias, sent]: [Option<&[usize]>; 2],
        output_first: bool,
    ) -> Result<Self, ShapeError> {
        shapes.axes("graph", &[graph.rows(), graph.columns()], ["V", "V"])?;
        let (batch, [v, d]) = shapes.last_axes("input", x, ["V", "D"])?;
        let letters = if output_first { ["O", "D"] } else { ["D", "O"] };
        let sides = shapes.axes("own", own, letters)?;
        shapes.axes("across", across, letters)?;
        for (name, bias) in [("bias", bias), ("across bias", sent)] {
            if let Some(bias) = bias {
                shapes.axes(name, bias, ["O"])?;
            }
        }
        let o = sides[usize::from(!output_first)];
        Ok(Self { batch, v, d, o, output_first })
    }

    fn rows(self) -> usize {
        self.batch * self.v
    }

    /// A weight as `D x O`.
    fn weight<F>(self, w: &[F]) -> Matrix<'_, F> {
        if self.output_first { Matrix::transposed(w, self.d) } else { Matrix::rows(w, self.o) }
    }

    /// A weight as `O x D`.
    fn weight_turned<F>(self, w: &[F]) -> Matrix<'_, F> {
        if self.output_first { Matrix::rows(w, self.d) } else { Matrix::transposed(w, self.o) }
    }

    /// Gives the weights that want one their gradients: the inputs' transpose times `g`, the gradients of what they gave.
    fn give_weights<F: Real>(self, cx: &mut Backward<'_, F>, g: [&[F]; 2]) {
        let (Self { d, o, output_first, .. }, rows) = (self, self.rows());
        let wanted: Vec<usize> = (0..2).filter(|&i| cx.needs(1 + i)).collect();
        if wanted.is_empty() {
            return;
        }
        let x = cx.input(0);
        let x = x.as_slice();
        let shape = if output_first { [o, d] } else { [d, o] };
        let mut gradients: Vec<_> = wanted.iter().map(|_| cx.array(&shape)).collect();
        let mut out: Vec<&mut [F]> = gradients.iter_mut().map(Tensor::as_slice_mut).collect();
        let sizes = [shape[0], rows, shape[1]];
        let g = wanted.iter().map(|&i| g[i]);
        let (joined, left, right): (_, Vec<_>, Vec<_>) = if output_first {
            let left = g.map(|g| Matrix::transposed(g, o)).collect();
            (Joined::Rows, left, vec![Matrix::rows(x, d)])
        } else {
            let right = g.map(|g| Matrix::rows(g, o)).collect();
            (Joined::Columns, vec![Matrix::transposed(x, d)], right)
        };
        gemm_joined(joined, sizes, F::one(), &left, &right, F::zero(), &mut out, None);
        for (i, gradient) in wanted.into_iter().zip(gradients) {
            cx.give(1 + i, gradient);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::Tape;
    use crate::testkit::{Options, gradcheck};

    fn graph() -> SparseMatrix<f64> {
        let entries =
            [(0, 1, 0.5), (0, 3, -2.0), (2, 0, 1.5), (2, 2, 0.25), (3, 3, 1.0), (3, 1, 3.0)];
        SparseMatrix::from_triplets(4, 4, &entries).unwrap()
    }

    fn weights<'t>(
        own: Var<'t, f64>,
        across: Var<'t, f64>,
        output_first: bool,
    ) -> GraphWeights<'t, f64> {
        GraphWeights { own, across, output_first, bias: None, across_bias: None }
    }

    gradcheck!(plain: |x, w, u| x.graph_conv(&graph(), &weights(w, u, true), Activation::None),
        shapes [[[4, 5], [3, 5], [3, 5]], [[2, 4, 2], [17, 2], [17, 2]]]);
    gradcheck!(input_first: |x, w, u, b| {
        x.graph_conv(&graph(), &GraphWeights { bias: Some(b), ..weights(w, u, false) }, Activation::Tanh)
    }, shapes [[[4, 5], [5, 3], [5, 3], [3]], [[2, 4, 2], [2, 33], [2, 33], [33]]]);
    gradcheck!(with_both_biases: |x, w, u, b, c| {
        let weights = GraphWeights { bias: Some(b), across_bias: Some(c), ..weights(w, u, true) };
        x.graph_conv(&graph(), &weights, Activation::Sigmoid)
    }, shapes [[[4, 5], [3, 5], [3, 5], [3], [3]]]);
    gradcheck!(only_what_is_sent_has_a_bias: |x, w, u, c| {
        x.graph_conv(&graph(), &GraphWeights { across_bias: Some(c), ..weights(w, u, true) }, Activation::Tanh)
    }, shapes [[[1, 4, 5], [3, 5], [3, 5], [3]]]);
    gradcheck!(one_weight_for_both: |x, w| x.graph_conv(&graph(), &weights(w, w, true), Activation::None),
        shapes [[[4, 5], [3, 5]]]);

    /// The parts, one operation each.
    #[test]
    fn it_is_the_sum_of_its_parts_for_any_width_and_activation() {
        let tape = Tape::<f64>::eval();
        for width in [1, 7, 16, 64, 67, 192] {
            let shapes = [vec![3, 4, 6], vec![width, 6], vec![width, 6], vec![width], vec![width]];
            let inputs = Options::default().draw(&shapes);
            let [x, w, u, b, c] = [0, 1, 2, 3, 4].map(|i| tape.constant(inputs[i].clone()));
            let own = x.linear(w, Some(b), Activation::None);
            let sum = own + x.linear(u, Some(c), Activation::None).sparse_matmul(&graph());
            let all = GraphWeights { bias: Some(b), across_bias: Some(c), ..weights(w, u, true) };
            for (activation, expected) in [
                (Activation::None, sum),
                (Activation::Relu, sum.relu()),
                (Activation::LeakyRelu(0.2), sum.leaky_relu(0.2)),
                (Activation::Tanh, sum.tanh()),
            ] {
                let found = x.graph_conv(&graph(), &all, activation).value();
                let worst = found
                    .iter()
                    .zip(&expected.value())
                    .map(|(a, b)| (a - b).abs())
                    .fold(0.0, f64::max);
                assert!(worst < 1e-12, "{width} {activation:?}: {worst}");
            }
        }
    }

    #[test]
    fn the_number_of_threads_changes_no_bit() {
        let n = 700;
        let ring: Vec<_> =
            (0..n).flat_map(|i| [(i, (i + 1) % n, 0.5_f32), (i, (i + n - 1) % n, 0.5)]).collect();
        let graph = SparseMatrix::from_triplets(n, n, &ring).unwrap();
        let draws = Options::default().draw(&[vec![n, 130], vec![96, 130], vec![96, 130]]);
        let draws: Vec<_> = draws.iter().map(|x| x.mapv(|x| x as f32)).collect();
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let tape = Tape::<f32>::train(0);
                let [x, own, across] = [0, 1, 2].map(|i| tape.leaf(draws[i].clone()));
                let weights =
                    GraphWeights { own, across, output_first: true, bias: None, across_bias: None };
                let y = x.graph_conv(&graph, &weights, Activation::Relu);
                let gradients = y.square().sum().backward();
                [x, own, across].map(|v| gradients.wrt(v).unwrap().to_owned())
            })
        };
        let one = run(1);
        assert!(one == run(2) && one == run(3));
    }

    #[test]
    #[should_panic(expected = "graph_conv: V is 4 in graph and 5 in input")]
    fn sizes_must_agree() {
        let tape = Tape::<f64>::eval();
        let [x, w] = [[5, 2], [3, 2]].map(|shape| tape.constant(ndarray::Array2::zeros(shape)));
        let _ = x.graph_conv(&graph(), &weights(w, w, true), Activation::None);
    }
}
