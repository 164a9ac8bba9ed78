//! Scaled dot-product attention of several heads as one operation.
//!
//! Vaswani et al. 2017, *Attention is all you need*, equation 1. Probabilities are saved for
//! backward, `[N, heads, T, T]`; scores and dropped probabilities are not.

use crate::kernels::attention::{
    AttentionGradients, AttentionOperands, AttentionSizes, attention, attention_grad,
};
use crate::kernels::dropout::Kept;
use crate::{Backward, Real, ShapeError, Shapes, Tensor, Var};

use super::dropout::{keep_mask, keep_scale};

impl<F: Real> Var<'_, F> {
    /// Attention of these queries to keys and values, split into `heads` groups of neighbouring columns of width
    /// `d = D / heads`:
    ///
    /// ```text
    /// y = dropout( softmax(Q Kᵀ / √d + mask) ) V
    /// ```
    ///
    /// The mask is added to the scores of every head and has no gradient; `-∞` forbids a pair, and each query needs
    /// one that is allowed, or its output is NaN. Dropout acts on probabilities and on training tapes alone, as in
    /// PyTorch.
    ///
    /// # Shapes
    /// `self [N, Tq, D]`, `keys` and `values` `[N, Tk, D]`, `mask [Tq, Tk]` or `[N, Tq, Tk]` → `[N, Tq, D]`.
    ///
    /// # Cost
    /// `4 N Tq Tk D` flops forward, `8 N Tq Tk D` backward; `N heads Tq Tk` numbers are kept.
    ///
    /// # Panics
    /// If sizes differ, `heads` does not divide `D`, or `dropout` is not within `[0, 1)`.
    #[track_caller]
    #[inline(never)]
    pub fn attention(
        self,
        keys: Self,
        values: Self,
        heads: usize,
        mask: Option<&Tensor<F>>,
        dropout: f64,
    ) -> Self {
        let (q, k, v) = (self.shape(), keys.shape(), values.shape());
        let sizes = self.tape.check("attention", |shapes| {
            let [batch, queries, width] = shapes.axes("queries", &q, ["N", "Tq", "D"])?;
            let [_, keys, _] = shapes.axes("keys", &k, ["N", "Tk", "D"])?;
            shapes.axes("values", &v, ["N", "Tk", "D"])?;
            check_heads(shapes, width, heads)?;
            check_mask(shapes, mask)?;
            Ok(AttentionSizes { batch, heads, queries, keys, width })
        });
        attend(&[self, keys, values], sizes, mask, dropout)
    }

    /// [`attention`](Self::attention) where queries, keys and values stand side by side, as one linear layer makes
    /// them.
    ///
    /// # Shapes
    /// `self [N, T, 3 D]`, `mask [T, T]` or `[N, T, T]` → `[N, T, D]`.
    ///
    /// # Panics
    /// As [`attention`](Self::attention).
    #[track_caller]
    #[inline(never)]
    pub fn self_attention(self, heads: usize, mask: Option<&Tensor<F>>, dropout: f64) -> Self {
        let x = self.shape();
        let sizes = self.tape.check("self_attention", |shapes| {
            let [batch, tokens, all] = shapes.axes("input", &x, ["N", "T", "3 D"])?;
            if all % 3 != 0 {
                return Err(shapes.error("queries, keys and values need as many columns each"));
            }
            // So that a mask is compared with both of its axes.
            let width = all / 3;
            let row = [batch, tokens, width];
            shapes.axes("queries", &row, ["N", "Tq", "D"])?;
            shapes.axes("keys", &row, ["N", "Tk", "D"])?;
            check_heads(shapes, width, heads)?;
            check_mask(shapes, mask)?;
            Ok(AttentionSizes { batch, heads, queries: tokens, keys: tokens, width })
        });
        attend(&[self], sizes, mask, dropout)
    }
}

