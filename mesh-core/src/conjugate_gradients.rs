//! The preconditioned conjugate gradient method.

use crate::kernels::threads;

/// Rows whose products are summed in `f32` before the sum goes on in `f64`, block by block, on however many threads the blocks were summed.
const BLOCK: usize = 64;
/// Rows that a thread takes at once.
const CHUNK: usize = 32 * BLOCK;

/// A symmetric positive definite matrix `A`, on rows of up to four columns.
pub(crate) trait SymmetricSystem: Send + Sync {
    /// Whether `A` mixes the columns of a row. Otherwise each is a system of its own, with the same matrix.
    const COUPLED: bool;

    /// `q = A p`; gives the sums of `p q`, by columns.
    fn multiply(&self, p: &[[f32; 4]], q: &mut [[f32; 4]]) -> [f64; 4];

    /// Looks at all of a residual, where a row alone does not tell how to precondition it.
    fn prepare(&mut self, _residual: &[[f32; 4]]) {}

    /// Row of `z ≈ A⁻¹ r`, from that of the residual `r` last prepared for.
    fn precondition(&self, row: usize, residual: [f32; 4]) -> [f32; 4];
}

/// How a solve went.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct SolveReport {
    /// The number of iterations.
    pub iterations: usize,
    /// The largest `‖b - A x‖ / ‖b‖` of any column, as the steps in `f32` add up, within some `1e-6` of what it is; `A` is `I + λ L` of a [`DiffusionSolver`](crate::DiffusionSolver).
    pub residual: f64,
    /// Whether `residual` is within the tolerance.
    pub converged: bool,
}

/// What a solve needs: solution, residual, direction and its image, padded to four columns so that a row is
/// one vector register.
#[derive(Clone, Debug)]
pub(crate) struct ConjugateGradients {
    x: Vec<[f32; 4]>,
    residual: Vec<[f32; 4]>,
    direction: Vec<[f32; 4]>,
    image: Vec<[f32; 4]>,
}

impl ConjugateGradients {
    pub(crate) fn new(rows: usize) -> Self {
        let zeros = || vec![[0.0; 4]; rows];
        Self { x: zeros(), residual: zeros(), direction: zeros(), image: zeros() }
    }

    /// Solves `A x = b`, beginning at what `x` holds, until `‖b - A x‖ ≤ tolerance · ‖b‖` in every column (over all columns where they are
    /// coupled), or for `max_iterations`.
    pub(crate) fn solve<S: SymmetricSystem, const K: usize>(
        &mut self,
        system: &mut S,
        b: &[[f32; K]],
        x: &mut [[f32; K]],
        tolerance: f64,
        max_iterations: usize,
    ) -> SolveReport {
        let mut iterate = |b: &[[f32; K]], x: &mut [[f32; K]]| {
            let mut iterate = || self.iterate(system, b, x, tolerance, max_iterations);
            // On a thread of the pool, lest each pass over the rows wakes one.
            if b.len() > CHUNK { threads::on_one(iterate) } else { iterate() }
        };
        let exponents = exponents::<S, K>(b);
        let factors = exponents.map(f32::exp2);
        let is_far = is_far::<S, K>(x, factors);
        if exponents.iter().all(|&e| e == 0.0) && !is_far.contains(&true) {
            return iterate(b, x);
        }
        // Squares would be infinite, or zero and look as if all were solved.
        let times = |rows: &[[f32; K]], factors: [f32; K]| -> Vec<[f32; K]> {
            rows.iter().map(|row| std::array::from_fn(|k| row[k] * factors[k])).collect()
        };
        let (b, mut scaled) = (times(b, factors), times(x, factors));
        for k in (0..K).filter(|&k| is_far[k]) {
            for row in &mut scaled {
                row[k] = 0.0;
            }
        }
        let report = iterate(&b, &mut scaled);
        x.copy_from_slice(&times(&scaled, factors.map(f32::recip)));
        report
    }

