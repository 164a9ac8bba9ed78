//! The part of a graph convolution that follows its weights.

use crate::kernels::activation::Activation;
use crate::kernels::isa::Isa;
use crate::kernels::sparse::{csr_add_rows, csr_times_rows};
use crate::{Backward, PoolVec, Real, SparseMatrix, Var};

use super::linear::{before_activation, give_bias};

impl<F: Real> Var<'_, F> {
    /// `activation(x_own + b + A x_sent)`, where the first half of the columns stays at its vertex and the other is sent
    /// over the graph `A`.
    ///
    /// A [graph convolution](Var::graph_conv) whose weights were applied before, both at once.
    ///
    /// # Shapes
    /// `self [.., V, 2 O]`, `graph [V, V]`, `bias [O]` → `[.., V, O]`.
    ///
    /// # Panics
    /// If sizes differ, or the number of columns is odd.
    #[track_caller]
    #[inline(never)]
    pub fn graph_sum(
        self,
        graph: &SparseMatrix<F>,
        bias: Option<Self>,
        activation: Activation,
    ) -> Self {
        let tape = self.tape;
        let (x, bias_value) = (self.value(), bias.map(Var::value));
        let [batch, v, o] = tape.check("graph_sum", |shapes| {
            let [leading @ .., v, both] = x.shape() else {
                return Err(shapes.error("at least two axes expected"));
            };
            if both % 2 != 0 {
                return Err(shapes.error("an even number of columns expected"));
            }
            let batch = leading.iter().product();
            shapes.axes("graph", &[graph.rows(), graph.columns()], ["V", "V"])?;
            shapes.axes("input", &[batch, *v, both / 2], ["..", "V", "O"])?;
            if let Some(bias) = &bias_value {
                shapes.axes("bias", bias.shape(), ["O"])?;
            }
            Ok([batch, *v, both / 2])
        });
        let mut shape = x.shape().to_vec();
        if let Some(last) = shape.last_mut() {
            *last = o;
        }
        let mut y = tape.array(&shape);
        let mut sent = tape.buffer(y.len());
        let out = y.as_slice_mut();
        let rows = out.chunks_exact_mut(o.max(1)).zip(sent.chunks_exact_mut(o.max(1)));
        let x = x.as_slice().chunks_exact((2 * o).max(1));
        for ((y, sent), x) in rows.zip(x) {
            y.copy_from_slice(&x[..o]);
            sent.copy_from_slice(&x[o..]);
            if let Some(bias) = &bias_value {
                let bias = bias.as_slice();
                y.iter_mut().zip(bias).for_each(|(y, &b)| *y += b);
            }
        }
        csr_add_rows(Isa::best(), graph.view(), v, batch, o, &sent, out, activation);
        let mut inputs = vec![self];
        inputs.extend(bias);
        let transpose = graph.transposed();
        tape.record_fn("graph_sum", &inputs, y, move |cx: &mut Backward<'_, F>| {
            let whole = before_activation(cx, activation);
            let g = whole.as_slice();
            if cx.needs(0) {
                let mut sent: PoolVec<F> = cx.scratch(g.len());
                csr_times_rows(Isa::best(), transpose.view(), v, batch, o, g, &mut sent);
                cx.give_with(0, |gx| {
                    let rows = gx.chunks_exact_mut((2 * o).max(1));
                    let parts = g.chunks_exact(o.max(1)).zip(sent.chunks_exact(o.max(1)));
                    for (row, (own, sent)) in rows.zip(parts) {
                        row[..o].copy_from_slice(own);
                        row[o..].copy_from_slice(sent);
                    }
                });
            }
            give_bias(cx, 1, g);
            cx.recycle(whole);
        })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::testkit::{Options, gradcheck};
    use crate::{GraphWeights, Tape};

    fn graph() -> SparseMatrix<f64> {
        let entries =
            [(0, 1, 0.5), (0, 3, -2.0), (2, 0, 1.5), (2, 2, 0.25), (3, 3, 1.0), (3, 1, 3.0)];
        SparseMatrix::from_triplets(4, 4, &entries).unwrap()
    }

    gradcheck!(plain: |x| x.graph_sum(&graph(), None, Activation::None), shapes [[[4, 2]], [[2, 4, 34]]]);
    gradcheck!(with_a_bias: |x, b| x.graph_sum(&graph(), Some(b), Activation::Tanh),
        shapes [[[4, 6], [3]], [[2, 4, 34], [17]]]);

    /// After its weights it is the graph convolution.
    #[test]
    fn it_ends_a_graph_convolution() {
        let tape = Tape::<f64>::eval();
        let inputs = Options::default().draw(&[vec![2, 4, 5], vec![5, 7], vec![5, 7], vec![7]]);
        let [x, own, across, bias] = [0, 1, 2, 3].map(|i| tape.constant(inputs[i].clone()));
        let both = x.matmul(tape.concat(&[own, across], 1));
        let found = both.graph_sum(&graph(), Some(bias), Activation::Relu).value();
        let weights =
            GraphWeights { own, across, output_first: false, bias: Some(bias), across_bias: None };
        let expected = x.graph_conv(&graph(), &weights, Activation::Relu).value();
        for (a, b) in found.iter().zip(expected.iter()) {
            assert!((a - b).abs() < 1e-12, "{a} {b}");
        }
    }
}
