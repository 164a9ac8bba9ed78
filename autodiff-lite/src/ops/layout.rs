//! The same elements in another arrangement: reshape, permute, concat, stack, slice.

use std::ops::Range;

use crate::kernels::rows;
use crate::{Backward, Real, Tape, Var};

impl<F: Real> Var<'_, F> {
    /// The same elements in row-major order under another shape. Nothing is copied.
    ///
    /// # Shapes
    /// Any → `shape`, of as many elements.
    ///
    /// # Panics
    /// If the number of elements differs.
    #[track_caller]
    #[inline(never)]
    pub fn reshape(self, shape: &[usize]) -> Self {
        let x = self.value();
        if x.len() != shape.iter().product::<usize>() {
            let operands = [("input", x.shape(), ""), ("wanted", shape, "")];
            self.tape.refuse("reshape", "the number of elements differs", &operands);
        }
        let y = x.into_shape(shape);
        self.tape.record_fn("reshape", &[self], y, |cx: &mut Backward<'_, F>| {
            let g = cx.take_grad_out().into_shape(cx.input(0).shape());
            cx.give(0, g);
        })
    }

    /// An axis of size one before axis `axis`.
    ///
    /// # Shapes
    /// `[.., ..]` → `[.., 1, ..]`, 1 being axis `axis` of the result.
    #[track_caller]
    #[inline(never)]
    pub fn insert_axis(self, axis: usize) -> Self {
        let mut shape = self.shape();
        if axis > shape.len() {
            let message = format!("there is no place {axis}");
            self.tape.refuse("insert_axis", message, &[("input", &shape, "")]);
        }
        shape.insert(axis, 1);
        self.reshape(&shape)
    }

    /// The axes in another order: axis `k` of the result is axis `order[k]`.
    ///
    /// # Shapes
    /// `[A, B, C]` with `order` `[2, 0, 1]` → `[C, A, B]`; any number of axes.
    ///
    /// # Panics
    /// If `order` does not name each axis once.
    #[track_caller]
    #[inline(never)]
    pub fn permute(self, order: &[usize]) -> Self {
        let x = self.value();
        let mut named = order.to_vec();
        named.sort_unstable();
        if !named.iter().copied().eq(0..x.ndim()) {
            let message = format!("{order:?} does not name each axis once");
            self.tape.refuse("permute", message, &[("input", x.shape(), "")]);
        }
        let shape: Vec<usize> = order.iter().map(|&axis| x.shape()[axis]).collect();
        let mut y = self.tape.array(&shape);
        rows::permute(x.shape(), order, x.as_slice(), y.as_slice_mut());
        let mut back = vec![0; order.len()];
        for (k, &axis) in order.iter().enumerate() {
            back[axis] = k;
        }
        self.tape.record_fn("permute", &[self], y, move |cx: &mut Backward<'_, F>| {
            let g = cx.grad_out();
            cx.give_with(0, |gx| rows::permute(g.shape(), &back, g.as_slice(), gx));
        })
    }

    /// Elements `range` along `axis`.
    ///
    /// # Shapes
    /// `[.., n, ..]` → `[.., range.len(), ..]`.
    ///
    /// # Panics
    /// If the range is not within the axis.
    #[track_caller]
    #[inline(never)]
    pub fn slice_axis(self, axis: usize, range: Range<usize>) -> Self {
        let x = self.value();
        let shape = x.shape();
        if axis >= shape.len() || range.start > range.end || range.end > shape[axis] {
            let message = format!("{range:?} is not within axis {axis}");
            self.tape.refuse("slice_axis", message, &[("input", shape, "")]);
        }
        let inner: usize = shape[axis + 1..].iter().product();
        let (full, offset, part) = (shape[axis] * inner, range.start * inner, range.len() * inner);
        let mut wanted = shape.to_vec();
        wanted[axis] = range.len();
        let mut y = self.tape.array(&wanted);
        if part > 0 {
            let source = x.as_slice().chunks_exact(full);
            let target = y.as_slice_mut().chunks_exact_mut(part);
            for (x, y) in source.zip(target) {
                y.copy_from_slice(&x[offset..offset + part]);
            }
        }
        self.tape.record_fn("slice_axis", &[self], y, move |cx: &mut Backward<'_, F>| {
            if part == 0 {
                return;
            }
            let g = cx.grad_out();
            let target = cx.grad_slice_mut(0).chunks_exact_mut(full);
            for (g, target) in g.as_slice().chunks_exact(part).zip(target) {
                let target = &mut target[offset..offset + part];
                target.iter_mut().zip(g).for_each(|(t, &g)| *t += g);
            }
        })
    }

    /// Element `index` along `axis`, which disappears.
    ///
    /// # Shapes
    /// `[.., n, ..]` → `[.., ..]`.
    ///
    /// # Panics
    /// If there is no such element.
    #[track_caller]
    #[inline(never)]
    pub fn index_axis(self, axis: usize, index: usize) -> Self {
        let mut shape = self.shape();
        if shape.get(axis).is_none_or(|&size| index >= size) {
            let message = format!("there is no element {index} along axis {axis}");
            self.tape.refuse("index_axis", message, &[("input", &shape, "")]);
        }
        let part = self.slice_axis(axis, index..index + 1);
        shape.remove(axis);
        part.reshape(&shape)
    }
}

