//! Operations on pairs of elements of two arrays, which broadcast by NumPy's rules in both
//! directions; the operators `+ - * /`; linear combinations.

use crate::kernels::broadcast::Broadcast;
use crate::kernels::elementwise;
use crate::{Backward, Real, Tape, Tensor, Var, broadcast_shape};

macro_rules! pairwise {
    ($($(#[$doc:meta])* $name:ident: |$a:ident, $b:ident| $f:expr, |$da:pat_param, $db:pat_param, $dy:pat_param| $df:expr;)*) => {
        impl<F: Real> Var<'_, F> {
            $(
                $(#[$doc])*
                ///
                /// # Shapes
                /// Any two that broadcast by NumPy's rules: `[3, 1]` and `[4]` → `[3, 4]`.
                #[track_caller]
                #[allow(clippy::should_implement_trait, reason = "the traits are implemented too")]
                #[inline(never)]
                pub fn $name(self, other: Self) -> Self {
                    self.zip_named(
                        stringify!($name), other, |$a: F, $b: F| $f, |$da: F, $db: F, $dy: F| $df,
                    )
                }
            )*
        }
    };
}

pairwise! {
    /// `a + b`, broadcasting.
    add: |a, b| a + b, |_, _, _| (F::one(), F::one());
    /// `a - b`, broadcasting.
    sub: |a, b| a - b, |_, _, _| (F::one(), -F::one());
    /// `a b`, element by element, broadcasting.
    mul: |a, b| a * b, |a, b, _| (b, a);
    /// `a / b`, broadcasting.
    div: |a, b| a / b, |_, b, y| (b.recip(), -y / b);
    /// The larger of `a` and `b`, broadcasting; where they are equal each gets half the gradient. Not a number where either is none.
    maximum: |a, b| if a > b || a.is_nan() { a } else { b }, |a, b, _| share(a > b, a < b);
    /// The smaller of `a` and `b`, broadcasting; where they are equal each gets half the gradient. Not a number where either is none.
    minimum: |a, b| if a < b || a.is_nan() { a } else { b }, |a, b, _| share(a < b, a > b);
}

#[inline(always)]
fn share<F: Real>(first: bool, second: bool) -> (F, F) {
    let half = F::from_f64(0.5);
    match (first, second) {
        (true, _) => (F::one(), F::zero()),
        (_, true) => (F::zero(), F::one()),
        _ => (half, half),
    }
}

impl<F: Real> Var<'_, F> {
    /// `y = f(a, b)` for each pair of elements of `self` and `other`, which broadcast by NumPy's
    /// rules, with `(dy/da, dy/db) = df(a, b, y)`.
    ///
    /// # Shapes
    /// Any two that broadcast by NumPy's rules, `[3, 1]` and `[4]` → `[3, 4]`; a gradient is summed over the axes along
    /// which its operand was repeated.
    #[track_caller]
    pub fn zip(
        self,
        other: Self,
        f: impl Fn(F, F) -> F + Sync,
        df: impl Fn(F, F, F) -> (F, F) + Sync + Send + 'static,
    ) -> Self {
        self.zip_named("zip", other, f, df)
    }

    #[track_caller]
    pub(crate) fn zip_named(
        self,
        name: &'static str,
        other: Self,
        f: impl Fn(F, F) -> F + Sync,
        df: impl Fn(F, F, F) -> (F, F) + Sync + Send + 'static,
    ) -> Self {
        let (a, b) = (self.value(), other.value());
        let Some(shape) = broadcast_shape(a.shape(), b.shape()) else {
            let operands = [("left", a.shape(), ""), ("right", b.shape(), "")];
            self.tape.refuse(name, "the shapes do not broadcast", &operands)
        };
        let plan = Broadcast::new(a.shape(), b.shape());
        let mut y = self.tape.array(&shape);
        plan.zip(a.as_slice(), b.as_slice(), y.as_slice_mut(), f);
        self.tape.record_fn(name, &[self, other], y, move |cx: &mut Backward<'_, F>| {
            let (a, b, y, g) = (cx.input(0), cx.input(1), cx.output(), cx.grad_out());
            let operands = [&g, &a, &b, &y].map(Tensor::as_slice);
            let pull_a = |g: F, a: F, b: F, y: F| g * df(a, b, y).0;
            let pull_b = |g: F, a: F, b: F, y: F| g * df(a, b, y).1;
            // Without repetition a gradient is written once and moved; else it is summed into place.
            if plan.is_plain() {
                cx.give_with(0, |ga| elementwise::pull(operands, ga, pull_a));
                cx.give_with(1, |gb| elementwise::pull(operands, gb, pull_b));
                return;
            }
            if cx.needs(0) {
                plan.accumulate(0, operands, cx.grad_slice_mut(0), pull_a);
            }
            if cx.needs(1) {
                plan.accumulate(1, operands, cx.grad_slice_mut(1), pull_b);
            }
        })
    }
}

