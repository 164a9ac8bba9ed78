//! The surface that has given normals.

use crate::Topology;
use crate::conjugate_gradients::{ConjugateGradients, SymmetricSystem, products};

/// Positions at which the faces have these normals as nearly as they can, near those where vertices are held.
///
/// Least squares over all vertices at once, so that a whole side moves with its normals:
///
/// ```text
/// Σ_f Σ_ij (n_f · (x_i - x_j))² + Σ_v hold_v |x_v - x0_v|²
/// ```
///
/// over the three edges `ij` of each face `f`. Sizes of faces do not count, so that long and short edges are bent alike.
///
/// ```
/// use mesh_core::{Topology, face_normals, integrate_normals, primitives, subdivide};
/// let flat = (0..4).fold(primitives::cuboid([1.0; 3]), |mesh, _| subdivide(&mesh));
/// let dented = flat.clone().map_positions(|p| [p[0], p[1], p[2] - if p[2] > 0.0 { 0.02 * (3.0 * p[0]).cos() } else { 0.0 }]);
/// let normals = face_normals(&flat.positions, &flat.faces);
/// let mended = integrate_normals(&dented.positions, &Topology::of(&dented), &normals, &vec![1e-4; dented.positions.len()]);
/// let lid = |positions: &[[f32; 3]]| {
///     let heights = positions.iter().map(|p| p[2]).filter(|&z| z > 0.45);
///     heights.clone().fold(f32::MIN, f32::max) - heights.fold(f32::MAX, f32::min)
/// };
/// assert!(lid(&mended) < 0.1 * lid(&dented.positions));
/// ```
///
/// # Shapes
/// `positions [V, 3]`, `normals [F, 3]`, `hold [V]`, above 0: 1 holds a vertex about as much as a face pulls at it. A hold of `h` lets
/// dents go that are some `1 / √h` faces wide.
///
/// # Cost
/// At most 300 passes over the faces; 20 ms for 20,000 of them. The sums over faces are on one thread.
///
/// # Panics
/// If arrays have not these lengths.
///
/// # References
/// Yu, Zhou, Xu, Shi, Bao, Guo and Shum 2004, *Mesh editing with Poisson-based gradient field manipulation*, TOG 23(3), with the normals alone;
/// Sun, Rosin, Martin and Langbein 2007, *Fast and effective feature-preserving mesh denoising*, TVCG 13(5), equation 12.
pub fn integrate_normals(
    positions: &[[f32; 3]],
    topology: &Topology,
    normals: &[[f32; 3]],
    hold: &[f32],
) -> Vec<[f32; 3]> {
    let faces = &topology.faces;
    let counts = [positions.len(), hold.len(), normals.len()];
    let wanted = [topology.vertex_count(), topology.vertex_count(), faces.len()];
    assert_eq!(counts, wanted, "integrate_normals: positions, hold and normals");
    let mut system = Planes { faces, normals, hold, diagonal: Vec::new() };
    system.diagonal = system.diagonal();
    let padded: Vec<[f32; 4]> = positions.iter().map(|&[x, y, z]| [x, y, z, 0.0]).collect();
    let mut pull = vec![[0.0; 4]; positions.len()];
    system.add_bends(&padded, &mut pull);
    let right: Vec<[f32; 3]> = pull.iter().map(|g| [-g[0], -g[1], -g[2]]).collect();
    let mut moves = vec![[0.0; 3]; positions.len()];
    let mut solver = ConjugateGradients::new(positions.len());
    solver.solve(&mut system, &right, &mut moves, TOLERANCE, MOST);
    let moved = |(p, d): (&[f32; 3], &[f32; 3])| std::array::from_fn(|k| p[k] + d[k]);
    positions.iter().zip(&moves).map(moved).collect()
}

/// Of what bends faces away from their normals.
const TOLERANCE: f64 = 1e-2;
/// Iterations of a solve.
const MOST: usize = 300;

/// The matrix of the least squares.
struct Planes<'a> {
    faces: &'a [[u32; 3]],
    normals: &'a [[f32; 3]],
    hold: &'a [f32],
    /// The largest eigenvalue of each vertex's own block where it is flat.
    diagonal: Vec<f32>,
}

impl Planes<'_> {
    fn diagonal(&self) -> Vec<f32> {
        let mut diagonal = self.hold.to_vec();
        for &v in self.faces.iter().flatten() {
            diagonal[v as usize] += 2.0;
        }
        diagonal
    }

    /// Adds the gradient of half the first sum.
    fn add_bends(&self, x: &[[f32; 4]], out: &mut [[f32; 4]]) {
        for (face, n) in self.faces.iter().zip(self.normals) {
            let corners = face.map(|v| v as usize);
            // From the first corner, lest a mesh far away is rounded to steps.
            let from = x[corners[0]];
            let heights = corners.map(|v| (0..3).map(|k| n[k] * (x[v][k] - from[k])).sum::<f32>());
            let sum = heights[0] + heights[1] + heights[2];
            for (v, height) in corners.into_iter().zip(heights) {
                let pull = 3.0 * height - sum;
                for k in 0..3 {
                    out[v][k] += pull * n[k];
                }
            }
        }
    }
}