impl<F: Real> Tape<F> {
    /// Values one after the other along `axis`.
    ///
    /// # Shapes
    /// `parts [.., n, ..]`, `[.., m, ..]` and so on, alike but for axis `axis` → `[.., n + m + .., ..]`.
    ///
    /// # Panics
    /// If there is no value, or they differ in another axis than `axis`.
    #[track_caller]
    #[inline(never)]
    pub fn concat<'t>(&'t self, parts: &[Var<'t, F>], axis: usize) -> Var<'t, F> {
        let values: Vec<_> = parts.iter().map(|part| part.value()).collect();
        let Some(first) = values.first() else {
            self.refuse("concat", "at least one value expected", &[])
        };
        let first_operand = ("first", first.shape(), "");
        if axis >= first.ndim() {
            self.refuse("concat", format!("there is no axis {axis}"), &[first_operand]);
        }
        let mut shape = first.shape().to_vec();
        shape[axis] = 0;
        for value in &values {
            let alike = |(k, (a, b)): (usize, (&usize, &usize))| k == axis || a == b;
            if value.ndim() != shape.len()
                || !first.shape().iter().zip(value.shape()).enumerate().all(alike)
            {
                let operands = [first_operand, ("other", value.shape(), "")];
                self.refuse("concat", format!("only axis {axis} may differ"), &operands);
            }
            shape[axis] += value.shape()[axis];
        }
        let inner: usize = shape[axis + 1..].iter().product();
        let full = shape[axis] * inner;
        let widths: Vec<usize> = values.iter().map(|v| v.shape()[axis] * inner).collect();
        let mut y = self.array(&shape);
        let out = y.as_slice_mut();
        let mut offset = 0;
        for (value, &width) in values.iter().zip(&widths) {
            if width > 0 {
                let source = value.as_slice().chunks_exact(width);
                for (x, y) in source.zip(out.chunks_exact_mut(full)) {
                    y[offset..offset + width].copy_from_slice(x);
                }
            }
            offset += width;
        }
        self.record_fn("concat", parts, y, move |cx: &mut Backward<'_, F>| {
            let g = cx.grad_out();
            let mut offset = 0;
            for (i, &width) in widths.iter().enumerate() {
                if width > 0 {
                    cx.give_with(i, |part| {
                        let rows = g.as_slice().chunks_exact(full);
                        for (t, g) in part.chunks_exact_mut(width).zip(rows) {
                            t.copy_from_slice(&g[offset..offset + width]);
                        }
                    });
                }
                offset += width;
            }
        })
    }

