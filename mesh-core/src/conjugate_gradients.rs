//! The preconditioned conjugate gradient method.

/// Rows whose products are summed in `f32` before the sum goes on in `f64`.
pub(crate) const BLOCK: usize = 64;

/// A symmetric positive definite matrix `A`, on rows of up to four columns.
pub(crate) trait SymmetricSystem {
    /// Whether `A` mixes the columns of a row. Otherwise each is a system of its own, with the same matrix.
    const COUPLED: bool;

    /// `q = A p`; gives the sums of `p q`, by columns.
    fn multiply(&self, p: &[[f32; 4]], q: &mut [[f32; 4]]) -> [f64; 4];

    /// `z ≈ A⁻¹ r`.
    fn precondition(&mut self, r: &[[f32; 4]], z: &mut [[f32; 4]]);
}

/// How a solve went.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct SolveReport {
    /// The number of iterations.
    pub iterations: usize,
    /// The largest `‖b - A x‖ / ‖b‖` of any column; `A` is `I + λ L` of a [`DiffusionSolver`](crate::DiffusionSolver).
    pub residual: f64,
    /// Whether `residual` is within the tolerance.
    pub converged: bool,
}

/// What a solve needs: solution, residual, the same preconditioned, direction and its image, padded to four columns so that a row is
/// one vector register.
#[derive(Clone, Debug)]
pub(crate) struct ConjugateGradients {
    x: Vec<[f32; 4]>,
    residual: Vec<[f32; 4]>,
    preconditioned: Vec<[f32; 4]>,
    direction: Vec<[f32; 4]>,
    image: Vec<[f32; 4]>,
}

impl ConjugateGradients {
    pub(crate) fn new(rows: usize) -> Self {
        let zeros = || vec![[0.0; 4]; rows];
        Self {
            x: zeros(),
            residual: zeros(),
            preconditioned: zeros(),
            direction: zeros(),
            image: zeros(),
        }
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
        const { assert!(K >= 1 && K <= 4, "one to four columns") };
        let joined = |sums: [f64; 4]| if S::COUPLED { [sums.iter().sum(); 4] } else { sums };
        for (padded, x) in self.x.iter_mut().zip(x.iter()) {
            padded[..K].copy_from_slice(x);
        }

        // r = b - A x, and the squares of b and r.
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
        (bb, rr) = (joined(bb), joined(rr));

        let worst = |rr: &[f64; 4]| {
            let mut worst = 0.0_f64;
            for k in 0..K {
                let ratio = if rr[k] == 0.0 { 0.0 } else { (rr[k] / bb[k]).sqrt() };
                // `max` would let a NaN pass.
                worst = if ratio.is_nan() || worst.is_nan() { f64::NAN } else { worst.max(ratio) };
            }
            worst
        };
        let (mut iterations, mut rz) = (0, [0.0; 4]);
        while worst(&rr) > tolerance && iterations < max_iterations {
            system.precondition(&self.residual, &mut self.preconditioned);
            let next_rz = joined(products(&self.preconditioned, &self.residual));
            let carry: [f32; 4] =
                std::array::from_fn(
                    |k| if rz[k] > 0.0 { (next_rz[k] / rz[k]) as f32 } else { 0.0 },
                );
            for (p, z) in self.direction.iter_mut().zip(&self.preconditioned) {
                *p = if iterations == 0 {
                    *z
                } else {
                    std::array::from_fn(|k| z[k] + carry[k] * p[k])
                };
            }
            rz = next_rz;
            let pq = joined(system.multiply(&self.direction, &mut self.image));
            // A column that is solved exactly stands still.
            let step =
                std::array::from_fn(|k| if pq[k] > 0.0 { (rz[k] / pq[k]) as f32 } else { 0.0 });
            rr = joined(self.advance(step));
            iterations += 1;
        }
        for (x, padded) in x.iter_mut().zip(&self.x) {
            x.copy_from_slice(&padded[..K]);
        }
        let residual = worst(&rr);
        SolveReport { iterations, residual, converged: residual <= tolerance }
    }

    /// `x += α p`, `r -= α q`; gives the sums of `r²`.
    fn advance(&mut self, step: [f32; 4]) -> [f64; 4] {
        let mut rr = [0.0; 4];
        let blocks = self
            .x
            .chunks_mut(BLOCK)
            .zip(self.residual.chunks_mut(BLOCK))
            .zip(self.direction.chunks(BLOCK))
            .zip(self.image.chunks(BLOCK));
        for (((x, r), p), q) in blocks {
            let mut sums = [0.0_f32; 4];
            for (((x, r), p), q) in x.iter_mut().zip(r).zip(p).zip(q) {
                for k in 0..4 {
                    x[k] += step[k] * p[k];
                    r[k] -= step[k] * q[k];
                    sums[k] += r[k] * r[k];
                }
            }
            for k in 0..4 {
                rr[k] += f64::from(sums[k]);
            }
        }
        rr
    }
}

/// The sums of `a b`, by columns.
pub(crate) fn products(a: &[[f32; 4]], b: &[[f32; 4]]) -> [f64; 4] {
    let mut total = [0.0; 4];
    for (a, b) in a.chunks(BLOCK).zip(b.chunks(BLOCK)) {
        let mut sums = [0.0_f32; 4];
        for (a, b) in a.iter().zip(b) {
            for k in 0..4 {
                sums[k] += a[k] * b[k];
            }
        }
        for k in 0..4 {
            total[k] += f64::from(sums[k]);
        }
    }
    total
}