impl<F: Real> Tape<F> {
    /// `Σ c x` over terms of one shape, in one pass: the stages of an ODE step, a weighted loss.
    ///
    /// # Shapes
    /// Terms of one shape → the same shape.
    ///
    /// # Panics
    /// If there is no term, or the shapes differ.
    #[track_caller]
    #[inline(never)]
    pub fn lincomb<'t>(&'t self, terms: &[(F, Var<'t, F>)]) -> Var<'t, F> {
        let values: Vec<_> = terms.iter().map(|(_, x)| x.value()).collect();
        let Some(first) = values.first() else {
            self.refuse("lincomb", "at least one term expected", &[])
        };
        if let Some(other) = values.iter().find(|value| value.shape() != first.shape()) {
            let operands = [("first", first.shape(), ""), ("other", other.shape(), "")];
            self.refuse("lincomb", "all terms need one shape", &operands);
        }
        let mut y = self.array(first.shape());
        let slices: Vec<(F, &[F])> =
            terms.iter().zip(&values).map(|(&(c, _), x)| (c, x.as_slice())).collect();
        elementwise::lincomb(&slices, y.as_slice_mut());
        let inputs: Vec<_> = terms.iter().map(|&(_, x)| x).collect();
        let factors: Vec<F> = terms.iter().map(|&(c, _)| c).collect();
        self.record_fn("lincomb", &inputs, y, move |cx: &mut Backward<'_, F>| {
            let g = cx.grad_out();
            let g = g.as_slice();
            for (i, &c) in factors.iter().enumerate() {
                if cx.is_first(i) {
                    cx.give_with(i, |gx| elementwise::map(g, gx, |g| c * g));
                } else if cx.needs(i) {
                    elementwise::update(cx.grad_slice_mut(i), g, g, |x, g, _| x + c * g);
                }
            }
        })
    }
}

macro_rules! operators {
    ($($Trait:ident $method:ident |$x:ident, $c:ident| $scalar:expr, |$y:ident, $d:ident| $reversed:expr;)*) => {$(
        impl<F: Real> std::ops::$Trait for Var<'_, F> {
            type Output = Self;

            #[track_caller]
            fn $method(self, other: Self) -> Self {
                Var::$method(self, other)
            }
        }

        impl<F: Real> std::ops::$Trait<F> for Var<'_, F> {
            type Output = Self;

            #[track_caller]
            fn $method(self, $c: F) -> Self {
                let $x = self;
                $scalar
            }
        }

        impl<'t> std::ops::$Trait<Var<'t, f32>> for f32 {
            type Output = Var<'t, f32>;

            #[track_caller]
            fn $method(self, $y: Var<'t, f32>) -> Var<'t, f32> {
                let $d = self;
                $reversed
            }
        }

        impl<'t> std::ops::$Trait<Var<'t, f64>> for f64 {
            type Output = Var<'t, f64>;

            #[track_caller]
            fn $method(self, $y: Var<'t, f64>) -> Var<'t, f64> {
                let $d = self;
                $reversed
            }
        }
    )*};
}

operators! {
    Add add |x, c| x.add_scalar(c), |x, c| x.add_scalar(c);
    Sub sub |x, c| x.add_scalar(-c), |x, c| x.map_named("sub", move |x| c - x, |_, _| -1.0);
    Mul mul |x, c| x.scale(c), |x, c| x.scale(c);
    Div div |x, c| x.scale(c.recip()), |x, c| x.map_named("div", move |x| c / x, |x, y| -y / x);
}

impl<F: Real> std::ops::Neg for Var<'_, F> {
    type Output = Self;

