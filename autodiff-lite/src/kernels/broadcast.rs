//! Two arrays of different shapes as loops over rows.
//!
//! Axes that behave alike for both operands are merged, so that equal shapes become one loop, a
//! bias one loop per row, and only truly mixed shapes more.

use crate::Real;
use crate::kernels::blocks::for_each_part;
use crate::kernels::elementwise::{self, CHUNK, PARALLEL_FROM};
use crate::kernels::simd::clones;

/// How the elements of two row-major arrays meet, by NumPy's rules.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Broadcast {
    /// Merged axes, the fastest last; never empty.
    dims: Vec<usize>,
    /// Steps of each operand along the merged axes; 0 where it is repeated.
    steps: [Vec<usize>; 2],
}

/// How the rows of a block lie in an operand: the step from row to row, and whether the operand
/// moves along a row (1) or is repeated (0).
#[derive(Clone, Copy)]
struct Rows {
    step: usize,
    moves: usize,
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

    /// The sizes of a block: the last two merged axes, or one row.
    fn block(&self) -> (usize, usize, [Rows; 2]) {
        let n = self.dims.len();
        let rows = |k: usize| Rows {
            step: if n > 1 { self.steps[k][n - 2] } else { 0 },
            moves: self.steps[k][n - 1].min(1),
        };
        (if n > 1 { self.dims[n - 2] } else { 1 }, self.dims[n - 1], [rows(0), rows(1)])
    }

