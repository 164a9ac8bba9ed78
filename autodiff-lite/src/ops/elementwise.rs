//! Operations on each element of one array.
//!
//! A rule is given the input and the output, whichever is cheaper to differentiate from.

use crate::kernels::elementwise;
use crate::{Backward, Real, Var};

macro_rules! unary {
    ($($(#[$doc:meta])* $name:ident($($p:ident),*): |$x:ident| $f:expr, |$dx:pat_param, $dy:pat_param| $df:expr;)*) => {
        impl<F: Real> Var<'_, F> {
            $(
                $(#[$doc])*
                ///
                /// # Shapes
                /// Any → the same.
                #[track_caller]
                #[inline(never)]
                pub fn $name(self $(, $p: F)*) -> Self {
                    self.map_named(stringify!($name), move |$x: F| $f, move |$dx: F, $dy: F| $df)
                }
            )*
        }
    };
}

/// A constant of the type.
#[inline(always)]
fn c<F: Real>(x: f64) -> F {
    F::from_f64(x)
}

/// `x`, or the end of `[low, high]` that it is beyond; not a number where `x` is none.
#[inline(always)]
fn within<F: Real>(x: F, low: F, high: F) -> F {
    if x < low {
        low
    } else if x > high {
        high
    } else {
        x
    }
}

/// Φ(x), the share of a Gaussian below x.
#[inline(always)]
fn normal_distribution<F: Real>(x: F) -> F {
    c::<F>(0.5) + c::<F>(0.5) * (x * c(std::f64::consts::FRAC_1_SQRT_2)).fast_erf()
}

unary! {
    /// `c x`.
    scale(factor): |x| factor * x, |_, _| factor;
    /// `x + c`.
    add_scalar(summand): |x| x + summand, |_, _| F::one();
    /// `eˣ`; in `f32` by a polynomial with a relative error below 2e-7.
    exp(): |x| x.fast_exp(), |_, y| y;
    /// The natural logarithm. Its gradient at 0 is infinite.
    ln(): |x| x.ln(), |x, _| x.recip();
    /// The square root. Its gradient at 0 is infinite: add a small number first, or clamp.
    sqrt(): |x| x.sqrt(), |_, y| c::<F>(0.5) / y;
    /// `x²`.
    square(): |x| x * x, |x, _| x + x;
    /// `1 / x`.
    recip(): |x| x.recip(), |_, y| -y * y;
    /// The sine.
    sin(): |x| x.sin(), |x, _| x.cos();
    /// The cosine.
    cos(): |x| x.cos(), |x, _| -x.sin();
    /// The absolute value; its gradient at 0 is 0.
    abs(): |x| x.abs(), |x, _| {
        if x > F::zero() { F::one() } else if x < F::zero() { -F::one() } else { F::zero() }
    };
    /// `max(x, 0)`; its gradient at 0 is 0.
    relu(): |x| if x <= F::zero() { F::zero() } else { x },
        |x, _| if x > F::zero() { F::one() } else { F::zero() };
    /// `x` where positive, else `slope x`.
    leaky_relu(slope): |x| if x > F::zero() { x } else { slope * x },
        |x, _| if x > F::zero() { F::one() } else { slope };
    /// `x` where positive, else `eˣ - 1`.
    elu(): |x| if x > F::zero() { x } else { x.fast_exp_m1() },
        |x, y| if x > F::zero() { F::one() } else { y + F::one() };
    /// `ln(1 + eˣ)`, without overflow.
    softplus(): |x| x.max(F::zero()) + (-x.abs()).fast_exp().ln_1p(), |x, _| x.fast_sigmoid();
    /// `1 / (1 + e⁻ˣ)`.
    sigmoid(): |x| x.fast_sigmoid(), |_, y| y * (F::one() - y);
    /// The hyperbolic tangent.
    tanh(): |x| x.fast_tanh(), |_, y| F::one() - y * y;
    /// `x Φ(x)`, Φ being the Gaussian distribution: exact, not the form with the hyperbolic tangent.
    gelu(): |x| x * normal_distribution(x), |x, _| {
        normal_distribution(x) + x * (c::<F>(-0.5) * x * x).fast_exp() * c(0.3989422804014327)
    };
    /// `x / (1 + e⁻ˣ)`: SiLU, also called Swish.
    silu(): |x| x * x.fast_sigmoid(), |x, _| {
        let s = x.fast_sigmoid();
        s + x * s * (F::one() - s)
    };
    /// `clamp(x / 6 + 1/2, 0, 1)`, as in PyTorch.
    hardsigmoid(): |x| within(x / c(6.0) + c(0.5), F::zero(), F::one()),
        |x, _| if x > c(-3.0) && x < c(3.0) { c(1.0 / 6.0) } else { F::zero() };
    /// `x` kept within `[low, high]`; the gradient is 1 there, ends included, and 0 outside.
    clamp(low, high): |x| within(x, low, high),
        |x, _| if x >= low && x <= high { F::one() } else { F::zero() };
    /// `xᵖ` for `x > 0`.
    powf(exponent): |x| x.powf(exponent), |x, _| exponent * x.powf(exponent - F::one());
}

impl<F: Real> Var<'_, F> {
    /// `-x`.
    ///
    /// # Shapes
    /// Any → the same.
    #[track_caller]
    #[allow(clippy::should_implement_trait, reason = "the trait is implemented too")]
    #[inline(never)]
    pub fn neg(self) -> Self {
        self.map_named("neg", |x| -x, |_, _| -F::one())
    }

    /// `xⁿ` for a whole number `n`.
    ///
    /// # Shapes
    /// Any → the same.
    #[track_caller]
    #[inline(never)]
    pub fn powi(self, n: i32) -> Self {
        let factor = F::from_f64(n as f64);
        let derivative =
            move |x: F, _| if n == 0 { F::zero() } else { factor * x.powi(n.saturating_sub(1)) };
        self.map_named("powi", move |x| x.powi(n), derivative)
    }

    /// `y = f(x)` for each element, with `dy/dx = df(x, y)`.
    ///
    /// The way to a fused operation that this crate does not have: one pass forward, one back.
    ///
    /// ```
    /// use autodiff_lite::Tape;
    ///
    /// let tape = Tape::<f64>::train(0);
    /// let x = tape.leaf(ndarray::arr1(&[0.5, -2.0]));
    /// let y = x.map(|x| x / (1.0 + x.abs()), |x, _| (1.0 + x.abs()).powi(-2)).sum();
    /// let gradients = y.backward();
    /// assert_eq!(gradients.wrt(x).unwrap().as_slice(), [1.0 / 2.25, 1.0 / 9.0]);
    /// ```
    ///
    /// # Shapes
    /// Any → the same.
    #[track_caller]
    pub fn map(
        self,
        f: impl Fn(F) -> F + Sync,
        df: impl Fn(F, F) -> F + Sync + Send + 'static,
    ) -> Self {
        self.map_named("map", f, df)
    }

    #[track_caller]
    pub(crate) fn map_named(
        self,
        name: &'static str,
        f: impl Fn(F) -> F + Sync,
        df: impl Fn(F, F) -> F + Sync + Send + 'static,
    ) -> Self {
        let x = self.value();
        let mut y = self.tape.array(x.shape());
        elementwise::map(x.as_slice(), y.as_slice_mut(), f);
        self.tape.record_fn(name, &[self], y, move |cx: &mut Backward<'_, F>| {
            let (x, y, mut g) = (cx.input(0), cx.output(), cx.take_grad_out());
            let (x, y) = (x.as_slice(), y.as_slice());
            elementwise::update(g.as_slice_mut(), x, y, |g, x, y| g * df(x, y));
            cx.give(0, g);
        })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::Tape;
    use crate::testkit::{Options, check, function, gradcheck};

    fn positive() -> Options {
        Options::default().range(0.2, 2.0)
    }

    fn kinks(at: &[f64]) -> Options {
        Options::default().kinks(at)
    }

    gradcheck!(scale: |x| x.scale(-2.5), shapes [[[3, 5]], [[]], [[1, 0]]]);
    gradcheck!(add_scalar: |x| x.add_scalar(2.0).square(), shapes [[[3, 5]]]);
    gradcheck!(exp: |x| x.exp(), shapes [[[3, 5]], [[]]]);
    gradcheck!(ln: |x| x.ln(), shapes [[[3, 5]]], options positive());
    gradcheck!(sqrt: |x| x.sqrt(), shapes [[[3, 5]]], options positive());
    gradcheck!(square: |x| x.square(), shapes [[[3, 5]], [[]], [[1, 0]]]);
    gradcheck!(recip: |x| x.recip(), shapes [[[3, 5]]], options positive());
    gradcheck!(sin: |x| x.sin(), shapes [[[3, 5]]]);
    gradcheck!(cos: |x| x.cos(), shapes [[[3, 5]]]);
    gradcheck!(abs: |x| x.abs(), shapes [[[3, 5]]], options kinks(&[0.0]));
    gradcheck!(relu: |x| x.relu(), shapes [[[3, 5]]], options kinks(&[0.0]));
    gradcheck!(leaky_relu: |x| x.leaky_relu(0.2), shapes [[[3, 5]]], options kinks(&[0.0]));
    gradcheck!(elu: |x| x.elu(), shapes [[[3, 5]]], options kinks(&[0.0]));
    gradcheck!(softplus: |x| x.softplus(), shapes [[[3, 5]]]);
    gradcheck!(sigmoid: |x| x.sigmoid(), shapes [[[3, 5]]]);
    gradcheck!(tanh: |x| x.tanh(), shapes [[[3, 5]]]);
    gradcheck!(gelu: |x| x.gelu(), shapes [[[3, 5]], [[40]]], options Options::default().range(-4.0, 4.0));
    gradcheck!(silu: |x| x.silu(), shapes [[[3, 5]], [[40]]]);
    gradcheck!(hardsigmoid: |x| x.hardsigmoid(), shapes [[[30]]], options kinks(&[-3.0, 3.0]).range(-5.0, 5.0));
    gradcheck!(clamp: |x| x.clamp(-0.5, 0.7), shapes [[[30]]], options kinks(&[-0.5, 0.7]));
    gradcheck!(powi: |x| x.powi(3), shapes [[[3, 5]]]);
    gradcheck!(powi_negative: |x| x.powi(-2), shapes [[[3, 5]]], options positive());
    gradcheck!(powf: |x| x.powf(1.7), shapes [[[3, 5]]], options positive());
    gradcheck!(neg: |x| x.neg(), shapes [[[3, 5]]]);
    gradcheck!(map: |x| x.map(|x| x * x * x, |x, _| 3.0 * x * x), shapes [[[3, 5]]]);

    proptest! {
        /// All of them, on a random shape with random values.
        #[test]
        fn every_operation_at_random_shapes(
            shape in proptest::collection::vec(0_usize..5, 0..5),
            seed in any::<u64>(),
        ) {
            let near = Options { seed, ..kinks(&[-0.5, 0.0, 0.7]) };
            let above = Options { seed, ..positive() };
            let all = function(|x| {
                let x = x[0];
                let (a, b) = (x.scale(0.3).add_scalar(0.1), x.leaky_relu(0.1).neg());
                let terms = [
                    x.exp(), x.square(), x.sin(), x.cos(), x.abs(), x.relu(), b, x.elu(), a,
                    x.softplus(), x.sigmoid(), x.tanh(), x.silu(), x.hardsigmoid(), x.clamp(-0.5, 0.7), x.powi(3),
                ];
                let weighted: Vec<_> =
                    terms.iter().enumerate().map(|(k, &t)| (1.0 + 0.1 * k as f64, t)).collect();
                x.tape().lincomb(&weighted)
            });
            check(&all, &near.draw(std::slice::from_ref(&shape)), &near).unwrap();
            let all = function(|x| x[0].ln() * x[0].sqrt() + x[0].recip() * x[0].powf(1.3));
            check(&all, &above.draw(&[shape]), &above).unwrap();
        }
    }

    #[test]
    fn values_are_those_of_the_formulas() {
        let tape = Tape::<f64>::eval();
        let x = tape.constant(ndarray::arr1(&[-4.0, -0.5, 0.0, 2.0]));
        let check = |y: Var<'_, f64>, expected: [f64; 4]| {
            let y = y.value();
            for (y, e) in y.iter().zip(expected) {
                assert!((y - e).abs() < 1e-15, "{y} instead of {e}");
            }
        };
        check(x.relu(), [0.0, 0.0, 0.0, 2.0]);
        check(x.leaky_relu(0.1), [-0.4, -0.05, 0.0, 2.0]);
        check(x.hardsigmoid(), [0.0, 0.5 - 0.5 / 6.0, 0.5, 0.5 + 2.0 / 6.0]);
        check(x.clamp(-1.0, 1.0), [-1.0, -0.5, 0.0, 1.0]);
        check(x.abs(), [4.0, 0.5, 0.0, 2.0]);
        // x erfc(-x / √2) / 2 by Python's math module.
        check(x.gelu(), [-0.00012668496733247986, -0.15426876936299344, 0.0, 1.9544997361036416]);
        // x / (1 + exp(-x)) by Python's math module.
        check(x.silu(), [-0.07194483984836623, -0.1887703343990727, 0.0, 1.7615941559557646]);
        check(x.powi(3), [-64.0, -0.125, 0.0, 8.0]);
        // ln(1 + e⁻⁴) = 0.018149927917809...
        check(
            x.softplus(),
            [0.01814992791780974, 0.47407698418010663, 2.0_f64.ln(), 2.1269280110429727],
        );
        check(
            tape.constant(ndarray::arr1(&[800.0, -800.0, 0.0, 1.0])).sigmoid(),
            [1.0, 0.0, 0.5, 0.7310585786300049],
        );
    }

    #[test]
    fn gradients_at_kinks_are_those_of_pytorch() {
        let tape = Tape::<f32>::train(0);
        let x = tape.leaf(ndarray::arr1(&[0.0]));
        for (y, expected) in
            [(x.relu(), 0.0), (x.abs(), 0.0), (x.clamp(0.0, 1.0), 1.0), (x.powi(0), 0.0)]
        {
            assert_eq!(y.sum().backward().wrt(x).unwrap()[0], expected);
        }
    }

    #[test]
    fn not_a_number_stays_visible() {
        let tape = Tape::<f32>::eval();
        let x = tape.constant(ndarray::arr1(&[f32::NAN]));
        let one = tape.constant(ndarray::arr1(&[1.0]));
        let both = tape.concat(&[one, x, one], 0);
        for y in [
            x.relu(),
            x.exp(),
            x.sigmoid(),
            x.tanh(),
            x.square(),
            x.leaky_relu(0.1),
            x.hardsigmoid(),
            x.clamp(-1.0, 1.0),
            x.maximum(one),
            one.maximum(x),
            x.minimum(one),
            one.minimum(x),
            both.max_axis(0),
            both.min_axis(0),
        ] {
            assert!(y.value().iter().all(|y| y.is_nan()), "{y:?}");
        }
    }
}
