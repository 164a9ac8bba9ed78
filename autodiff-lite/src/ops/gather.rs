//! Rows by index: taking them, and adding to them.

use crate::kernels::rows;
use crate::{Backward, PoolVec, Real, Var};

impl<F: Real> Var<'_, F> {
    /// Row `indices[k]` as row `k`, the same indices for each batch.
    ///
    /// The gradient is a scatter in the order of `k`, one thread per batch element.
    ///
    /// # Shapes
    /// `self [.., V, D]`, `K` indices below `V` → `[.., K, D]`.
    ///
    /// # Panics
    /// If there are fewer than two axes, or an index is not below `V`.
    #[track_caller]
    #[inline(never)]
    pub fn gather_rows(self, indices: &[u32]) -> Self {
        let (mut shape, rows) = self.rows_for("gather_rows", indices, None);
        let [n, width] = [rows, shape[shape.len() - 1]];
        let axis = shape.len() - 2;
        shape[axis] = indices.len();
        let x = self.value();
        let mut y = self.tape.array(&shape);
        rows::gather([n, width], x.as_slice(), indices, y.as_slice_mut());
        let indices = self.saved(indices);
        self.tape.record_fn("gather_rows", &[self], y, move |cx: &mut Backward<'_, F>| {
            let g = cx.grad_out();
            rows::scatter_add([n, width], g.as_slice(), &indices, cx.grad_slice_mut(0));
        })
    }

    /// A table of `rows` rows, to row `indices[k]` of which row `k` is added: sums over segments that need not be
    /// sorted. Rows that no index names are zero.
    ///
    /// # Shapes
    /// `self [.., K, D]`, `K` indices below `rows` → `[.., rows, D]`.
    ///
    /// # Panics
    /// If there are fewer than two axes, the number of indices is not `K`, or one is not below
    /// `rows`.
    #[track_caller]
    #[inline(never)]
    pub fn scatter_add_rows(self, indices: &[u32], rows: usize) -> Self {
        let (mut shape, _) = self.rows_for("scatter_add_rows", indices, Some(rows));
        let width = shape[shape.len() - 1];
        let axis = shape.len() - 2;
        shape[axis] = rows;
        let x = self.value();
        let mut y = self.tape.pool.filled(&shape, F::zero());
        rows::scatter_add([rows, width], x.as_slice(), indices, y.as_slice_mut());
        let indices = self.saved(indices);
        self.tape.record_fn("scatter_add_rows", &[self], y, move |cx: &mut Backward<'_, F>| {
            let g = cx.grad_out();
            cx.give_with(0, |gx| rows::gather([rows, width], g.as_slice(), &indices, gx));
        })
    }

    /// A copy of the indices, from the pool, when a gradient will want them.
    fn saved(self, indices: &[u32]) -> PoolVec<u32> {
        let wanted = self.tape.wants_grad(&[self]);
        let mut saved = self.tape.indices(if wanted { indices.len() } else { 0 });
        if wanted {
            saved.copy_from_slice(indices);
        }
        saved
    }

    /// Checks the indices against the table they point into: `table` rows, or those of `self`.
    #[track_caller]
    fn rows_for(
        self,
        op: &'static str,
        indices: &[u32],
        table: Option<usize>,
    ) -> (Vec<usize>, usize) {
        let shape = self.shape();
        let operands = [("input", &shape[..], ".., V, D"), ("indices", &[indices.len()], "K")];
        let refuse = |message: String| self.tape.refuse(op, message, &operands);
        let [.., own, _] = shape[..] else { refuse("at least two axes expected".to_owned()) };
        if table.is_some() && indices.len() != own {
            refuse("one index per row expected".to_owned());
        }
        let rows = table.unwrap_or(own);
        if let Some(index) = indices.iter().find(|&&index| index as usize >= rows) {
            refuse(format!("index {index} is not below {rows}"));
        }
        (shape, rows)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use ndarray::arr2;
    use proptest::prelude::*;

    use crate::Tape;
    use crate::testkit::{Options, check, function, gradcheck};

    gradcheck!(gather: |x| x.gather_rows(&[2, 0, 2, 1]), shapes [[[3, 5]], [[2, 4, 3]], [[3, 1]]]);
    gradcheck!(gather_nothing: |x| x.gather_rows(&[]), shapes [[[3, 5]]]);
    gradcheck!(scatter: |x| x.scatter_add_rows(&[2, 0, 2], 4), shapes [[[3, 5]], [[2, 3, 3]], [[3, 2]]]);

    proptest! {
        #[test]
        fn random_rows(
            batch in 1_usize..3, rows in 1_usize..6, width in 1_usize..7,
            picks in proptest::collection::vec(any::<proptest::sample::Index>(), 0..8),
        ) {
            let indices: Vec<u32> = picks.iter().map(|p| p.index(rows) as u32).collect();
            let options = Options::default();
            let gather = function(|x| x[0].gather_rows(&indices));
            check(&gather, &options.draw(&[vec![batch, rows, width]]), &options).unwrap();
            let scatter = function(|x| x[0].scatter_add_rows(&indices, rows));
            check(&scatter, &options.draw(&[vec![batch, indices.len(), width]]), &options).unwrap();
        }
    }

    #[test]
    fn values() {
        let tape = Tape::<f32>::eval();
        let x = tape.constant(arr2(&[[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]));
        let y = x.gather_rows(&[2, 0]).value();
        assert_eq!(y.as_slice(), [5.0, 6.0, 1.0, 2.0]);
        let y = x.scatter_add_rows(&[1, 0, 1], 3).value();
        assert_eq!(y.as_slice(), [3.0, 4.0, 6.0, 8.0, 0.0, 0.0]);
    }

    #[test]
    #[should_panic(expected = "gather_rows: index 3 is not below 3")]
    fn an_index_out_of_range() {
        let tape = Tape::<f32>::eval();
        let x = tape.constant(arr2(&[[1.0], [3.0], [5.0]]));
        let _ = x.gather_rows(&[0, 3]);
    }
}
