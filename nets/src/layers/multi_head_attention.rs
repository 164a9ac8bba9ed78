//! Multi-head attention.

use autodiff_lite::{LinearThen, Param, Real, Tensor, Var, impl_module};

use crate::{Init, Linear};

/// Multi-head attention with a bias, as `torch.nn.MultiheadAttention(D, heads, dropout,
/// batch_first=True)` whose keys and values are as wide as its queries.
///
/// ```text
/// Q, K, V = x W_inᵀ + b_in       y = softmax(Q Kᵀ / √(D / heads)) V W_outᵀ + b_out
/// ```
///
/// There is no positional encoding: permuting the tokens permutes the output.
///
/// ```
/// use autodiff_lite::Tape;
/// use nets::{Init, MultiHeadAttention};
///
/// let attention = MultiHeadAttention::<f32>::new(&Init::new(0).at("self_attn"), 16, 4);
/// let tape = Tape::eval();
/// let tokens = tape.constant(ndarray::Array3::zeros((2, 5, 16)));
/// assert_eq!(attention.forward(tokens, None).shape(), [2, 5, 16]);
/// ```
///
/// # References
/// Vaswani et al. 2017, *Attention is all you need*, section 3.2.2.
#[derive(Clone, Debug)]
pub struct MultiHeadAttention<F: Real = f32> {
    /// `[3 D, D]`: queries, keys and values below each other.
    pub in_proj_weight: Param<F>,
    /// `[3 D]`.
    pub in_proj_bias: Param<F>,
    /// From all heads to the output.
    pub out_proj: Linear<F>,
    /// The number of heads; it divides `D`.
    pub heads: usize,
    /// The probability of a pair to be forgotten while training.
    pub dropout: f64,
}
impl_module!(MultiHeadAttention { in_proj_weight, in_proj_bias, out_proj } fixed { heads, dropout });

impl<F: Real> MultiHeadAttention<F> {
    /// PyTorch's initial values: `xavier_uniform` for the input weight, 0 for both biases. No
    /// dropout; set the field.
    ///
    /// # Panics
    /// If `heads` does not divide `width`.
    #[track_caller]
    pub fn new(init: &Init, width: usize, heads: usize) -> Self {
        assert!(
            heads > 0 && width.is_multiple_of(heads),
            "{heads} heads do not divide a width of {width}"
        );
        let out = init.at("out_proj");
        Self {
            in_proj_weight: init.at("in_proj_weight").xavier_uniform(&[3 * width, width], 1.0),
            in_proj_bias: init.at("in_proj_bias").zeros(&[3 * width]),
            out_proj: Linear {
                bias: Some(out.at("bias").zeros(&[width])),
                ..Linear::new(&out, width, width)
            },
            heads,
            dropout: 0.0,
        }
    }

    /// Tokens attend to each other. The mask is added to the scores, see [`Var::attention`].
    ///
    /// # Shapes
    /// `x [N, T, D]`, `mask [T, T]` or `[N, T, T]` → `[N, T, D]`.
    #[track_caller]
    pub fn forward<'t>(&self, x: Var<'t, F>, mask: Option<&Tensor<F>>) -> Var<'t, F> {
        self.forward_fused(x, mask, LinearThen::default())
    }

    /// [`forward`](Self::forward), and then what [`LinearThen`] says in the pass that writes the output.
    ///
    /// # Shapes
    /// As for [`forward`](Self::forward); a residual `[N, T, D]`.
    #[track_caller]
    pub fn forward_fused<'t>(
        &self,
        x: Var<'t, F>,
        mask: Option<&Tensor<F>>,
        then: LinearThen<'t, F>,
    ) -> Var<'t, F> {
        let tape = x.tape();
        let (weight, bias) = (tape.param(&self.in_proj_weight), tape.param(&self.in_proj_bias));
        let packed = x.linear(weight, Some(bias), autodiff_lite::Activation::None);
        self.out_proj.forward_fused(packed.self_attention(self.heads, mask, self.dropout), then)
    }

    /// Queries attend to a memory.
    ///
    /// # Shapes
    /// `queries [N, Tq, D]`, `memory [N, Tk, D]`, `mask [Tq, Tk]` or `[N, Tq, Tk]` → `[N, Tq, D]`.
    #[track_caller]
    pub fn cross<'t>(
        &self,
        queries: Var<'t, F>,
        memory: Var<'t, F>,
        mask: Option<&Tensor<F>>,
    ) -> Var<'t, F> {
        let tape = queries.tape();
        let width = self.in_proj_weight.shape()[1];
        let (weight, bias) = (tape.param(&self.in_proj_weight), tape.param(&self.in_proj_bias));
        let project = |x: Var<'t, F>, part: usize| {
            let rows = part * width..(part + 1) * width;
            let bias = bias.slice_axis(0, rows.clone());
            x.linear(weight.slice_axis(0, rows), Some(bias), autodiff_lite::Activation::None)
        };
        let (k, v) = (project(memory, 1), project(memory, 2));
        let y = project(queries, 0).attention(k, v, self.heads, mask, self.dropout);
        self.out_proj.forward(y)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use autodiff_lite::testkit::{Options, check, function};
    use autodiff_lite::{Module, Tape};
    use ndarray::{Array3, Axis};

    use super::*;

    fn tokens(seed: f64) -> Tensor<f64> {
        Array3::from_shape_fn((2, 3, 8), |(n, t, d)| (seed + (n * 24 + t * 8 + d) as f64).sin())
            .into()
    }

    #[test]
    fn gradients_reach_tokens_through_every_path() {
        let attention = MultiHeadAttention::<f64>::new(&Init::new(1), 8, 2);
        let options = Options::default();
        let f = function(|v| attention.forward(v[0], None));
        check(&f, &options.draw(&[vec![2, 3, 8]]), &options).unwrap();
        let f = function(|v| attention.cross(v[0], v[1], None));
        check(&f, &options.draw(&[vec![2, 3, 8], vec![2, 2, 8]]), &options).unwrap();
    }

    #[test]
    fn crossing_with_itself_is_self_attention_and_order_does_not_matter() {
        let attention = MultiHeadAttention::<f64>::new(&Init::new(1), 8, 4);
        let tape = Tape::eval();
        let x = tape.constant(tokens(0.0));
        let (y, z) = (attention.forward(x, None).value(), attention.cross(x, x, None).value());
        y.iter().zip(&z).for_each(|(y, z)| assert!((y - z).abs() < 1e-12));
        let turned = tape.constant(tokens(0.0).select(Axis(1), &[2, 0, 1]));
        let z = attention.forward(turned, None).value();
        let y = y.select(Axis(1), &[2, 0, 1]);
        y.iter().zip(&z).for_each(|(y, z)| assert!((y - z).abs() < 1e-12));
    }

    #[test]
    fn names_are_those_of_pytorch() {
        let attention = MultiHeadAttention::<f32>::new(&Init::new(1), 8, 2);
        let mut paths = Vec::new();
        attention.visit("", &mut |path: &str, _: &_| paths.push(path.to_owned()));
        assert_eq!(paths, ["in_proj_weight", "in_proj_bias", "out_proj.weight", "out_proj.bias"]);
    }
}
