//! Cross-entropies of logits: what a network gives before a sigmoid or a softmax.

use autodiff_lite::kernels::transcendental::sigmoid;
use autodiff_lite::{Backward, Real, Var};

use crate::kernels::compare;
use crate::scalar::{record, same_shape, scalar, seed, wanted};

/// Binary cross-entropy of logits, averaged over all values.
///
/// ```text
/// mean( max(x, 0) - x t + ln(1 + e^-|x|) )   =   -mean(t ln p + (1 - t) ln(1 - p)),   p = sigmoid(x)
/// ```
///
/// Exact for logits of any size, where [`mask_bce`](crate::mask_bce) of their sigmoid has lost what it needs.
///
/// # Shapes
/// `logits` of any value and `target` with values in `[0, 1]`, of one shape → a scalar.
/// # Gradient
/// To `logits` only, `(sigmoid(x) - t) / count`; the target is data.
/// # Cost
/// One read forward, one read and one write backward.
/// # Panics
/// If the shapes differ.
/// # References
/// `binary_cross_entropy_with_logits` of PyTorch.
///
/// ```
/// use autodiff_lite::Tape;
/// let tape = Tape::<f64>::train(0);
/// let logits = tape.leaf(ndarray::arr1(&[0.0, 800.0]));
/// let target = tape.constant(ndarray::arr1(&[1.0, 0.0]));
/// let loss = losses::mask_bce_logits(logits, target);
/// assert_eq!(loss.item(), (2_f64.ln() + 800.0) / 2.0);
/// assert_eq!(loss.backward().wrt(logits).unwrap().as_slice(), [-0.25, 0.5]);
/// ```
#[track_caller]
pub fn mask_bce_logits<'t, F: Real>(logits: Var<'t, F>, target: Var<'t, F>) -> Var<'t, F> {
    let name = "mask_bce_logits";
    let tape = logits.tape();
    same_shape(name, ["logits", "target"], logits, target);
    let (x, t) = (logits.value(), target.value());
    let total = compare::sum(x.as_slice(), t.as_slice(), |x, t| {
        x.max(F::zero()) - x * t + (-x.abs()).exp().ln_1p()
    });
    let value = scalar(tape, total / x.len().max(1) as f64);
    tape.record_fn(name, &[logits, target], value, |cx: &mut Backward<'_, F>| {
        let (x, t) = (cx.input(0), cx.input(1));
        let scale = seed(cx) / F::from_f64(x.len().max(1) as f64);
        cx.give_with(0, |out| {
            compare::derivatives(x.as_slice(), t.as_slice(), scale, out, |x, t| sigmoid(x) - t);
        });
    })
}

/// Cross-entropy of logits over classes, averaged over the rows.
///
/// ```text
/// mean_i ( ln Σ_c e^(x_ic) - x_i,class(i) )
/// ```
///
/// # Shapes
/// `logits [.., C]` and one class below C for each row → a scalar.
/// # Gradient
/// To `logits`, `(softmax(x) - one-hot) / rows`.
/// # Cost
/// One read of the logits; the gradient is made in the same pass.
/// # Panics
/// If there are not as many classes as rows, or one is not below C.
/// # References
/// `cross_entropy` of PyTorch, with class indices.
///
/// ```
/// use autodiff_lite::Tape;
/// let tape = Tape::<f64>::train(0);
/// let logits = tape.leaf(ndarray::arr2(&[[0.0, 0.0, 0.0, 0.0]]));
/// let loss = losses::cross_entropy(logits, &[2]);
/// assert!((loss.item() - 4_f64.ln()).abs() < 1e-15);
/// assert_eq!(loss.backward().wrt(logits).unwrap().as_slice(), [0.25, 0.25, -0.75, 0.25]);
/// ```
#[track_caller]
pub fn cross_entropy<'t, F: Real>(logits: Var<'t, F>, classes: &[u32]) -> Var<'t, F> {
    let name = "cross_entropy";
    let shape = logits.shape();
    let width = shape.last().copied().unwrap_or(0);
    let rows: usize = shape[..shape.len().saturating_sub(1)].iter().product();
    let fits = !shape.is_empty()
        && classes.len() == rows
        && classes.iter().all(|&class| (class as usize) < width);
    if !fits {
        let message = format!("{} classes for {rows} rows of {width} logits", classes.len());
        logits.tape().refuse(name, message, &[("logits", &shape, ".., C")]);
    }
    let value = logits.value();
    let mut gradient = wanted(logits);
    let weight = F::from_f64(1.0 / rows.max(1) as f64);
    let mut total = 0.0;
    for (i, (row, &class)) in value.as_slice().chunks_exact(width.max(1)).zip(classes).enumerate() {
        let class = class as usize;
        let largest = row.iter().copied().fold(F::neg_infinity(), F::max);
        let sum: F = row.iter().map(|&x| (x - largest).exp()).sum();
        total += Real::to_f64(sum.ln() - (row[class] - largest));
        if let Some(gradient) = &mut gradient {
            let out = &mut gradient[i * width..(i + 1) * width];
            for (out, &x) in out.iter_mut().zip(row) {
                *out = weight * (x - largest).exp() / sum;
            }
            out[class] -= weight;
        }
    }
    record(name, [logits], total / rows.max(1) as f64, [gradient])
}

#[cfg(test)]
mod tests {
    use autodiff_lite::Tape;
    use autodiff_lite::testkit::gradcheck;
    use ndarray::ArrayD;

    use super::*;

    fn target(shape: &[usize]) -> ArrayD<f64> {
        let mut i = 0.0;
        ArrayD::from_shape_simple_fn(shape, || {
            i += 0.37;
            i % 1.0
        })
    }

    // The target is data, here a function of nothing.
    gradcheck!(binary: |x| mask_bce_logits(x, x.tape().constant(target(&x.shape()))),
        shapes [[[7]], [[2, 3, 4]]]);
    gradcheck!(classes: |x| cross_entropy(x, &[2, 0, 1]), shapes [[[3, 4]], [[3, 1, 3]]]);

    #[test]
    fn it_is_the_cross_entropy_of_the_sigmoid() {
        let tape = Tape::<f64>::eval();
        let x = tape.constant(ndarray::arr1(&[-3.0, 0.0, 0.4, 5.0]));
        let t = tape.constant(ndarray::arr1(&[1.0, 0.3, 0.0, 1.0]));
        let (own, other) = (mask_bce_logits(x, t).item(), crate::mask_bce(x.sigmoid(), t).item());
        assert!((own - other).abs() < 1e-14);
    }

    #[test]
    fn logits_of_any_size_have_finite_losses() {
        let tape = Tape::<f32>::train(0);
        let x = tape.leaf(ndarray::arr2(&[[1e30, -1e30, 200.0]]));
        let t = tape.constant(ndarray::arr2(&[[1.0, 0.0, 1.0]]));
        assert_eq!(mask_bce_logits(x, t).item(), 0.0);
        let loss = cross_entropy(x, &[1]);
        assert_eq!(loss.item(), 2e30);
        assert!(loss.backward().is_finite());
        assert!(mask_bce_logits(x, t).backward().is_finite());
    }

    #[test]
    #[should_panic(expected = "cross_entropy: 2 classes for 1 rows of 3 logits")]
    fn a_class_for_each_row() {
        let tape = Tape::<f32>::eval();
        let _ = cross_entropy(tape.constant(ndarray::Array2::zeros((1, 3))), &[0, 1]);
    }
}