    fn iterate<S: SymmetricSystem, const K: usize>(
        &mut self,
        system: &mut S,
        b: &[[f32; K]],
        x: &mut [[f32; K]],
        tolerance: f64,
        max_iterations: usize,
    ) -> SolveReport {
        const { assert!(K >= 1 && K <= 4, "one to four columns") };
        let [bb, mut rr] = self.begin(system, b, x).map(joined::<S>);
        let (mut iterations, mut rz) = (0, [0.0; 4]);
        while worst::<K>(&rr, &bb) > tolerance && iterations < max_iterations {
            system.prepare(&self.residual);
            let residual = &self.residual;
            let next_rz = joined::<S>(sum_rows(residual.len(), |row| {
                let (r, z) = (residual[row], system.precondition(row, residual[row]));
                std::array::from_fn(|k| z[k] * r[k])
            }));
            let carry: [f32; 4] =
                std::array::from_fn(
                    |k| if rz[k] > 0.0 { (next_rz[k] / rz[k]) as f32 } else { 0.0 },
                );
            let chunks = self.direction.chunks_mut(CHUNK).enumerate();
            threads::for_each(chunks, |(chunk, direction)| {
                for (p, row) in direction.iter_mut().zip(chunk * CHUNK..) {
                    let z = system.precondition(row, residual[row]);
                    *p = if iterations == 0 {
                        z
                    } else {
                        std::array::from_fn(|k| z[k] + carry[k] * p[k])
                    };
                }
            });
            rz = next_rz;
            let pq = joined::<S>(system.multiply(&self.direction, &mut self.image));
            // A column that is solved exactly stands still.
            let step =
                std::array::from_fn(|k| if pq[k] > 0.0 { (rz[k] / pq[k]) as f32 } else { 0.0 });
            rr = joined::<S>(self.advance(step));
            iterations += 1;
        }
        for (x, padded) in x.iter_mut().zip(&self.x) {
            x.copy_from_slice(&padded[..K]);
        }
        let residual = worst::<K>(&rr, &bb);
        SolveReport { iterations, residual, converged: residual <= tolerance }
    }

    /// `r = b - A x` at what `x` holds; gives the sums of `b²` and of `r²`, by columns.
    fn begin<S: SymmetricSystem, const K: usize>(
        &mut self,
        system: &S,
        b: &[[f32; K]],
        x: &[[f32; K]],
    ) -> [[f64; 4]; 2] {
        // Where `b` is zero the solution is, and no residual is small beside it.
        let is_zero = |k: usize| b.iter().all(|b| b[k] == 0.0);
        let mut zero: [bool; K] = std::array::from_fn(is_zero);
        if S::COUPLED {
            zero = [zero == [true; K]; K];
        }
        for (padded, x) in self.x.iter_mut().zip(x) {
            padded[..K].copy_from_slice(&std::array::from_fn::<_, K, _>(|k| {
                if zero[k] { 0.0 } else { x[k] }
            }));
        }
        system.multiply(&self.x, &mut self.image);
        let (mut bb, mut rr) = ([0.0; 4], [0.0; 4]);
        for ((b, r), image) in b.iter().zip(&mut self.residual).zip(&self.image) {
            let mut wide = [0.0; 4];
            wide[..K].copy_from_slice(b);
            *r = std::array::from_fn(|k| wide[k] - image[k]);
            for k in 0..4 {
                bb[k] += f64::from(wide[k]) * f64::from(wide[k]);
                rr[k] += f64::from(r[k]) * f64::from(r[k]);
            }
        }
        [bb, rr]
    }

    /// `x += α p`, `r -= α q`; gives the sums of `r²`.
    fn advance(&mut self, step: [f32; 4]) -> [f64; 4] {
        let Self { x, residual, direction, image, .. } = self;
        let mut sums = block_sums(x.len());
        let moving = x.chunks_mut(CHUNK).zip(residual.chunks_mut(CHUNK));
        let along = direction.chunks(CHUNK).zip(image.chunks(CHUNK));
        let chunks = moving.zip(along).zip(sums.chunks_mut(CHUNK / BLOCK));
        threads::for_each(chunks, |(((x, r), (p, q)), sums)| {
            let blocks = x.chunks_mut(BLOCK).zip(r.chunks_mut(BLOCK));
            let blocks = blocks.zip(p.chunks(BLOCK).zip(q.chunks(BLOCK)));
            for (((x, r), (p, q)), sum) in blocks.zip(sums) {
                let mut squares = [0.0; 4]; // in registers, where a reference into `sums` would not be
                for ((x, r), (p, q)) in x.iter_mut().zip(r).zip(p.iter().zip(q)) {
                    for k in 0..4 {
                        x[k] += step[k] * p[k];
                        r[k] -= step[k] * q[k];
                        squares[k] += r[k] * r[k];
                    }
                }
                *sum = squares;
            }
        });
        total(&sums)
    }
}

/// Values whose squares, and those of what a solve leaves of them, are numbers.
const RANGE: std::ops::RangeInclusive<f32> = 1e-12..=1e12;

