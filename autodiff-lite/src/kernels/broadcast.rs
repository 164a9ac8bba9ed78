//! Two arrays of different shapes as loops over rows.
//!
//! Axes that behave alike for both operands are merged, so that equal shapes become one loop, a
//! bias one loop per row, and only truly mixed shapes more.

use crate::Real;
use crate::kernels::blocks::for_each_part;
use crate::kernels::columns::{fold_rows, rows_of_chunk};
use crate::kernels::elementwise::{self, CHUNK, PARALLEL_FROM};
use crate::kernels::simd::clones;
use crate::kernels::workspace;

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
    /// operand was repeated: over parts of fixed length first, so that single precision suffices and nothing depends on the
    /// number of threads.
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
        let size = self.reach(which);
        let target = &mut target[..size];
        let (rows, width, _) = self.block();
        let outer: usize = self.dims[..self.dims.len().saturating_sub(2)].iter().product();
        // Where the same elements are met block after block, sums of some blocks are added, not one block after another.
        let group = outer.isqrt().max(GROUP);
        if outer <= GROUP || size > group * rows * width {
            self.blocks(|start, out| self.pull_block(which, start, out, [g, a, b, y], target, &f));
            return;
        }
        workspace::with(size, |sums: &mut [F]| {
            sums.fill(F::zero());
            let mut met = 0;
            self.blocks(|start, out| {
                self.pull_block(which, start, out, [g, a, b, y], sums, &f);
                met += 1;
                if met % group == 0 || met == outer {
                    elementwise::add_to(sums, target);
                    sums.fill(F::zero());
                }
            });
        });
    }

    /// How many elements an operand has.
    fn reach(&self, which: usize) -> usize {
        let moved = self.dims.iter().zip(&self.steps[which]).filter(|(_, step)| **step > 0);
        moved.map(|(&size, _)| size).product()
    }

    /// [`accumulate`](Self::accumulate) for the block whose operands and output begin there.
    fn pull_block<F: Real>(
        &self,
        which: usize,
        start: [usize; 2],
        out: usize,
        [g, a, b, y]: [&[F]; 4],
        target: &mut [F],
        f: &(impl Fn(F, F, F, F) -> F + Sync),
    ) {
        let (rows, width, layout) = self.block();
        let of_target = layout[which];
        let (g, y) = (&g[out..out + rows * width], &y[out..out + rows * width]);
        let (a, b) = (&a[start[0]..], &b[start[1]..]);
        let target = &mut target[start[which]..];
        // Rows `first ..` of the block, or elements of its only row: what is read of them.
        let part =
            |first: usize, width: usize, range: std::ops::Range<usize>, steps: [usize; 2]| {
                let (a, b) = (&a[first * steps[0]..], &b[first * steps[1]..]);
                let range = range.start * width..range.end * width;
                [&g[range.clone()], a, b, &y[range]]
            };
        let steps = layout.map(|rows| rows.step);
        let moves = layout.map(|rows| rows.moves);
        let parallel = g.len() >= PARALLEL_FROM;
        match (rows, of_target.moves, of_target.step) {
            (1, 0, _) if width > CHUNK => {
                // One number: sums of fixed parts of the row, at their places, are then added in order.
                workspace::with(width.div_ceil(CHUNK), |sums: &mut [F]| {
                    sums.fill(F::zero());
                    for_each_part(sums, 1, parallel, |k, sum| {
                        let range = k * CHUNK..((k + 1) * CHUNK).min(width);
                        let operands = part(range.start, 1, range.clone(), moves);
                        pull_rows(range.len(), layout, of_target, operands, sum, f);
                    });
                    target[0] += F::from_f64(sums.iter().map(|&sum| sum.to_f64()).sum());
                });
            }
            (1, 1, _) if parallel => {
                for_each_part(&mut target[..width], CHUNK, true, |k, target| {
                    let range = k * CHUNK..k * CHUNK + target.len();
                    let operands = part(range.start, 1, range, moves);
                    pull_rows(target.len(), layout, of_target, operands, target, f);
                });
            }
            (_, 1, 0) if rows > rows_of_chunk(width) => {
                workspace::with(width, |sums: &mut [F]| {
                    fold_rows(rows, width, 4, sums, |range, sums| {
                        let operands = part(range.start, width, range, steps);
                        pull_rows(width, layout, of_target, operands, sums, f);
                    });
                    elementwise::add_to(sums, &mut target[..width]);
                });
            }
            (_, _, step) if parallel && step > 0 => {
                // Each row of the block has a part of the target of its own.
                let chunk = CHUNK.div_ceil(width);
                for_each_part(&mut target[..rows * step], chunk * step, true, |k, target| {
                    let range = k * chunk..((k + 1) * chunk).min(rows);
                    let operands = part(range.start, width, range, steps);
                    pull_rows(width, layout, of_target, operands, target, f);
                });
            }
            _ => pull_rows(width, layout, of_target, [g, a, b, y], target, f),
        }
    }
}