    #[track_caller]
    fn neg(self) -> Self {
        Var::neg(self)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use ndarray::{ArrayD, IxDyn, arr1, arr2};
    use proptest::prelude::*;

    use super::*;
    use crate::testkit::{Options, check, gradcheck};

    fn positive() -> Options {
        Options::default().range(0.3, 2.0)
    }

    gradcheck!(add: |a, b| a + b, shapes [[[3, 5], [5]], [[2, 1, 4], [3, 1]], [[], [2, 2]], [[4], [4]]]);
    gradcheck!(sub: |a, b| a - b, shapes [[[3, 5], [5]], [[5], [3, 5]], [[4], [4]]]);
    gradcheck!(mul: |a, b| a * b, shapes [[[3, 5], [5]], [[2, 1, 4], [3, 1]], [[], [2, 2]], [[4], [4]]]);
    gradcheck!(div: |a, b| a / b, shapes [[[3, 5], [5]], [[1], [3, 5]], [[4], [4]]], options positive());
    gradcheck!(maximum: |a, b| a.maximum(b), shapes [[[3, 5], [5]], [[4], [4]]]);
    gradcheck!(minimum: |a, b| a.minimum(b), shapes [[[3, 5], [5]], [[4], [4]]]);
    gradcheck!(zip: |a, b| a.zip(b, |a, b| a * a * b, |a, b, _| (2.0 * a * b, a * a)), shapes [[[3, 5], [3, 1]]]);
    gradcheck!(the_same_input_twice: |a| a * a * a, shapes [[[3, 2]]]);
    gradcheck!(scalars: |a| 2.0 - (3.0 / (a * 0.5 + 4.0)) / 2.0 - 1.0, shapes [[[3, 2]]]);
    gradcheck!(lincomb: |a, b, x| x.tape().lincomb(&[(2.0, a), (-1.0, b), (0.5, a), (3.0, x)]),
        shapes [[[3, 2], [3, 2], [3, 2]], [[], [], []]]);

    /// Two shapes that broadcast: a common shape of which axes are dropped or set to one.
    fn shapes() -> impl Strategy<Value = [Vec<usize>; 2]> {
        proptest::collection::vec((1_usize..4, any::<bool>(), any::<bool>()), 0..5).prop_flat_map(
            |axes| {
                let rank = axes.len();
                (0..=rank, 0..=rank, Just(axes)).prop_map(|(cut_a, cut_b, axes)| {
                    let a = axes[cut_a..].iter().map(|&(n, one, _)| if one { 1 } else { n });
                    let b = axes[cut_b..].iter().map(|&(n, _, one)| if one { 1 } else { n });
                    [a.collect(), b.collect()]
                })
            },
        )
    }

    proptest! {
        #[test]
        fn values_broadcast_as_in_ndarray([a, b] in shapes()) {
            let shape = broadcast_shape(&a, &b).unwrap();
            let inputs = Options::default().draw(&[a, b]);
            let tape = Tape::<f64>::eval();
            let y = (tape.constant(inputs[0].clone()) - tape.constant(inputs[1].clone())).value();
            let wide = |x: &ArrayD<f64>| x.broadcast(IxDyn(&shape)).unwrap().to_owned();
            let expected = wide(&inputs[0]) - wide(&inputs[1]);
            prop_assert_eq!(y.view(), expected.view());
        }

        #[test]
        fn gradients_broadcast(shapes in shapes()) {
            let options = Options::default().range(0.5, 2.0);
            let inputs = options.draw(&shapes);
            check(&|x: &[Var<'_, f64>]| x[0] / x[1], &inputs, &options).unwrap();
        }
    }

    #[test]
    fn one_operand_may_need_no_gradient() {
        let tape = Tape::<f32>::train(0);
        let (x, c) = (tape.leaf(arr1(&[2.0, 3.0])), tape.constant(arr2(&[[4.0, 5.0], [6.0, 7.0]])));
        let gradients = (x * c).sum().backward();
        assert_eq!(gradients.wrt(x).unwrap().as_slice(), [10.0, 12.0]);
        assert!(gradients.wrt(c).is_none());
    }

    #[test]
    #[should_panic(expected = "add: the shapes do not broadcast\n  left   [2]\n  right  [3]")]
    fn shapes_that_do_not_fit() {
        let tape = Tape::<f32>::eval();
        let _ = tape.constant(arr1(&[1.0, 2.0])) + tape.constant(arr1(&[1.0, 2.0, 3.0]));
    }
}
