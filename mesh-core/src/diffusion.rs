//! Diffusion over the edges of a mesh, and its inverse.

mod factor;

use crate::Topology;
use crate::conjugate_gradients::{ConjugateGradients, SolveReport, SymmetricSystem, multiply_rows};
use factor::Factor;

/// The operator `I + λ L` with the combinatorial Laplacian `L = D - A`, and a solver for it.
///
/// Descending in `u = (I + λ L) x` instead of `x` turns a gradient that is rough from vertex to
/// vertex into one that moves whole regions, so that large steps do not tangle the mesh:
///
/// ```text
/// x ← x - η (I + λ L)⁻² ∂Φ/∂x                                             (Large Steps, eq. 10)
/// ```
///
/// The solver is the preconditioned conjugate gradient method, on all columns at once, from wherever
/// `x` is. The preconditioner is the diagonal ([`DiffusionSolver::new`], ready at once) or a sparse
/// factorisation ([`DiffusionSolver::factored`], which needs one or two iterations and is worth its
/// preparation after some twenty solves). It sums in a fixed order, so its result does not depend on the number of threads.
///
/// ```
/// use mesh_core::{DiffusionSolver, Topology, primitives};
/// let mesh = primitives::icosphere(2);
/// let topology = Topology::new(mesh.positions.len(), &mesh.faces);
/// let mut diffusion = DiffusionSolver::new(&topology, 20.0);
/// let mut u = vec![[0.0; 3]; mesh.positions.len()];
/// diffusion.apply(&mesh.positions, &mut u);
/// let mut x = u.clone(); // the guess to begin from
/// let report = diffusion.solve(&u, &mut x, 1e-5, 200);
/// assert!(report.converged);
/// assert!((x[7][0] - mesh.positions[7][0]).abs() < 1e-3);
/// ```
///
/// # References
/// Nicolet, Jacobson, Jakob 2021, *Large Steps in Inverse Rendering of Geometry*, section 3.
#[derive(Clone, Debug)]
pub struct DiffusionSolver {
    operator: Diffusion,
    solver: ConjugateGradients,
}

/// `I + λ L`.
#[derive(Clone, Debug)]
struct Diffusion {
    lambda: f32,
    rows: crate::Csr,
    preconditioner: Preconditioner,
}

/// What makes the conjugate gradient method need fewer iterations.
#[derive(Clone, Debug)]
enum Preconditioner {
    /// `1 / (1 + λ degree)`, the inverse of the diagonal.
    Diagonal(Vec<f32>),
    /// All of the operator, to the accuracy of `f32`, and what it made of the last residual.
    Factor(Factor, Vec<[f32; 4]>),
}

/// Entries per vertex above which a factor costs more than it brings.
const FACTOR_ENTRIES: usize = 100;

impl DiffusionSolver {
    /// The operator over the edges of `topology`.
    ///
    /// The diffusion reaches about `√λ` edges far; published results use λ of 1 to 50 or so for
    /// meshes of some thousand vertices.
    ///
    /// # Panics
    /// If `lambda` is negative or not finite.
    pub fn new(topology: &Topology, lambda: f32) -> Self {
        assert!(lambda >= 0.0 && lambda.is_finite(), "DiffusionSolver: lambda {lambda}");
        let rows = topology.vertex_vertices.clone();
        let inverse = rows.rows().map(|ring| 1.0 / (1.0 + lambda * ring.len() as f32)).collect();
        let solver = ConjugateGradients::new(rows.len());
        let preconditioner = Preconditioner::Diagonal(inverse);
        Self { operator: Diffusion { lambda, rows, preconditioner }, solver }
    }

    /// The same operator, factored, for many solves.
    ///
    /// Where the factors would need more than 100 entries per vertex (large or strange meshes), or a vertex has more than 4,096
    /// neighbours (the middle of a large fan), it is left at the diagonal.
    ///
    /// # Cost
    /// About 6 ms for icosphere 4 and 65 ms for icosphere 5; then a solve takes 0.14 and 0.7 ms, against
    /// 0.6 to 1.4 and 2.7 to 6 ms with the diagonal (bench `mesh`).
    /// # Panics
    /// If `lambda` is negative or not finite.
    pub fn factored(topology: &Topology, lambda: f32) -> Self {
        let mut solver = Self::new(topology, lambda);
        let most = FACTOR_ENTRIES * topology.vertex_count();
        if let Some(factor) = Factor::new(&solver.operator.rows, lambda, most) {
            solver.operator.preconditioner =
                Preconditioner::Factor(factor, vec![[0.0; 4]; topology.vertex_count()]);
        }
        solver
    }

    /// The strength λ.
    pub fn lambda(&self) -> f32 {
        self.operator.lambda
    }

