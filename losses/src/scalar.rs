//! Scalars on the tape, and scalars whose gradients were made together with their value.
//!
//! A loss of a mesh is one number from a few thousand vertices: computing its gradient in the same pass
//! costs little more than the value, and the rule is then a single multiplication, which holds neither
//! faces nor edges.

use autodiff_lite::{Backward, PoolVec, Real, Tape, Tensor, Var};

/// 1, -1, or 0 of 0 and of what is not a number.
pub(crate) fn sign<F: Real>(x: F) -> F {
    if x > F::zero() {
        F::one()
    } else if x < F::zero() {
        -F::one()
    } else {
        F::zero()
    }
}

/// A tensor of no axes from the tape's pool.
pub(crate) fn scalar<F: Real>(tape: &Tape<F>, value: f64) -> Tensor<F> {
    tape.pool().filled(&[], F::from_f64(value))
}

/// A buffer of zeros for the gradient of `var`; `None` when nobody wants it.
pub(crate) fn wanted<F: Real>(var: Var<'_, F>) -> Option<PoolVec<F>> {
    var.tape().wants_grad(&[var]).then(|| {
        let mut buffer = var.tape().buffer(var.len());
        buffer.fill(F::zero());
        buffer
    })
}

/// Records a scalar with the gradients of its inputs.
#[track_caller]
pub(crate) fn record<'t, F: Real, const N: usize>(
    name: &'static str,
    inputs: [Var<'t, F>; N],
    value: f64,
    gradients: [Option<PoolVec<F>>; N],
) -> Var<'t, F> {
    let tape = inputs[0].tape();
    tape.record_fn(name, &inputs, scalar(tape, value), move |cx: &mut Backward<'_, F>| {
        let g = seed(cx);
        for (i, gradient) in gradients.iter().enumerate() {
            if let Some(gradient) = gradient {
                for (out, &d) in cx.grad_slice_mut(i).iter_mut().zip(gradient.iter()) {
                    *out += g * d;
                }
            }
        }
    })
}

/// The gradient that arrives at a scalar.
pub(crate) fn seed<F: Real>(cx: &Backward<'_, F>) -> F {
    cx.grad_out().first().copied().unwrap_or_else(F::zero)
}

/// How many meshes of how many vertices a `[V, 3]` or `[N, V, 3]` value holds.
#[track_caller]
pub(crate) fn vertices<F: Real>(op: &'static str, name: &str, var: Var<'_, F>) -> [usize; 2] {
    let shape = var.shape();
    var.tape().check(op, |shapes| {
        let [n, v, d] = if shape.len() == 2 {
            shapes.axes(name, &shape, ["V", "3"]).map(|[v, d]| [1, v, d])?
        } else {
            shapes.axes(name, &shape, ["N", "V", "3"])?
        };
        if d == 3 { Ok([n, v]) } else { Err(shapes.error("a vertex has three coordinates")) }
    })
}

/// Panics unless the two values have one shape.
#[track_caller]
pub(crate) fn same_shape<F: Real>(
    op: &'static str,
    names: [&str; 2],
    a: Var<'_, F>,
    b: Var<'_, F>,
) {
    let (x, y) = (a.shape(), b.shape());
    if x != y {
        let message = format!("{} and {} differ in shape", names[0], names[1]);
        a.tape().refuse(op, message, &[(names[0], &x, ""), (names[1], &y, "")]);
    }
}