impl SymmetricSystem for Planes<'_> {
    const COUPLED: bool = true;

    fn multiply(&self, p: &[[f32; 4]], q: &mut [[f32; 4]]) -> [f64; 4] {
        for ((q, p), hold) in q.iter_mut().zip(p).zip(self.hold) {
            *q = p.map(|p| hold * p);
        }
        self.add_bends(p, q);
        products(p, q)
    }

    fn precondition(&self, row: usize, residual: [f32; 4]) -> [f32; 4] {
        residual.map(|r| r / self.diagonal[row])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{TriMesh, face_normals, primitives, subdivide};

    fn cube() -> TriMesh {
        (0..4).fold(primitives::cuboid([1.0; 3]), |cube, _| subdivide(&cube))
    }

    fn farthest(a: &[[f32; 3]], b: &[[f32; 3]]) -> f32 {
        a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    }

    #[test]
    fn own_normals_move_nothing() {
        for away in [0.0, 100.0] {
            let sphere = primitives::icosphere(3).map_positions(|p: [f32; 3]| p.map(|x| x + away));
            let normals = face_normals(&sphere.positions, &sphere.faces);
            let hold = vec![1e-3; sphere.positions.len()];
            let found =
                integrate_normals(&sphere.positions, &Topology::of(&sphere), &normals, &hold);
            assert!(farthest(&sphere.positions, &found) < 1e-4, "{away}");
        }
    }

    #[test]
    fn a_side_rises_as_a_whole_to_the_vertices_that_are_held() {
        let cube = cube();
        let normals = face_normals(&cube.positions, &cube.faces);
        let topology = Topology::of(&cube);
        // Sunk by as much everywhere but at the rim, which is held.
        let inner = |p: &[f32; 3]| p[2] > 0.49 && p[0].abs() < 0.49 && p[1].abs() < 0.49;
        let sunk = cube.clone().map_positions(|p| if inner(&p) { [p[0], p[1], 0.45] } else { p });
        let hold: Vec<f32> =
            cube.positions.iter().map(|p| if inner(p) { 1e-4 } else { 10.0 }).collect();
        let found = integrate_normals(&sunk.positions, &topology, &normals, &hold);
        assert!(farthest(&cube.positions, &sunk.positions) > 0.049);
        assert!(farthest(&cube.positions, &found) < 0.003, "{}", farthest(&cube.positions, &found));
        // Held everywhere it stays sunk.
        let held = integrate_normals(&sunk.positions, &topology, &normals, &vec![1e4; hold.len()]);
        assert!(farthest(&sunk.positions, &held) < 1e-3);
    }

    #[test]
    fn the_gradient_is_that_of_the_sum() {
        let mesh = primitives::icosphere(1);
        let count = mesh.positions.len();
        let normals: Vec<[f32; 3]> = (0..mesh.faces.len())
            .map(|f| std::array::from_fn(|k| ((f * 7 + k * 5) % 11) as f32 / 5.0 - 1.0))
            .collect();
        let hold: Vec<f32> = (0..count).map(|v| 0.1 + 0.05 * (v % 4) as f32).collect();
        let energy = |x: &[[f64; 3]]| -> f64 {
            let bends: f64 = mesh
                .faces
                .iter()
                .zip(&normals)
                .map(|(face, n)| {
                    let h = face
                        .map(|v| (0..3).map(|k| f64::from(n[k]) * x[v as usize][k]).sum::<f64>());
                    (h[0] - h[1]).powi(2) + (h[1] - h[2]).powi(2) + (h[2] - h[0]).powi(2)
                })
                .sum();
            let holds: f64 = x
                .iter()
                .zip(&hold)
                .map(|(x, h)| f64::from(*h) * x.iter().map(|x| x * x).sum::<f64>())
                .sum();
            0.5 * (bends + holds)
        };
        let mut planes =
            Planes { faces: &mesh.faces, normals: &normals, hold: &hold, diagonal: Vec::new() };
        planes.diagonal = planes.diagonal();
        let x: Vec<[f32; 4]> = mesh.positions.iter().map(|p| [p[0], p[1], p[2], 0.0]).collect();
        let mut gradient = vec![[0.0; 4]; count];
        planes.multiply(&x, &mut gradient);
        for (v, k) in [(0, 0), (5, 1), (17, 2), (41, 1)] {
            let moved = |by: f64| {
                let mut x: Vec<[f64; 3]> =
                    mesh.positions.iter().map(|p| p.map(f64::from)).collect();
                x[v][k] += by;
                energy(&x)
            };
            let wanted = (moved(1e-4) - moved(-1e-4)) / 2e-4;
            assert!(
                (f64::from(gradient[v][k]) - wanted).abs() < 1e-3,
                "{} {wanted}",
                gradient[v][k]
            );
        }
    }
}