fn check_heads(shapes: &Shapes, width: usize, heads: usize) -> Result<(), ShapeError> {
    if heads == 0 || !width.is_multiple_of(heads) {
        return Err(shapes.error(format!("{heads} heads do not divide {width} columns")));
    }
    Ok(())
}

fn check_mask<F: Real>(shapes: &mut Shapes, mask: Option<&Tensor<F>>) -> Result<(), ShapeError> {
    let Some(mask) = mask else { return Ok(()) };
    if mask.ndim() == 3 {
        shapes.axes("mask", mask.shape(), ["N", "Tq", "Tk"])?;
    } else {
        shapes.axes("mask", mask.shape(), ["Tq", "Tk"])?;
    }
    Ok(())
}

#[track_caller]
fn attend<'t, F: Real>(
    inputs: &[Var<'t, F>],
    sizes: AttentionSizes,
    mask: Option<&Tensor<F>>,
    dropout: f64,
) -> Var<'t, F> {
    let tape = inputs[0].tape();
    let kept = keep_mask(tape, sizes.probabilities(), dropout);
    let scale = keep_scale(dropout);
    let mut probabilities = tape.buffer(sizes.probabilities());
    let mut y = tape.array(&[sizes.batch, sizes.queries, sizes.width]);
    let values: Vec<_> = inputs.iter().map(|input| input.value()).collect();
    attention(
        &sizes,
        operands(&values),
        mask.map(Tensor::as_slice),
        kept.as_ref().map(|bits| Kept { bits, scale }),
        &mut probabilities,
        y.as_slice_mut(),
    );
    tape.record_fn("attention", inputs, y, move |cx: &mut Backward<'_, F>| {
        let values: Vec<_> = (0..cx.input_count()).map(|i| cx.input(i)).collect();
        let mut gradients: Vec<_> = values.iter().map(|x| cx.array(x.shape())).collect();
        let targets = match gradients.as_mut_slice() {
            [q, k, v] => AttentionGradients::Apart([q, k, v].map(Tensor::as_slice_mut)),
            all => AttentionGradients::Packed(all[0].as_slice_mut()),
        };
        let g = cx.grad_out();
        let kept = kept.as_ref().map(|bits| Kept { bits, scale });
        attention_grad(&sizes, operands(&values), kept, &probabilities, g.as_slice(), targets);
        for (i, gradient) in gradients.into_iter().enumerate() {
            cx.give(i, gradient);
        }
    })
}