    /// Values of one shape along a new axis.
    ///
    /// # Shapes
    /// `k` parts of one shape `[.., ..]` → `[.., k, ..]`, `k` being axis `axis` of the result.
    ///
    /// # Panics
    /// If there is no value, or the shapes differ.
    #[track_caller]
    #[inline(never)]
    pub fn stack<'t>(&'t self, parts: &[Var<'t, F>], axis: usize) -> Var<'t, F> {
        let shapes: Vec<_> = parts.iter().map(|part| part.shape()).collect();
        let Some(first) = shapes.first() else {
            self.refuse("stack", "at least one value expected", &[])
        };
        if let Some(other) = shapes.iter().find(|shape| *shape != first) {
            let operands = [("first", &first[..], ""), ("other", &other[..], "")];
            self.refuse("stack", "all values need one shape", &operands);
        }
        let parts: Vec<_> = parts.iter().map(|part| part.insert_axis(axis)).collect();
        self.concat(&parts, axis)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use ndarray::arr2;
    use proptest::prelude::*;

    use crate::Tape;
    use crate::testkit::{Options, check, function, gradcheck};

    gradcheck!(reshape: |x| x.reshape(&[5, 3]).square(), shapes [[[3, 5]], [[15]], [[1, 3, 5]]]);
    gradcheck!(permute: |x| x.permute(&[2, 0, 1]), shapes [[[2, 3, 4]], [[1, 3, 1]], [[0, 2, 3]]]);
    gradcheck!(slice_axis: |x| x.slice_axis(1, 1..3) * x.slice_axis(1, 0..2), shapes [[[3, 5]], [[2, 3, 4]]]);
    gradcheck!(slice_of_nothing: |x| x.slice_axis(0, 1..1), shapes [[[3, 5]]]);
    gradcheck!(index_axis: |x| x.index_axis(1, 2), shapes [[[3, 5]], [[2, 3, 4]]]);
    gradcheck!(concat: |a, b| a.tape().concat(&[a, b, a], 1), shapes [[[3, 5], [3, 2]], [[2, 3, 4], [2, 0, 4]]]);
    gradcheck!(stack: |a, b| a.tape().stack(&[a, b], 1), shapes [[[3, 5], [3, 5]], [[2], [2]]]);
    gradcheck!(stack_scalars: |a, b| a.tape().stack(&[a, b, a], 0), shapes [[[], []]]);

    #[test]
    #[should_panic(expected = "stack: at least one value expected")]
    fn a_stack_of_nothing() {
        let _ = Tape::<f32>::eval().stack(&[], 0);
    }

    #[test]
    #[should_panic(expected = "index_axis: there is no element 2 along axis 1")]
    fn an_element_that_is_not_there() {
        let _ = Tape::<f32>::eval().constant(arr2(&[[1.0, 2.0]])).index_axis(1, 2);
    }

    proptest! {
        #[test]
        fn what_is_cut_can_be_joined(
            shape in proptest::collection::vec(1_usize..5, 1..5),
            pick in any::<proptest::sample::Index>(),
            cut in any::<proptest::sample::Index>(),
        ) {
            let axis = pick.index(shape.len());
            let n = shape[axis];
            let cut = cut.index(n + 1);
            let options = Options::default();
            let inputs = options.draw(&[shape]);
            let f = function(|x| {
                let x = x[0];
                x.tape().concat(&[x.slice_axis(axis, 0..cut), x.slice_axis(axis, cut..n)], axis)
            });
            let tape = Tape::<f64>::eval();
            let joined = f(&[tape.constant(inputs[0].clone())]).value();
            prop_assert_eq!(joined.view(), inputs[0].view());
            check(&f, &inputs, &options).unwrap();
        }
    }

    #[test]
    fn a_reshape_shares_memory() {
        let mut tape = Tape::<f32>::train(0);
        let x = tape.leaf(arr2(&[[1.0, 2.0], [3.0, 4.0]]));
        assert_eq!(x.value().as_ptr(), x.reshape(&[4]).value().as_ptr());
        tape.reset();
    }

    #[test]
    #[should_panic(expected = "concat: only axis 1 may differ")]
    fn parts_that_do_not_fit() {
        let tape = Tape::<f32>::eval();
        let a = tape.constant(arr2(&[[1.0, 2.0]]));
        let _ = tape.concat(&[a, a.reshape(&[2, 1])], 1);
    }
}