    /// Calls `f` for each block of the output, in order, with where the operands and the output
    /// begin.
    fn blocks(&self, mut f: impl FnMut([usize; 2], usize)) {
        let outer = &self.dims[..self.dims.len().saturating_sub(2)];
        let (rows, width, _) = self.block();
        let count: usize = outer.iter().product();
        let mut index = vec![0; outer.len()];
        let mut start = [0; 2];
        for block in 0..count {
            f(start, block * rows * width);
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
        if y.is_empty() {
            return;
        }
        let (rows, width, [of_a, of_b]) = self.block();
        self.blocks(|[i, j], out| {
            let (a, b, y) = (&a[i..], &b[j..], &mut y[out..out + rows * width]);
            if rows == 1 {
                // One long row: the flat loops split it.
                match [of_a.moves, of_b.moves] {
                    [0, 0] => y.fill(f(a[0], b[0])),
                    [_, 0] => elementwise::map(&a[..width], y, |a| f(a, b[0])),
                    [0, _] => elementwise::map(&b[..width], y, |b| f(a[0], b)),
                    _ => elementwise::zip(&a[..width], &b[..width], y, &f),
                }
            } else if y.len() < PARALLEL_FROM {
                zip_rows(width, of_a, of_b, a, b, y, &f);
            } else {
                let rows = CHUNK.div_ceil(width);
                for_each_part(y, rows * width, true, |k, y| {
                    let (a, b) = (&a[k * rows * of_a.step..], &b[k * rows * of_b.step..]);
                    zip_rows(width, of_a, of_b, a, b, y, &f);
                });
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
        if g.is_empty() {
            return;
        }
        let (rows, width, layout) = self.block();
        let of_target = layout[which];
        self.blocks(|start, out| {
            let (g, y) = (&g[out..out + rows * width], &y[out..out + rows * width]);
            let (a, b) = (&a[start[0]..], &b[start[1]..]);
            let target = &mut target[start[which]..];
            if g.len() < PARALLEL_FROM || of_target.step == 0 {
                pull_rows(width, layout, of_target, [g, a, b, y], target, &f);
                return;
            }
            // Each row of the block has a part of the target of its own.
            let chunk = CHUNK.div_ceil(width);
            let target = &mut target[..rows * of_target.step];
            for_each_part(target, chunk * of_target.step, true, |k, target| {
                let first = k * chunk;
                let part = first * width..(first + chunk).min(rows) * width;
                let (a, b) = (&a[first * layout[0].step..], &b[first * layout[1].step..]);
                let operands = [&g[part.clone()], a, b, &y[part]];
                pull_rows(width, layout, of_target, operands, target, &f);
            });
        });
    }
}

#[inline(always)]
fn zip_fixed<F: Real, C: Fn(F, F) -> F, const A: usize, const B: usize>(
    width: usize,
    steps: [usize; 2],
    a: &[F],
    b: &[F],
    y: &mut [F],
    f: &C,
) {
    for (row, y) in y.chunks_exact_mut(width).enumerate() {
        // Resliced to what is read, so that the loop needs no bounds checks.
        let a = &a[row * steps[0]..][..=(width - 1) * A];
        let b = &b[row * steps[1]..][..=(width - 1) * B];
        for (k, y) in y.iter_mut().enumerate() {
            *y = f(a[k * A], b[k * B]);
        }
    }
}

#[inline(always)]
fn zip_rows_body<F: Real, C: Fn(F, F) -> F>(
    width: usize,
    of_a: Rows,
    of_b: Rows,
    a: &[F],
    b: &[F],
    y: &mut [F],
    f: &C,
) {
    let steps = [of_a.step, of_b.step];
    match (of_a.moves, of_b.moves) {
        (0, 0) => zip_fixed::<F, C, 0, 0>(width, steps, a, b, y, f),
        (0, _) => zip_fixed::<F, C, 0, 1>(width, steps, a, b, y, f),
        (_, 0) => zip_fixed::<F, C, 1, 0>(width, steps, a, b, y, f),
        _ => zip_fixed::<F, C, 1, 1>(width, steps, a, b, y, f),
    }
}

clones!(fn zip_rows[F: Real, C: Fn(F, F) -> F](width: usize, of_a: Rows, of_b: Rows, a: &[F], b: &[F], y: &mut [F], f: &C) = zip_rows_body);

#[inline(always)]
fn pull_fixed<F: Real, C: Fn(F, F, F, F) -> F, const A: usize, const B: usize>(
    width: usize,
    steps: [usize; 2],
    of_target: Rows,
    [g, a, b, y]: [&[F]; 4],
    target: &mut [F],
    f: &C,
) {
    for (row, (g, y)) in g.chunks_exact(width).zip(y.chunks_exact(width)).enumerate() {
        let a = &a[row * steps[0]..][..=(width - 1) * A];
        let b = &b[row * steps[1]..][..=(width - 1) * B];
        let target = &mut target[row * of_target.step..][..=(width - 1) * of_target.moves];
        if of_target.moves == 0 {
            let mut sum = F::zero();
            for k in 0..width {
                sum += f(g[k], a[k * A], b[k * B], y[k]);
            }
            target[0] += sum;
        } else {
            for (k, t) in target.iter_mut().enumerate() {
                *t += f(g[k], a[k * A], b[k * B], y[k]);
            }
        }
    }
}

#[inline(always)]
fn pull_rows_body<F: Real, C: Fn(F, F, F, F) -> F>(
    width: usize,
    layout: [Rows; 2],
    of_target: Rows,
    operands: [&[F]; 4],
    target: &mut [F],
    f: &C,
) {
    let steps = layout.map(|rows| rows.step);
    match layout.map(|rows| rows.moves) {
        [0, 0] => pull_fixed::<F, C, 0, 0>(width, steps, of_target, operands, target, f),
        [0, _] => pull_fixed::<F, C, 0, 1>(width, steps, of_target, operands, target, f),
        [_, 0] => pull_fixed::<F, C, 1, 0>(width, steps, of_target, operands, target, f),
        _ => pull_fixed::<F, C, 1, 1>(width, steps, of_target, operands, target, f),
    }
}

clones!(fn pull_rows[F: Real, C: Fn(F, F, F, F) -> F](width: usize, layout: [Rows; 2], of_target: Rows, operands: [&[F]; 4], target: &mut [F], f: &C) = pull_rows_body);

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

    /// Large arrays take the parallel paths; the same sums by index, one by one.
    #[test]
    fn long_arrays_agree_with_plain_loops() {
        let (n, w) = (PARALLEL_FROM / 3 + 11, 3);
        let number = |k: usize| ((k * 7919) % 1009) as f64 / 1009.0 - 0.5;
        let full: Vec<f64> = (0..n * w).map(number).collect();
        let g: Vec<f64> = (0..n * w).map(|k| number(k + 5)).collect();
        for (shape, at) in [
            ([n, 1], (|k| k / 3) as fn(usize) -> usize),
            ([1, w], |k| k % 3),
            ([1, 1], |_| 0),
            ([n, w], |k| k),
        ] {
            let part: Vec<f64> = (0..shape[0] * shape[1]).map(|k| number(k + 9)).collect();
            for swapped in [false, true] {
                let (plan, which) = if swapped {
                    (Broadcast::new(&shape, &[n, w]), 0)
                } else {
                    (Broadcast::new(&[n, w], &shape), 1)
                };
                let (a, b) = if swapped { (&part, &full) } else { (&full, &part) };
                let mut y = vec![0.0; n * w];
                plan.zip(a, b, &mut y, |a, b| a - 2.0 * b);
                let (mut of_part, mut of_full) = (vec![0.0; part.len()], vec![0.0; n * w]);
                let rule = |g: f64, a: f64, b: f64, y: f64| g * (a + b * b + y);
                plan.accumulate(which, [&g, a, b, &y], &mut of_part, rule);
                plan.accumulate(1 - which, [&g, a, b, &y], &mut of_full, rule);
                let mut expected = vec![0.0; part.len()];
                for k in 0..n * w {
                    let (a, b) =
                        if swapped { (part[at(k)], full[k]) } else { (full[k], part[at(k)]) };
                    assert_eq!(y[k], a - 2.0 * b);
                    let pulled = rule(g[k], a, b, y[k]);
                    assert_eq!(of_full[k], pulled);
                    expected[at(k)] += pulled;
                }
                for (found, expected) in of_part.iter().zip(&expected) {
                    assert!((found - expected).abs() < 1e-9);
                }
            }
        }
    }
}
