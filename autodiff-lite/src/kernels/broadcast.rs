//! Two arrays of different shapes as loops over rows.
//!
//! Axes that behave alike for both operands are merged, so that equal shapes become one loop, a
//! bias one loop per row, and only truly mixed shapes more.

use crate::Real;
use crate::kernels::elementwise;

/// How the elements of two row-major arrays meet, by NumPy's rules.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Broadcast {
    /// Merged axes, the fastest last; never empty.
    dims: Vec<usize>,
    /// Steps of each operand along the merged axes; 0 where it is repeated.
    steps: [Vec<usize>; 2],
}

/// One row of the output, and what each operand gives it.
struct Row {
    /// Where the operands begin.
    start: [usize; 2],
    /// Where the output begins.
    out: usize,
}

impl Broadcast {
    /// The loops for shapes `a` and `b`, which must fit ([`broadcast_shape`](crate::broadcast_shape)).
    pub fn new(a: &[usize], b: &[usize]) -> Self {
        let rank = a.len().max(b.len());
        let mut dims: Vec<usize> = Vec::with_capacity(rank.max(1));
        let mut steps: [Vec<usize>; 2] = [Vec::new(), Vec::new()];
        // From the slowest axis to the fastest; merging multiplies the previous axis.
        for k in 0..rank {
            let sizes = [a, b].map(|s| (k + s.len()).checked_sub(rank).map_or(1, |axis| s[axis]));
            let size = if sizes[0] == 1 { sizes[1] } else { sizes[0] };
            if size == 1 {
                continue;
            }
            // For now 1 = moves, 0 = repeated; turned into steps below.
            let moves = sizes.map(|s| usize::from(s != 1));
            match dims.last_mut() {
                Some(last)
                    if steps[0].last() == Some(&moves[0]) && steps[1].last() == Some(&moves[1]) =>
                {
                    *last *= size;
                }
                _ => {
                    dims.push(size);
                    steps[0].push(moves[0]);
                    steps[1].push(moves[1]);
                }
            }
        }
        if dims.is_empty() {
            dims.push(1);
            steps = [vec![1], vec![1]];
        }
        for operand in &mut steps {
            let mut step = 1;
            for (moves, &size) in operand.iter_mut().zip(&dims).rev() {
                if *moves == 1 {
                    *moves = step;
                    step *= size;
                }
            }
        }
        Self { dims, steps }
    }

    /// Whether both operands have the same elements in the same order.
    pub fn is_plain(&self) -> bool {
        self.dims.len() == 1 && self.steps[0][0] == 1 && self.steps[1][0] == 1
    }

    /// Calls `f` for each row of the output, in order.
    fn rows(&self, mut f: impl FnMut(Row)) {
        let (&width, outer) = self.dims.split_last().expect("dims are never empty");
        let count: usize = outer.iter().product();
        let mut index = vec![0; outer.len()];
        let mut start = [0; 2];
        for row in 0..count {
            f(Row { start, out: row * width });
            for k in (0..outer.len()).rev() {
                index[k] += 1;
                start[0] += self.steps[0][k];
                start[1] += self.steps[1][k];
                if index[k] < outer[k] {
                    break;
                }
                index[k] = 0;
                start[0] -= self.steps[0][k] * outer[k];
                start[1] -= self.steps[1][k] * outer[k];
            }
        }
    }

    /// `y = f(a, b)`.
    pub fn zip<F: Real>(&self, a: &[F], b: &[F], y: &mut [F], f: impl Fn(F, F) -> F + Sync) {
        let width = self.dims[self.dims.len() - 1];
        let moves = [self.steps[0][self.dims.len() - 1], self.steps[1][self.dims.len() - 1]];
        self.rows(|Row { start: [i, j], out }| {
            let y = &mut y[out..out + width];
            match moves {
                [0, 0] => y.fill(f(a[i], b[j])),
                [_, 0] => {
                    let b = b[j];
                    elementwise::map(&a[i..i + width], y, |a| f(a, b));
                }
                [0, _] => {
                    let a = a[i];
                    elementwise::map(&b[j..j + width], y, |b| f(a, b));
                }
                _ => elementwise::zip(&a[i..i + width], &b[j..j + width], y, &f),
            }
        });
    }

    /// Adds `f(g, a, b, y)` into the gradient of operand `which` (0 or 1), summing where that
    /// operand was repeated, in the order of the output.
    pub fn accumulate<F: Real>(
        &self,
        which: usize,
        [g, a, b, y]: [&[F]; 4],
        target: &mut [F],
        f: impl Fn(F, F, F, F) -> F + Sync,
    ) {
        let width = self.dims[self.dims.len() - 1];
        let [move_a, move_b] = [0, 1].map(|k| self.steps[k][self.dims.len() - 1].min(1));
        self.rows(|Row { start, out }| {
            let (g, y) = (&g[out..out + width], &y[out..out + width]);
            let at = |k: usize| f(g[k], a[start[0] + k * move_a], b[start[1] + k * move_b], y[k]);
            if [move_a, move_b][which] == 0 {
                target[start[which]] += (0..width).map(at).sum::<F>();
            } else {
                let target = &mut target[start[which]..start[which] + width];
                for (k, t) in target.iter_mut().enumerate() {
                    *t += at(k);
                }
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn like_axes_merge() {
        assert!(Broadcast::new(&[2, 3, 4], &[2, 3, 4]).is_plain());
        assert_eq!(Broadcast::new(&[2, 3, 4], &[4]).dims, [6, 4]);
        assert_eq!(Broadcast::new(&[2, 3, 4], &[]).dims, [24]);
        assert_eq!(Broadcast::new(&[2, 1, 4], &[3, 1]).dims, [2, 3, 4]);
        assert!(Broadcast::new(&[], &[1, 1]).is_plain());
    }
}