/// At least so many blocks are added before their sum is added to that of others.
const GROUP: usize = 64;

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

/// Sums side by side, begun anew after so many elements: they vectorise, and lose less than one running sum.
#[inline(always)]
fn row_sum<F: Real, C: Fn(F, F, F, F) -> F, const A: usize, const B: usize>(
    g: &[F],
    a: &[F],
    b: &[F],
    y: &[F],
    f: &C,
) -> F {
    const LANES: usize = 16;
    const RUN: usize = 64 * LANES;
    let (width, mut sum) = (g.len(), F::zero());
    let mut at = 0;
    while at + LANES <= width {
        let end = at + (width - at).min(RUN) / LANES * LANES;
        let mut lanes = [F::zero(); LANES];
        while at < end {
            let (g, y) = (&g[at..at + LANES], &y[at..at + LANES]);
            let (a, b) = (&a[at * A..][..=(LANES - 1) * A], &b[at * B..][..=(LANES - 1) * B]);
            for k in 0..LANES {
                lanes[k] += f(g[k], a[k * A], b[k * B], y[k]);
            }
            at += LANES;
        }
        let mut half = LANES / 2;
        while half > 0 {
            for k in 0..half {
                let other = lanes[k + half];
                lanes[k] += other;
            }
            half /= 2;
        }
        sum += lanes[0];
    }
    for k in at..width {
        sum += f(g[k], a[k * A], b[k * B], y[k]);
    }
    sum
}

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
            target[0] += row_sum::<F, C, A, B>(g, a, b, y, f);
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
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    /// Gradients of what is repeated, in single precision: running sums are off by up to a tenth here.
    #[test]
    fn sums_over_what_is_repeated_keep_their_digits() {
        for (full, part) in [
            (vec![1_000_000, 2], vec![2]),
            (vec![1_000_000, 2], vec![]),
            (vec![3_000_000], vec![1]),
            (vec![200, 9_000], vec![9_000]),
            (vec![2, 1_000_000], vec![2, 1]),
            (vec![300_000, 4, 2], vec![4, 1]),
            (vec![300_000, 1, 2], vec![1, 3, 1]),
            (vec![40, 50_000, 3], vec![40, 1, 3]),
        ] {
            let plan = Broadcast::new(&full, &part);
            let size = crate::broadcast_shape(&full, &part).unwrap().iter().product();
            let (elements, own) = (vec![0.1_f32; size], part.iter().product());
            let (b, mut found) = (vec![0.5_f32; own], vec![1.0_f32; own]);
            let a = vec![0.25_f32; full.iter().product()];
            let run = |threads: usize, found: &mut [f32]| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                let operands = [&elements[..], &a, &b, &elements];
                pool.install(|| {
                    plan.accumulate(1, operands, found, |g, a, b, _| g + (a - b * 0.5));
                });
            };
            run(1, &mut found);
            let exact = 1.0 + (size / own) as f64 * f64::from(0.1_f32);
            for found in &found {
                let error = (f64::from(*found) / exact - 1.0).abs();
                assert!(error < 2e-5, "{full:?} and {part:?}: {found} instead of {exact}");
            }
            let mut again = vec![1.0_f32; own];
            run(3, &mut again);
            assert_eq!(found, again);
        }
    }

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
