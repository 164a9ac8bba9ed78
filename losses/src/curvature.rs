//! Mean curvature by cotangents: how much a surface bends, in the inverse of its units.

use autodiff_lite::{Real, Var};
use mesh_core::vector::Vec3;
use mesh_core::{Topology, cotangent_weights, vertex_areas};

use crate::kernels::vec3::{accumulate, dot, points, points_mut, scale, sub};
use crate::laplacian::{largest, rounding};
use crate::scalar::{record, vertices, wanted};

/// The length of the mean curvature normal, averaged over the vertices.
///
/// ```text
/// (1/N) Σ_n (1/V) Σ_i ‖Σ_j (cot α_ij + cot β_ij) (x_j - x_i)‖ / (4 A_i)
/// ```
///
/// with `A_i` the areas of all faces around `i`, each whole; on a fine mesh a third of the mean curvature. It does not
/// change when a mesh is subdivided, and halves when it is twice as large, where
/// [`laplacian_cotangent`](crate::laplacian_cotangent) has the unit of the positions. Weights and areas are those of the
/// present positions, in double precision; no gradient passes through them.
///
/// # Shapes
/// `positions [V, 3]` or `[N, V, 3]`, and the topology of all of them → a scalar.
/// # Gradient
/// To positions outside of weights and areas; zero where the norm is, or no longer than the rounding errors of positions
/// and sums. A vertex without area around it is left out.
/// # Cost
/// `O(N (V + E + F))`; the gradient is made in the same pass. Weights are fresh memory in each call.
/// # Panics
/// If the shape is another.
/// # References
/// `mesh_laplacian_smoothing(method="cotcurv")` of PyTorch3D; Desbrun et al. 1999, *Implicit Fairing of Irregular Meshes
/// using Diffusion and Curvature Flow*, equation 14.
#[track_caller]
pub fn laplacian_cotcurv<'t, F: Real>(positions: Var<'t, F>, topology: &Topology) -> Var<'t, F> {
    let name = "laplacian_cotcurv";
    let [n, v] = vertices(name, "positions", positions);
    if topology.vertex_count() != v {
        let message = format!("a topology of {} vertices", topology.vertex_count());
        positions.tape().refuse(name, message, &[("positions", &positions.shape(), "N, V, 3")]);
    }
    let value = positions.value();
    let mut gradient = wanted(positions);
    let weight = 1.0 / (n * v).max(1) as f64;
    let mut total = 0.0;
    for (k, mesh) in points(value.as_slice()).chunks(v.max(1)).enumerate() {
        let mut out = gradient.as_mut().map(|g| &mut points_mut(g)[k * v..(k + 1) * v]);
        let wide: Vec<Vec3> = mesh.iter().map(|p| p.map(Real::to_f64)).collect();
        let weights = cotangent_weights(&wide, &topology.faces, topology);
        let areas = vertex_areas(&wide, &topology.faces);
        for row in 0..v {
            // Halves of sums of cotangents, thirds of areas: (2 w) / (4 · 3 a).
            let factor = 1.0 / (6.0 * areas[row]);
            if !factor.is_finite() {
                continue;
            }
            let ring = topology.vertex_vertices.row(row);
            let entry = |&j: &u32| {
                let edge = topology.edge_between(row as u32, j).expect("neighbours have an edge");
                (j as usize, weights[edge as usize] * factor)
            };
            let (mut bent, mut size, mut reach) = ([F::zero(); 3], 0.0, largest(mesh[row]));
            for (j, w) in ring.iter().map(entry) {
                accumulate(&mut bent, scale(sub(mesh[j], mesh[row]), F::from_f64(w)));
                size += w.abs();
                reach = reach.max(largest(mesh[j]));
            }
            let length = dot(bent, bent).sqrt();
            total += Real::to_f64(length);
            let noise = 2.0 * size * rounding(ring.len() + 1) * Real::to_f64(F::epsilon() * reach);
            if let Some(out) = &mut out
                && Real::to_f64(length) > noise
            {
                let derivative = scale(bent, F::from_f64(weight) / length);
                for (j, w) in ring.iter().map(entry) {
                    let pull = scale(derivative, F::from_f64(w));
                    accumulate(&mut out[j], pull);
                    out[row] = sub(out[row], pull);
                }
            }
        }
    }
    record(name, [positions], weight * total, [gradient])
}

#[cfg(test)]
mod tests {
    use autodiff_lite::Tape;
    use mesh_core::primitives;

    use super::*;
    use crate::testing;

    /// Weights and areas are data, so differences are taken with those of the first positions: the rule is linear in
    /// what is left, and adding it up must give the value, by Euler's theorem for functions of degree one.
    #[test]
    fn the_gradient_adds_up_to_the_value() {
        let torus = primitives::torus(1.0, 0.4, 9, 7);
        let topology = Topology::of(&torus);
        let tape = Tape::<f64>::train(0);
        let x = tape.leaf(torus.vertices::<f64>());
        let loss = laplacian_cotcurv(x, &topology);
        let gradients = loss.backward();
        let gradient = gradients.wrt(x).expect("a leaf");
        let sum: f64 = gradient.iter().zip(&x.value()).map(|(g, x)| g * x).sum();
        assert!((sum - loss.item()).abs() < 1e-12 * loss.item(), "{sum} {}", loss.item());
        let mean: f64 = gradient.iter().sum();
        assert!(mean.abs() < 1e-12, "moving all changes nothing: {mean}");
    }

    /// A third of `|H| = 1 / r`, whatever the mesh.
    #[test]
    fn a_ball_of_any_size_and_resolution() {
        for (level, radius) in [(2, 1.0), (3, 1.0), (3, 2.5)] {
            let mut ball = primitives::icosphere(level);
            ball.positions.iter_mut().flatten().for_each(|x| *x *= radius);
            let found = testing::value(&ball, |x| laplacian_cotcurv(x, &Topology::of(&ball)));
            let expected = 1.0 / (3.0 * f64::from(radius));
            assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
        }
    }

    #[test]
    fn a_plane_is_quiet_within() {
        let (n, mesh) = testing::tilted_plane();
        let tape = Tape::<f32>::train(0);
        let x = tape.leaf(testing::array::<f32>(&mesh.positions));
        let gradients = laplacian_cotcurv(x, &Topology::of(&mesh)).backward();
        testing::assert_quiet(n, gradients.wrt(x).expect("a leaf"));
    }
}