    /// Computes `y = (I + λ L) x`.
    ///
    /// # Panics
    /// If `x` or `y` have not one row per vertex.
    pub fn apply<const K: usize>(&self, x: &[[f32; K]], y: &mut [[f32; K]]) {
        self.assert_rows(x.len());
        self.assert_rows(y.len());
        let Diffusion { lambda, rows, .. } = &self.operator;
        for (vertex, (ring, y)) in rows.rows().zip(y).enumerate() {
            let here = x[vertex];
            let mut sum = [0.0; K];
            for &other in ring {
                for k in 0..K {
                    sum[k] += x[other as usize][k];
                }
            }
            let diagonal = 1.0 + lambda * ring.len() as f32;
            *y = std::array::from_fn(|k| diagonal * here[k] - lambda * sum[k]);
        }
    }

    /// Solves `(I + λ L) x = b` for up to four columns, beginning at what `x` holds.
    ///
    /// Stops when `‖b - (I + λ L) x‖ ≤ tolerance · ‖b‖` in every column, or after
    /// `max_iterations`. In `f32` a tolerance below about `1e-6` cannot be promised.
    ///
    /// A right-hand side that is not finite gives `x` that is not finite and no convergence.
    ///
    /// # Cost
    /// An iteration passes over the edges once and over nine arrays of four columns, on all threads, and over the
    /// factors twice; bench `mesh`.
    /// # Panics
    /// If `b` or `x` have not one row per vertex, or more than four columns.
    pub fn solve<const K: usize>(
        &mut self,
        b: &[[f32; K]],
        x: &mut [[f32; K]],
        tolerance: f64,
        max_iterations: usize,
    ) -> SolveReport {
        self.assert_rows(b.len());
        self.assert_rows(x.len());
        self.solver.solve(&mut self.operator, b, x, tolerance, max_iterations)
    }

    fn assert_rows(&self, rows: usize) {
        let vertices = self.operator.rows.len();
        assert_eq!(rows, vertices, "DiffusionSolver: {rows} rows for {vertices} vertices");
    }
}

impl SymmetricSystem for Diffusion {
    const COUPLED: bool = false;

    fn multiply(&self, p: &[[f32; 4]], q: &mut [[f32; 4]]) -> [f64; 4] {
        let Self { lambda, rows, .. } = self;
        multiply_rows(p, q, |vertex| {
            let ring = rows.row(vertex);
            let here = p[vertex];
            let mut around = [0.0_f32; 4];
            for &other in ring {
                let other = p[other as usize];
                for k in 0..4 {
                    around[k] += other[k];
                }
            }
            let diagonal = 1.0 + lambda * ring.len() as f32;
            std::array::from_fn(|k| diagonal * here[k] - lambda * around[k])
        })
    }

    fn prepare(&mut self, residual: &[[f32; 4]]) {
        if let Preconditioner::Factor(factor, solved) = &mut self.preconditioner {
            factor.solve(residual, solved);
        }
    }

