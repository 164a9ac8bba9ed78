//! Attention between tokens: PyTorch's `TransformerEncoderLayer` with norms after the sums.

use autodiff_lite::{Activation, Param, Var, impl_module};
use nets::{Dropout, Init, LayerNorm, Linear};

/// Attention of all tokens to each other, heads side by side.
#[derive(Clone, Debug)]
struct SelfAttention {
    /// Queries, keys and values below each other: `[3 D, D]`.
    in_proj_weight: Param,
    in_proj_bias: Param,
    out_proj: Linear,
    heads: usize,
    dropout: Dropout,
}
impl_module!(SelfAttention: f32 { in_proj_weight, in_proj_bias, out_proj } fixed { heads, dropout });

/// ```text
/// x ← norm1(x + drop(attention(x)))      x ← norm2(x + drop(W₂ drop(relu(W₁ x))))
/// ```
///
/// # References
/// Vaswani et al. 2017, *Attention is all you need*, section 3.1.
#[derive(Clone, Debug)]
pub(super) struct AttentionLayer {
    self_attn: SelfAttention,
    linear1: Linear,
    linear2: Linear,
    norm1: LayerNorm,
    norm2: LayerNorm,
    dropout: Dropout,
}
impl_module!(AttentionLayer: f32 { self_attn, linear1, linear2, norm1, norm2 } fixed { dropout });

impl AttentionLayer {
    /// PyTorch's initial values. `heads` divides `width`.
    pub(super) fn new(
        init: &Init,
        width: usize,
        heads: usize,
        hidden: usize,
        dropout: f64,
    ) -> Self {
        let (at, dropout) = (init.at("self_attn"), Dropout::new(dropout));
        let out = at.at("out_proj");
        let self_attn = SelfAttention {
            in_proj_weight: at.at("in_proj_weight").xavier_uniform(&[3 * width, width], 1.0),
            in_proj_bias: at.at("in_proj_bias").zeros(&[3 * width]),
            out_proj: Linear {
                bias: Some(out.at("bias").zeros(&[width])),
                ..Linear::new(&out, width, width)
            },
            heads,
            dropout,
        };
        Self {
            self_attn,
            linear1: Linear::new(&init.at("linear1"), width, hidden),
            linear2: Linear::new(&init.at("linear2"), hidden, width),
            norm1: LayerNorm::new(&init.at("norm1"), width),
            norm2: LayerNorm::new(&init.at("norm2"), width),
            dropout,
        }
    }

    /// Tokens `[N, T, D]` to `[N, T, D]`.
    pub(super) fn forward<'t>(&self, x: Var<'t>) -> Var<'t> {
        let x = self.norm1.forward(x + self.dropout.forward(self.self_attn.forward(x)));
        let hidden = self.dropout.forward(self.linear1.forward_then(x, Activation::Relu));
        self.norm2.forward(x + self.dropout.forward(self.linear2.forward(hidden)))
    }
}

impl SelfAttention {
    fn forward<'t>(&self, x: Var<'t>) -> Var<'t> {
        let tape = x.tape();
        let [n, t, d] = x.dims();
        let (weight, bias) = (tape.param(&self.in_proj_weight), tape.param(&self.in_proj_bias));
        let packed = x.linear(weight, Some(bias), Activation::None);
        // [N, T, D] -> [N, heads, T, D / heads]
        let part = |k: usize| {
            let columns = packed.slice_axis(2, k * d..(k + 1) * d);
            columns.reshape(&[n, t, self.heads, d / self.heads]).permute(&[0, 2, 1, 3])
        };
        let (queries, keys, values) = (part(0), part(1), part(2));
        let scale = 1.0 / ((d / self.heads) as f32).sqrt();
        let scores = queries.matmul_transposed(keys, [false, true]).scale(scale);
        let mixed = self.dropout.forward(scores.softmax()).matmul(values);
        self.out_proj.forward(mixed.permute(&[0, 2, 1, 3]).reshape(&[n, t, d]))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use autodiff_lite::Tape;
    use ndarray::Array3;

    use super::*;

    /// Two heads over three tokens against the formula, written out in double precision.
    #[test]
    fn attention_by_its_formula() {
        let (t, d, heads) = (3, 4, 2);
        let layer = AttentionLayer::new(&Init::new(3), d, heads, 5, 0.0).self_attn;
        let x = Array3::from_shape_fn((1, t, d), |(_, i, j)| ((3 * i + j) as f32 * 0.7).sin());
        let tape = Tape::eval();
        let found = layer.forward(tape.constant(x.clone())).value();
        let w = |row: usize, column: usize| f64::from(layer.in_proj_weight.value[[row, column]]);
        let projected = |row: usize, token: usize| -> f64 {
            (0..d).map(|j| w(row, j) * f64::from(x[[0, token, j]])).sum()
        };
        let each = d / heads;
        for i in 0..t {
            let mut mixed = vec![0.0; d];
            for h in 0..heads {
                let score = |j: usize| -> f64 {
                    let sum: f64 = (h * each..(h + 1) * each)
                        .map(|c| projected(c, i) * projected(d + c, j))
                        .sum();
                    (sum / (each as f64).sqrt()).exp()
                };
                let total: f64 = (0..t).map(score).sum();
                for c in h * each..(h + 1) * each {
                    mixed[c] = (0..t).map(|j| score(j) / total * projected(2 * d + c, j)).sum();
                }
            }
            for o in 0..d {
                let out = &layer.out_proj.weight.value;
                let expected: f64 = (0..d).map(|c| f64::from(out[[o, c]]) * mixed[c]).sum();
                assert!((f64::from(found[[0, i, o]]) - expected).abs() < 1e-5);
            }
        }
    }
}
