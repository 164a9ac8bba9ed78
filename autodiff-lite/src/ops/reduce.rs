//! Sums, means, maxima and minima, over everything or along one axis.

use crate::kernels::{elementwise, reduce};
use crate::{Backward, Real, Var};

/// Sizes before, along and after an axis; the values; the extremes and where they stand.
type FindExtreme<F> = fn([usize; 3], &[F], &mut [F], &mut [u32]);

impl<F: Real> Var<'_, F> {
    /// The sum of all elements.
    ///
    /// # Shapes
    /// Any → `[]`.
    #[track_caller]
    #[inline(never)]
    pub fn sum(self) -> Self {
        self.total("sum", F::one())
    }

    /// The mean of all elements.
    ///
    /// # Shapes
    /// Any but empty → `[]`.
    ///
    /// # Panics
    /// If there is none.
    #[track_caller]
    #[inline(never)]
    pub fn mean(self) -> Self {
        let count = self.len();
        if count == 0 {
            self.tape.refuse("mean", "the mean of nothing", &[("input", &self.shape(), "")]);
        }
        self.total("mean", F::from_f64(1.0 / count as f64))
    }

    #[track_caller]
    fn total(self, name: &'static str, factor: F) -> Self {
        let x = self.value();
        let y = self.tape.pool.filled(&[], factor * reduce::sum(x.as_slice()));
        self.tape.record_fn(name, &[self], y, move |cx: &mut Backward<'_, F>| {
            let g = factor * *cx.grad_out().first().expect("a scalar has one element");
            spread(cx, |target| target.fill(g), |target| target.iter_mut().for_each(|t| *t += g));
        })
    }

    /// The sum along `axis`, which disappears.
    ///
    /// # Shapes
    /// `[.., n, ..]` → `[.., ..]`.
    #[track_caller]
    #[inline(never)]
    pub fn sum_axis(self, axis: usize) -> Self {
        self.along("sum_axis", axis, F::one())
    }

    /// The mean along `axis`, which disappears.
    ///
    /// # Shapes
    /// `[.., n, ..]` → `[.., ..]`.
    ///
    /// # Panics
    /// If the axis is empty or there is no such axis.
    #[track_caller]
    #[inline(never)]
    pub fn mean_axis(self, axis: usize) -> Self {
        let (_, [_, n, _]) = self.split_at_axis("mean_axis", axis, true);
        self.along("mean_axis", axis, F::from_f64(1.0 / n as f64))
    }

    #[track_caller]
    fn along(self, name: &'static str, axis: usize, factor: F) -> Self {
        let (shape, dims) = self.split_at_axis(name, axis, false);
        let x = self.value();
        let mut y = self.tape.array(&shape);
        let out = y.as_slice_mut();
        reduce::sum_axis(dims, x.as_slice(), out);
        if factor != F::one() {
            elementwise::scale_in_place(out, factor);
        }
        self.tape.record_fn(name, &[self], y, move |cx: &mut Backward<'_, F>| {
            let [_, n, inner] = dims;
            if n * inner == 0 {
                return;
            }
            let g = cx.grad_out();
            let g = g.as_slice();
            let rows = |target: &mut [F], write: fn(&mut F, F)| {
                for (target, g) in target.chunks_exact_mut(n * inner).zip(g.chunks_exact(inner)) {
                    for row in target.chunks_exact_mut(inner) {
                        row.iter_mut().zip(g).for_each(|(t, &g)| write(t, factor * g));
                    }
                }
            };
            spread(cx, |target| rows(target, |t, g| *t = g), |target| rows(target, |t, g| *t += g));
        })
    }

    /// The largest element along `axis`, which disappears. The gradient goes to the first of equal ones.
    ///
    /// # Shapes
    /// `[.., n, ..]` → `[.., ..]`.
    ///
    /// # Panics
    /// If the axis is empty or there is no such axis.
    #[track_caller]
    #[inline(never)]
    pub fn max_axis(self, axis: usize) -> Self {
        self.extreme("max_axis", axis, reduce::max_axis)
    }

    /// The smallest element along `axis`, which disappears. The gradient goes to the first of equal ones.
    ///
    /// # Shapes
    /// `[.., n, ..]` → `[.., ..]`.
    ///
    /// # Panics
    /// If the axis is empty or there is no such axis.
    #[track_caller]
    #[inline(never)]
    pub fn min_axis(self, axis: usize) -> Self {
        self.extreme("min_axis", axis, reduce::min_axis)
    }

    #[track_caller]
    fn extreme(self, name: &'static str, axis: usize, find: FindExtreme<F>) -> Self {
        let (shape, dims) = self.split_at_axis(name, axis, true);
        let x = self.value();
        let mut y = self.tape.array(&shape);
        let mut argument = self.tape.indices(y.len());
        find(dims, x.as_slice(), y.as_slice_mut(), &mut argument);
        self.tape.record_fn(name, &[self], y, move |cx: &mut Backward<'_, F>| {
            let [_, n, inner] = dims;
            let g = cx.grad_out();
            let target = cx.grad_slice_mut(0);
            for (k, (&g, &best)) in g.iter().zip(argument.iter()).enumerate() {
                target[((k / inner) * n + best as usize) * inner + k % inner] += g;
            }
        })
    }

    /// The largest of all elements; the gradient goes to the first of equal ones.
    ///
    /// # Shapes
    /// Any but empty → `[]`.
    ///
    /// # Panics
    /// If there is none.
    #[track_caller]
    #[inline(never)]
    pub fn max(self) -> Self {
        self.flat("max").max_axis(0)
    }

    /// The smallest of all elements; the gradient goes to the first of equal ones.
    ///
    /// # Shapes
    /// Any but empty → `[]`.
    ///
    /// # Panics
    /// If there is none.
    #[track_caller]
    #[inline(never)]
    pub fn min(self) -> Self {
        self.flat("min").min_axis(0)
    }

    /// All elements along one axis, for an operation that needs one at least.
    #[track_caller]
    fn flat(self, op: &'static str) -> Self {
        let count = self.len();
        if count == 0 {
            let message = format!("the {op}imum of nothing");
            self.tape.refuse(op, message, &[("input", &self.shape(), "")]);
        }
        self.reshape(&[count])
    }

    /// The shape without `axis`, and the sizes before, along and after it.
    #[track_caller]
    fn split_at_axis(
        self,
        op: &'static str,
        axis: usize,
        not_empty: bool,
    ) -> (Vec<usize>, [usize; 3]) {
        let mut shape = self.shape();
        let refuse = |shape: &[usize], message: String| {
            self.tape.refuse(op, message, &[("input", shape, "")])
        };
        if axis >= shape.len() {
            refuse(&shape, format!("there is no axis {axis}"));
        }
        if not_empty && shape[axis] == 0 {
            refuse(&shape, format!("axis {axis} is empty"));
        }
        let dims =
            [shape[..axis].iter().product(), shape[axis], shape[axis + 1..].iter().product()];
        shape.remove(axis);
        (shape, dims)
    }
}