/// For each column the exponent of a power of two, which changes no digit, by which its largest value comes near one, where it is out
/// of [`RANGE`]; one for all where columns are coupled.
fn exponents<S: SymmetricSystem, const K: usize>(b: &[[f32; K]]) -> [f32; K] {
    // `max` would let a NaN pass.
    let most = |a: f32, b: f32| if a.is_nan() || b.is_nan() { f32::NAN } else { a.max(b) };
    let mut largest: [f32; K] =
        std::array::from_fn(|k| b.iter().map(|b| b[k].abs()).fold(0.0, most));
    if S::COUPLED {
        largest = [largest.into_iter().fold(0.0, most); K];
    }
    largest.map(|largest| {
        if largest == 0.0 || !largest.is_finite() || RANGE.contains(&largest) {
            return 0.0;
        }
        (-largest.log2().floor()).clamp(-126.0, 126.0)
    })
}

/// The columns that, times these factors, begin where squares are no numbers: farther from what solves them than zero is.
fn is_far<S: SymmetricSystem, const K: usize>(x: &[[f32; K]], factors: [f32; K]) -> [bool; K] {
    let far = |k: usize| x.iter().any(|x| (x[k] * factors[k]).abs() > *RANGE.end());
    let is_far = std::array::from_fn(far);
    if S::COUPLED { [is_far.contains(&true); K] } else { is_far }
}

/// Sums by columns, as the system tells columns apart: all four are the sum of all where it does not.
fn joined<S: SymmetricSystem>(sums: [f64; 4]) -> [f64; 4] {
    if S::COUPLED { [sums.iter().sum(); 4] } else { sums }
}

/// The largest `‖r‖ / ‖b‖` of the first `K` columns, from the squares of both; NaN if one is.
fn worst<const K: usize>(rr: &[f64; 4], bb: &[f64; 4]) -> f64 {
    let mut worst = 0.0_f64;
    for k in 0..K {
        let ratio = if rr[k] == 0.0 { 0.0 } else { (rr[k] / bb[k]).sqrt() };
        // `max` would let a NaN pass.
        worst = if ratio.is_nan() || worst.is_nan() { f64::NAN } else { worst.max(ratio) };
    }
    worst
}

/// `q[row] = of(row)` on all threads; gives the sums of `p q`, by columns.
pub(crate) fn multiply_rows(
    p: &[[f32; 4]],
    q: &mut [[f32; 4]],
    of: impl Fn(usize) -> [f32; 4] + Sync,
) -> [f64; 4] {
    let mut sums = block_sums(q.len());
    let chunks = q.chunks_mut(CHUNK).zip(sums.chunks_mut(CHUNK / BLOCK)).enumerate();
    threads::for_each(chunks, |(chunk, (q, sums))| {
        let mut row = chunk * CHUNK;
        for (block, sum) in q.chunks_mut(BLOCK).zip(sums) {
            let mut products = [0.0; 4];
            for (q, p) in block.iter_mut().zip(&p[row..]) {
                *q = of(row);
                for k in 0..4 {
                    products[k] += p[k] * q[k];
                }
                row += 1;
            }
            *sum = products;
        }
    });
    total(&sums)
}

/// The sums of `a b`, by columns.
pub(crate) fn products(a: &[[f32; 4]], b: &[[f32; 4]]) -> [f64; 4] {
    sum_rows(a.len(), |row| std::array::from_fn(|k| a[row][k] * b[row][k]))
}

/// The sums of so many rows, by columns.
fn sum_rows(rows: usize, of: impl Fn(usize) -> [f32; 4] + Sync) -> [f64; 4] {
    let mut sums = block_sums(rows);
    threads::for_each(sums.chunks_mut(CHUNK / BLOCK).enumerate(), |(chunk, sums)| {
        for (sum, block) in sums.iter_mut().zip(chunk * (CHUNK / BLOCK)..) {
            let mut rest = [0.0; 4];
            for row in block * BLOCK..rows.min((block + 1) * BLOCK) {
                let row = of(row);
                for k in 0..4 {
                    rest[k] += row[k];
                }
            }
            *sum = rest;
        }
    });
    total(&sums)
}

fn block_sums(rows: usize) -> Vec<[f32; 4]> {
    vec![[0.0; 4]; rows.div_ceil(BLOCK)]
}

/// The sum over blocks, in their order.
fn total(sums: &[[f32; 4]]) -> [f64; 4] {
    sums.iter().fold([0.0; 4], |total, sum| std::array::from_fn(|k| total[k] + f64::from(sum[k])))
}
