//! Operations on each element, and on pairs of elements of two arrays that broadcast.

use crate::kernels::broadcast::Broadcast;
use crate::kernels::elementwise;
use crate::{Backward, CONTIGUOUS, Op, Real, ShapeError, Var, broadcast_shape};

impl<'t, F: Real> Var<'t, F> {
    /// `y = f(x)` for each element, with `dy/dx = df(x, y)`.
    ///
    /// The way to a fused operation that this crate does not have: one pass forward, one back.
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
        elementwise::map(x.as_slice().expect(CONTIGUOUS), y.as_slice_mut().expect(CONTIGUOUS), f);
        self.tape.record(&[self], y, Map { name, df })
    }

    /// `y = f(a, b)` for each pair of elements of `self` and `other`, which broadcast by NumPy's
    /// rules, with `(dy/da, dy/db) = df(a, b, y)`.
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
            ShapeError::new(name, "the shapes do not broadcast")
                .operand("left", a.shape(), "")
                .operand("right", b.shape(), "")
                .at(self.tape.path())
                .panic();
        };
        let plan = Broadcast::new(a.shape(), b.shape());
        let mut y = self.tape.array(&shape);
        plan.zip(
            a.as_slice().expect(CONTIGUOUS),
            b.as_slice().expect(CONTIGUOUS),
            y.as_slice_mut().expect(CONTIGUOUS),
            f,
        );
        self.tape.record(&[self, other], y, Zip { name, plan, df })
    }

    /// `x²`.
    #[track_caller]
    pub fn square(self) -> Self {
        self.map_named("square", |x| x * x, |x, _| x + x)
    }

    /// `a + b`, broadcasting.
    #[track_caller]
    pub fn add(self, other: Self) -> Self {
        self.zip_named("add", other, |a, b| a + b, |_, _, _| (F::one(), F::one()))
    }

    /// `a * b`, broadcasting.
    #[track_caller]
    pub fn mul(self, other: Self) -> Self {
        self.zip_named("mul", other, |a, b| a * b, |a, b, _| (b, a))
    }
}

struct Map<D> {
    name: &'static str,
    df: D,
}

impl<F: Real, D: Fn(F, F) -> F + Sync + Send + 'static> Op<F> for Map<D> {
    fn name(&self) -> &'static str {
        self.name
    }

    fn pullback(&self, cx: &mut Backward<'_, F>) {
        let (x, y, mut g) = (cx.input(0), cx.output(), cx.take_grad_out());
        elementwise::update(
            g.as_slice_mut().expect(CONTIGUOUS),
            x.as_slice().expect(CONTIGUOUS),
            y.as_slice().expect(CONTIGUOUS),
            |g, x, y| g * (self.df)(x, y),
        );
        cx.give(0, g);
    }
}

struct Zip<D> {
    name: &'static str,
    plan: Broadcast,
    df: D,
}

impl<F: Real, D: Fn(F, F, F) -> (F, F) + Sync + Send + 'static> Op<F> for Zip<D> {
    fn name(&self) -> &'static str {
        self.name
    }

    fn pullback(&self, cx: &mut Backward<'_, F>) {
        let (a, b, y, g) = (cx.input(0), cx.input(1), cx.output(), cx.grad_out());
        let [a, b, y, g] = [&a, &b, &y, &g].map(|x| x.as_slice().expect(CONTIGUOUS));
        if cx.needs(0) {
            let target = cx.grad_slice_mut(0);
            self.plan.accumulate(0, [g, a, b, y], target, |g, a, b, y| g * (self.df)(a, b, y).0);
        }
        if cx.needs(1) {
            let target = cx.grad_slice_mut(1);
            self.plan.accumulate(1, [g, a, b, y], target, |g, a, b, y| g * (self.df)(a, b, y).1);
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::testkit::gradcheck;

    gradcheck!(square: |x| x.square(), shapes [[[3, 5]], [[]], [[1, 0]]]);
    gradcheck!(add: |a, b| a.add(b), shapes [[[3, 5], [5]], [[2, 1, 4], [3, 1]], [[], [2, 2]], [[4], [4]]]);
    gradcheck!(mul: |a, b| a.mul(b), shapes [[[3, 5], [5]], [[2, 1, 4], [3, 1]], [[], [2, 2]], [[4], [4]]]);
    gradcheck!(the_same_input_twice: |a| a.mul(a).mul(a), shapes [[[3, 2]]]);
}