fn operands<F: Real>(values: &[Tensor<F>]) -> AttentionOperands<'_, F> {
    match values {
        [q, k, v] => AttentionOperands::Apart([q, k, v].map(Tensor::as_slice)),
        values => AttentionOperands::Packed(values[0].as_slice()),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use ndarray::{Array2, Array3, ArrayD};

    use crate::testkit::gradcheck;
    use crate::{Tape, Tensor, Var};

    fn lower(tokens: usize) -> Tensor<f64> {
        let at = |(i, j)| if j > i { f64::NEG_INFINITY } else { 0.1 * j as f64 };
        Array2::from_shape_fn((tokens, tokens), at).into()
    }

    gradcheck!(one_head: |q, k, v| q.attention(k, v, 1, None, 0.0),
        shapes [[[2, 3, 4], [2, 5, 4], [2, 5, 4]], [[1, 1, 1], [1, 1, 1], [1, 1, 1]]]);
    gradcheck!(heads: |q, k, v| q.attention(k, v, 3, None, 0.0),
        shapes [[[2, 2, 6], [2, 3, 6], [2, 3, 6]], [[1, 4, 3], [1, 17, 3], [1, 17, 3]]]);
    gradcheck!(packed: |x| x.self_attention(2, None, 0.0), shapes [[[2, 3, 12]], [[1, 1, 6]]]);
    gradcheck!(masked: |x| x.self_attention(2, Some(&lower(3)), 0.0), shapes [[[2, 3, 12]]]);
    gradcheck!(dropped: |x| x.self_attention(2, None, 0.4), shapes [[[2, 3, 12]]]);
    gradcheck!(same_thrice: |x| x.attention(x, x, 2, None, 0.0), shapes [[[2, 3, 4]]]);

    fn noise(shape: &[usize], seed: f32) -> Tensor<f32> {
        let n = shape.iter().product::<usize>();
        let values = (0..n).map(|i| (i as f32 * 0.37 + seed).sin()).collect();
        ArrayD::from_shape_vec(shape, values).unwrap().into()
    }

    /// The same from the operations it is made of.
    fn composed(x: Var<'_>, heads: usize) -> Var<'_> {
        let [n, t, all] = x.dims();
        let (width, d) = (all / 3, all / 3 / heads);
        let [q, k, v] = [0, 1, 2].map(|i| {
            let part = x.slice_axis(2, i * width..(i + 1) * width);
            part.reshape(&[n, t, heads, d]).permute(&[0, 2, 1, 3])
        });
        let scores = q.matmul_transposed(k, [false, true]).scale(1.0 / (d as f32).sqrt());
        scores.softmax().matmul(v).permute(&[0, 2, 1, 3]).reshape(&[n, t, width])
    }

    #[test]
    fn it_is_what_it_is_made_of() {
        let tape = Tape::<f32>::train(0);
        let x = tape.leaf(noise(&[3, 5, 24], 0.0));
        let (fused, parts) = (x.self_attention(4, None, 0.0), composed(x, 4));
        let close = |a: &Tensor, b: &Tensor| {
            a.iter().zip(b).for_each(|(a, b)| assert!((a - b).abs() < 2e-6, "{a} and {b}"));
        };
        close(&fused.value(), &parts.value());
        let seed = noise(&[3, 5, 8], 1.0);
        let a = fused.backward_with(seed.clone()).wrt(x).unwrap().clone();
        let b = parts.backward_with(seed).wrt(x).unwrap().clone();
        close(&a, &b);
    }

    #[test]
    fn a_forbidden_token_changes_nothing() {
        let tape = Tape::<f32>::eval();
        let x = noise(&[1, 3, 6], 0.0);
        let mut other = x.clone();
        other.view_mut()[[0, 2, 3]] = 50.0;
        let mut mask = Array3::zeros((1, 3, 3));
        mask.slice_mut(ndarray::s![.., .., 2]).fill(f32::NEG_INFINITY);
        let mask = Tensor::from(mask);
        let run = |x: &Tensor| tape.constant(x.clone()).self_attention(1, Some(&mask), 0.0).value();
        assert_eq!(
            run(&x).slice(ndarray::s![.., ..2, ..]),
            run(&other).slice(ndarray::s![.., ..2, ..])
        );
        assert!(run(&x).iter().all(|x| x.is_finite()));
    }

    #[test]
    fn the_number_of_threads_changes_no_bit() {
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let tape = Tape::<f32>::train(3);
                let x = tape.leaf(noise(&[4, 70, 3 * 64], 0.5));
                let y = x.self_attention(4, None, 0.1);
                let g = y.square().sum().backward().wrt(x).unwrap().to_owned();
                (y.value(), g)
            })
        };
        let one = run(1);
        assert!(one == run(2) && one == run(3));
    }

    #[test]
    #[should_panic(expected = "3 heads do not divide 4 columns")]
    fn heads_divide_the_columns() {
        let tape = Tape::<f32>::eval();
        let _ = tape.constant(noise(&[1, 2, 12], 0.0)).self_attention(3, None, 0.0);
    }

    #[test]
    #[should_panic(expected = "Tk is 2 in keys and 3 in mask")]
    fn a_mask_has_the_size_of_the_scores() {
        let tape = Tape::<f32>::eval();
        let x = tape.constant(noise(&[1, 2, 12], 0.0));
        let _ = x.self_attention(2, Some(&noise(&[2, 3], 0.0)), 0.0);
    }
}
