//! What a differentiable operation is.

use crate::{Backward, Real};

/// One differentiable operation with a single output.
///
/// The struct holds exactly what backward needs and forward knew; inputs and the output itself
/// are read from the tape. Any crate may define operations: [`Tape::record`](crate::Tape::record)
/// is the only way to record an op.
///
/// ```
/// use autodiff_lite::{Backward, Op, Real, Tape, Var};
///
/// /// y = x³, dy/dx = 3 x².
/// struct Cube;
/// impl<F: Real> Op<F> for Cube {
///     fn name(&self) -> &'static str {
///         "cube"
///     }
///     fn pullback(&self, cx: &mut Backward<'_, F>) {
///         let (x, mut g) = (cx.input(0), cx.take_grad_out());
///         g.view_mut().zip_mut_with(&x, |g, &x| *g *= F::from_f64(3.0) * x * x);
///         cx.give(0, g);
///     }
/// }
///
/// fn cube<F: Real>(x: Var<'_, F>) -> Var<'_, F> {
///     let y = x.value().mapv(|x| x * x * x);
///     x.tape().record(&[x], y, Cube)
/// }
///
/// let tape = Tape::<f32>::train(0);
/// let x = tape.leaf(ndarray::arr0(2.0));
/// let gradients = cube(x).backward();
/// assert_eq!(gradients.wrt(x).unwrap().sum(), 12.0);
/// ```
pub trait Op<F: Real>: Send + 'static {
    /// Its name in panics and profiles.
    fn name(&self) -> &'static str;

    /// Turns the gradient of the output into gradients of the inputs.
    fn pullback(&self, cx: &mut Backward<'_, F>);
}

/// An operation given as a closure; see [`Tape::record_fn`](crate::Tape::record_fn).
pub(crate) struct FnOp<C> {
    pub(crate) name: &'static str,
    pub(crate) pullback: C,
}

impl<F: Real, C: Fn(&mut Backward<'_, F>) + Send + 'static> Op<F> for FnOp<C> {
    fn name(&self) -> &'static str {
        self.name
    }

    fn pullback(&self, cx: &mut Backward<'_, F>) {
        (self.pullback)(cx);
    }
}