/// Writes the gradient of input 0 when it is the first, else adds to it: no pass of zeros.
#[inline(never)]
pub(crate) fn spread<F: Real>(
    cx: &mut Backward<'_, F>,
    write: impl FnOnce(&mut [F]),
    add: impl FnOnce(&mut [F]),
) {
    if cx.is_first(0) {
        cx.give_with(0, write);
    } else {
        add(cx.grad_slice_mut(0));
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use ndarray::{Axis, arr2};
    use proptest::prelude::*;

    use crate::testkit::{Options, check, gradcheck};
    use crate::{Tape, Var};

    gradcheck!(sum: |x| x.sum(), shapes [[[3, 5]], [[]], [[2, 0]]]);
    gradcheck!(sum_twice: |x| x.sum() * x.mean(), shapes [[[3, 5]]]);
    gradcheck!(mean: |x| x.mean(), shapes [[[3, 5]], [[]]]);
    gradcheck!(sum_axis: |x| x.sum_axis(1), shapes [[[3, 5]], [[2, 3, 4]], [[2, 0]], [[2, 1, 3]]]);
    gradcheck!(sum_axis_added: |x| x.sum_axis(0) + x.mean_axis(0), shapes [[[3, 5]]]);
    gradcheck!(mean_axis: |x| x.mean_axis(0), shapes [[[3, 5]], [[2, 3, 4]], [[7]]]);
    gradcheck!(max_axis: |x| x.max_axis(1), shapes [[[3, 5]], [[2, 3, 4]], [[1, 1]]]);
    gradcheck!(max: |x| x.max(), shapes [[[3, 5]]]);
    gradcheck!(min_axis: |x| x.min_axis(1), shapes [[[3, 5]], [[2, 3, 4]], [[1, 1]]]);
    gradcheck!(min: |x| x.min(), shapes [[[3, 5]], [[]]]);

    proptest! {
        #[test]
        fn any_axis_of_any_shape(
            shape in proptest::collection::vec(1_usize..5, 1..5),
            pick in any::<proptest::sample::Index>(),
        ) {
            let axis = pick.index(shape.len());
            let options = Options::default();
            let inputs = options.draw(&[shape]);
            let tape = Tape::<f64>::eval();
            let x = tape.constant(inputs[0].clone());
            let expected = inputs[0].sum_axis(Axis(axis));
            let close = |a: &crate::Tensor<f64>| {
                a.shape() == expected.shape() && a.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-12)
            };
            prop_assert!(close(&x.sum_axis(axis).value()));
            let expected = inputs[0].map_axis(Axis(axis), |x| x.fold(f64::MIN, |a, &b| a.max(b)));
            prop_assert_eq!(x.max_axis(axis).value(), expected);
            let expected = inputs[0].map_axis(Axis(axis), |x| x.fold(f64::MAX, |a, &b| a.min(b)));
            prop_assert_eq!(x.min_axis(axis).value(), expected);
            check(&|x: &[Var<'_, f64>]| x[0].mean_axis(axis).square(), &inputs, &options).unwrap();
            check(&|x: &[Var<'_, f64>]| x[0].max_axis(axis), &inputs, &options).unwrap();
        }
    }

    #[test]
    fn of_equal_elements_the_first_gets_the_gradient() {
        let tape = Tape::<f32>::train(0);
        let x = tape.leaf(arr2(&[[1.0, 3.0, 3.0]]));
        let gradients = x.max_axis(1).sum().backward();
        assert_eq!(gradients.wrt(x).unwrap().as_slice(), [0.0, 1.0, 0.0]);
        let y = tape.leaf(arr2(&[[3.0, 1.0, 1.0]]));
        let gradients = y.min_axis(1).sum().backward();
        assert_eq!(gradients.wrt(y).unwrap().as_slice(), [0.0, 1.0, 0.0]);
    }

    #[test]
    #[should_panic(expected = "min: the minimum of nothing")]
    fn the_smallest_of_nothing() {
        let _ = Tape::<f32>::eval().constant(arr2::<f32, 0>(&[])).min();
    }

    #[test]
    #[should_panic(expected = "sum_axis: there is no axis 2")]
    fn a_missing_axis() {
        let tape = Tape::<f32>::eval();
        let _ = tape.constant(arr2(&[[1.0]])).sum_axis(2);
    }
}
