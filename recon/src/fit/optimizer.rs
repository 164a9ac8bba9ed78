//! The steps that move the mesh.

use mesh_core::{DiffusionSolver, Topology};

/// Momentum and second-moment decay of the optimiser.
const BETAS: (f32, f32) = (0.9, 0.99);
/// How well a gradient or a step is smoothed, as a share of it: what is left is less than the next step changes.
const TOLERANCE: f64 = 0.01;
/// Iterations of that, at most.
const ITERATIONS: usize = 200;

/// Adam with one learning rate for all coordinates, on the variables `u = (I + lambda L) x`.
///
/// A gradient step on `u` moves the vertices by the gradient smoothed twice, which is what lets
/// steps be large without tearing the surface; one learning rate for all coordinates keeps the
/// direction that the smoothing made. As `x` follows `u` linearly, it moves by the step of `u`, smoothed: that is known after fewer
/// iterations than all of `x`, the more so as it differs little from the last one.
#[derive(Debug)]
pub(super) struct Optimizer {
    diffusion: DiffusionSolver,
    smooth_gradient: Vec<[f32; 3]>,
    first: Vec<[f32; 3]>,
    second: Vec<[f32; 3]>,
    /// The first moment, smoothed.
    direction: Vec<[f32; 3]>,
    steps: i32,
}

impl Optimizer {
    /// For a mesh; `smoothness` is lambda, from 0, of the combinatorial Laplacian.
    pub(super) fn new(topology: &Topology, smoothness: f32) -> Self {
        let zeros = || vec![[0.0; 3]; topology.vertex_count()];
        Self {
            diffusion: DiffusionSolver::new(topology, smoothness),
            smooth_gradient: zeros(),
            first: zeros(),
            second: zeros(),
            direction: zeros(),
            steps: 0,
        }
    }

    /// Moves the positions `[V, 3]` against the gradient `[V, 3]`, by about `rate` where that is largest.
    pub(super) fn step(&mut self, gradient: &[[f32; 3]], positions: &mut [[f32; 3]], rate: f32) {
        self.diffusion.solve(gradient, &mut self.smooth_gradient, TOLERANCE, ITERATIONS);
        self.steps += 1;
        let (b1, b2) = BETAS;
        let mut largest = 0.0f32;
        for (i, g) in self.smooth_gradient.iter().enumerate() {
            for k in 0..3 {
                self.first[i][k] = b1 * self.first[i][k] + (1.0 - b1) * g[k];
                self.second[i][k] = b2 * self.second[i][k] + (1.0 - b2) * g[k] * g[k];
                largest = largest.max(self.second[i][k]);
            }
        }
        let (c1, c2) = (1.0 - b1.powi(self.steps), 1.0 - b2.powi(self.steps));
        let length = rate / c1 / ((largest / c2).sqrt() + 1e-20);
        self.diffusion.solve(&self.first, &mut self.direction, TOLERANCE, ITERATIONS);
        for (x, direction) in positions.iter_mut().zip(&self.direction) {
            for k in 0..3 {
                x[k] -= length * direction[k];
            }
        }
    }
}