    #[inline]
    fn precondition(&self, row: usize, residual: [f32; 4]) -> [f32; 4] {
        match &self.preconditioner {
            Preconditioner::Factor(_, solved) => solved[row],
            Preconditioner::Diagonal(inverse) => residual.map(|r| r * inverse[row]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{combinatorial_laplacian, primitives};

    fn rough(count: usize) -> Vec<[f32; 3]> {
        (0..count).map(|i| std::array::from_fn(|k| ((i * 37 + k * 11) % 19) as f32 - 9.0)).collect()
    }

    #[test]
    fn apply_is_the_matrix() {
        let mesh = primitives::torus(1.0, 0.4, 11, 7);
        let topology = Topology::new(mesh.positions.len(), &mesh.faces);
        let x = rough(mesh.positions.len());
        let mut y = x.clone();
        DiffusionSolver::new(&topology, 3.0).apply(&x, &mut y);
        let laplacian = combinatorial_laplacian(&topology).apply(&x);
        for ((y, x), l) in y.iter().zip(&x).zip(&laplacian) {
            for k in 0..3 {
                approx::assert_abs_diff_eq!(y[k], x[k] + 3.0 * l[k], epsilon = 1e-3);
            }
        }
    }

    #[test]
    fn one_triangle_by_hand() {
        // The operator is 1 + 3λ on what has mean zero, and 1 on constants.
        let topology = Topology::new(4, &[[0, 1, 2]]);
        let mut solver = DiffusionSolver::new(&topology, 2.0);
        let b = [[3.0, 7.0], [0.0, 7.0], [-3.0, 7.0], [5.0, -1.0]];
        let mut x = [[0.0; 2]; 4];
        let report = solver.solve(&b, &mut x, 1e-6, 10);
        assert!(report.converged && report.iterations <= 4, "{report:?}");
        let expected = [[3.0 / 7.0, 7.0], [0.0, 7.0], [-3.0 / 7.0, 7.0], [5.0, -1.0]];
        for (x, e) in x.iter().flatten().zip(expected.iter().flatten()) {
            approx::assert_abs_diff_eq!(x, e, epsilon = 1e-5);
        }
    }

    #[test]
    fn solves_what_it_applies() {
        let mesh = primitives::icosphere(4);
        let topology = Topology::new(mesh.positions.len(), &mesh.faces);
        let mut solver = DiffusionSolver::new(&topology, 20.0);
        let b = rough(mesh.positions.len());
        let mut x = vec![[0.0; 3]; b.len()];
        let report = solver.solve(&b, &mut x, 1e-5, 500);
        assert!(report.converged, "{report:?}");
        let mut back = b.clone();
        solver.apply(&x, &mut back);
        let square = |v: &mut dyn Iterator<Item = f64>| v.map(|x| x * x).sum::<f64>().sqrt();
        let error = square(
            &mut b.as_flattened().iter().zip(back.as_flattened()).map(|(a, b)| f64::from(a - b)),
        ) / square(&mut b.as_flattened().iter().map(|&b| f64::from(b)));
        assert!(error < 3e-5, "{error}");
        // From the solution there is nothing to do, and the same input gives the same bits.
        assert_eq!(solver.solve(&b, &mut x.clone(), 1e-4, 500).iterations, 0);
        let mut again = vec![[0.0; 3]; b.len()];
        solver.solve(&b, &mut again, 1e-5, 500);
        assert_eq!(x, again);
    }

    #[test]
    fn factored_needs_an_iteration_or_two_for_the_same() {
        let mesh = primitives::icosphere(4);
        let topology = Topology::new(mesh.positions.len(), &mesh.faces);
        let b = rough(mesh.positions.len());
        let (mut slow, mut fast) = (b.clone(), b.clone());
        DiffusionSolver::new(&topology, 20.0).solve(&b, &mut slow, 1e-6, 500);
        let report = DiffusionSolver::factored(&topology, 20.0).solve(&b, &mut fast, 1e-6, 500);
        assert!(report.converged && report.iterations <= 3, "{report:?}");
        for (a, b) in slow.as_flattened().iter().zip(fast.as_flattened()) {
            approx::assert_abs_diff_eq!(a, b, epsilon = 1e-4);
        }
    }

    /// By powers of two, so that no digit differs.
    #[test]
    fn what_is_large_or_small_is_solved_alike() {
        let mesh = primitives::icosphere(2);
        let topology = Topology::new(mesh.positions.len(), &mesh.faces);
        let b = rough(mesh.positions.len());
        let mut expected = vec![[0.0; 3]; b.len()];
        let mut solver = DiffusionSolver::new(&topology, 5.0);
        let plain = solver.solve(&b, &mut expected, 1e-5, 200);
        for factor in [-90.0_f32, -60.0, 50.0, 90.0].map(f32::exp2) {
            let times = |rows: &[[f32; 3]]| -> Vec<_> {
                rows.iter().map(|row| row.map(|v| v * factor)).collect()
            };
            let mut x = vec![[0.0; 3]; b.len()];
            let report = solver.solve(&times(&b), &mut x, 1e-5, 200);
            assert_eq!(report, plain, "{factor}");
            assert_eq!(x, times(&expected), "{factor}");
        }
        // Each column by itself, wherever it begins.
        let columns = [90.0_f32, -90.0, 0.0].map(f32::exp2);
        let times = |rows: &[[f32; 3]]| -> Vec<[f32; 3]> {
            rows.iter().map(|row| std::array::from_fn(|k| row[k] * columns[k])).collect()
        };
        for begin in [[0.0; 3], [0.0, 1e20, f32::INFINITY]] {
            let mut x = vec![begin; b.len()];
            assert_eq!(solver.solve(&times(&b), &mut x, 1e-5, 200), plain);
            assert_eq!(x, times(&expected));
        }
    }

    #[test]
    fn zero_and_not_finite() {
        let topology = Topology::new(3, &[[0, 1, 2]]);
        let mut solver = DiffusionSolver::new(&topology, 1.0);
        let mut x = [[0.0; 3]; 3];
        assert!(solver.solve(&[[0.0; 3]; 3], &mut x, 1e-5, 10).converged);
        assert_eq!(x, [[0.0; 3]; 3]);
        x = [[1.0; 3]; 3];
        // No residual is small beside nothing, and one such column would hold up the others.
        let report = solver.solve(&[[0.0; 3]; 3], &mut x, 1e-5, 10);
        assert!(report.converged && report.iterations == 0 && x == [[0.0; 3]; 3], "{report:?}");
        let mut x = [[1.0; 2]; 3];
        let report = solver.solve(&[[0.0, 1.0], [0.0, 2.0], [0.0; 2]], &mut x, 1e-5, 10);
        assert!(
            report.converged && x.iter().all(|x| x[0] == 0.0 && x[1] > 0.0),
            "{report:?} {x:?}"
        );
        let mut b = [[1.0; 3]; 3];
        b[1][2] = f32::NAN;
        assert!(!solver.solve(&b, &mut [[0.0; 3]; 3], 1e-5, 10).converged);
    }
}
