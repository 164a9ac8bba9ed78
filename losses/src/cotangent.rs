//! The cotangent Laplacian: a surface should bend little, however its vertices are spread on it.

use autodiff_lite::{Real, Var};
use mesh_core::{Scalar, SparseRows};

use crate::kernels::vec3::{accumulate, dot, points, points_mut, scale, sub};
use crate::laplacian::{largest, rounding};
use crate::scalar::{record, vertices, wanted};

/// The distance of each vertex from the cotangent-weighted mean of its neighbours, averaged over the
/// vertices.
///
/// ```text
/// (1/N) Σ_n (1/V) Σ_i ‖Σ_j w_ij x_j / Σ_j w_ij - x_i‖          w_ij = (cot α + cot β) / 2
/// ```
///
/// Unlike [`laplacian_norm`](crate::laplacian_norm) it does not pull vertices together along the
/// surface: on a plane it is zero for every triangulation, but at the border. The weights are data, of the
/// present positions or of a template: no gradient passes through them.
///
/// # Shapes
/// `positions [V, 3]` or `[N, V, 3]`; `laplacians` of [`mesh_core::cotangent_laplacian`], one for all
/// meshes or one for each → a scalar.
/// # Gradient
/// To positions outside the weights; zero where the norm is, or no longer than the rounding errors of positions, weights
/// and sums. A vertex whose weights add up to less than
/// a hundredth of their absolute sum (angles beyond 90° on all sides, slivers) is left out, since the mean
/// of its neighbours is then anywhere.
/// # Cost
/// `O(N (V + E))`; the gradient is made in the same pass.
/// # Panics
/// If the shape is another, there are other numbers of matrices or rows.
/// # References
/// `mesh_laplacian_smoothing(method="cot")` of PyTorch3D, which divides by the sum whatever it is;
/// Pinkall and Polthier 1993, *Computing discrete minimal surfaces and their conjugates*.
#[track_caller]
pub fn laplacian_cotangent<'t, F: Real, T: Scalar>(
    positions: Var<'t, F>,
    laplacians: &[SparseRows<T>],
) -> Var<'t, F> {
    let name = "laplacian_cotangent";
    let [n, v] = vertices(name, "positions", positions);
    let fits = laplacians.len() == n || laplacians.len() == 1;
    if !fits || laplacians.iter().any(|matrix| matrix.rows.len() != v) {
        let message = format!("{} matrices for {n} meshes of {v} rows", laplacians.len());
        positions.tape().refuse(name, message, &[("positions", &positions.shape(), "N, V, 3")]);
    }
    let value = positions.value();
    let value = value.as_slice();
    let mut gradient = wanted(positions);
    let weight = 1.0 / (n * v).max(1) as f64;
    let mut total = 0.0;
    for (k, mesh) in points(value).chunks(v.max(1)).enumerate() {
        let matrix = &laplacians[k % laplacians.len()];
        let mut out = gradient.as_mut().map(|g| &mut points_mut(g)[k * v..(k + 1) * v]);
        for row in 0..v {
            let entries = || {
                let slots = matrix.rows.range(row);
                let columns = matrix.rows.indices[slots.clone()].iter().map(|&j| j as usize);
                let entries = columns.zip(&matrix.values[slots]);
                entries.filter(move |&(j, _)| j != row).map(|(j, &w)| (j, w.widened()))
            };
            let (sum, size) =
                entries().fold((0.0, 0.0), |(sum, size), (_, w)| (sum + w, size + w.abs()));
            if sum <= 0.01 * size {
                continue;
            }
            let share = |w: f64| F::from_f64(w / sum);
            let mean = entries().fold([F::zero(); 3], |mut mean, (j, w)| {
                accumulate(&mut mean, scale(mesh[j], share(w)));
                mean
            });
            let apart = sub(mean, mesh[row]);
            let length = dot(apart, apart).sqrt();
            total += Real::to_f64(length);
            if let Some(out) = &mut out
                && Real::to_f64(length) > noise(&entries, mesh, row, size / sum, T::EPSILON)
            {
                let derivative = scale(apart, F::from_f64(weight) / length);
                out[row] = sub(out[row], derivative);
                entries().for_each(|(j, w)| accumulate(&mut out[j], scale(derivative, share(w))));
            }
        }
    }
    record(name, [positions], weight * total, [gradient])
}

/// How long a weighted mean less the vertex itself may be by rounding alone, the weights having `epsilon` and adding up
/// to `gain` in size: their own rounding errors act like those of the positions.
fn noise<F: Real, I: Iterator<Item = (usize, f64)>>(
    entries: &impl Fn() -> I,
    mesh: &[[F; 3]],
    row: usize,
    gain: f64,
    epsilon: f64,
) -> f64 {
    let first = (1, largest(mesh[row]));
    let (terms, reach) =
        entries().fold(first, |(terms, reach), (j, _)| (terms + 1, reach.max(largest(mesh[j]))));
    let epsilon = Real::to_f64(F::epsilon()).max(epsilon);
    2.0 * gain * rounding(terms) * epsilon * Real::to_f64(reach)
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use mesh_core::{Topology, TriMesh, cotangent_laplacian, primitives};
    use proptest::prelude::*;

    use super::*;
    use crate::testing;

    fn matrix<T: Scalar>(mesh: &TriMesh) -> SparseRows<T> {
        let topology = Topology::new(mesh.positions.len(), &mesh.faces);
        let positions: Vec<_> =
            mesh.positions.iter().map(|p| p.map(|x| T::narrowed(f64::from(x)))).collect();
        cotangent_laplacian(&positions, &mesh.faces, &topology)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn gradients((v, faces) in testing::soup(), batch in proptest::option::of(1usize..4), seed: u64) {
            let place = testing::random(&[v, 3], -1.0, 1.0, seed ^ 9);
            let place = place.rows().into_iter().map(|p| [p[0] as f32, p[1] as f32, p[2] as f32]);
            let matrices = [matrix::<f64>(&TriMesh::new(place.collect(), faces))];
            let shapes = [testing::shape(batch, v)];
            let options = testing::Options { tolerance: 1e-5, ..testing::options(seed) };
            testing::checked(&|x: &[Var<'_, f64>]| laplacian_cotangent(x[0], &matrices), &shapes, &options)?;
        }
    }

    /// A flat grid, its inner vertices moved along it: the uniform Laplacian sees that, this one not.
    #[test]
    fn spreading_on_a_plane_is_free() {
        let n = 6;
        let mut positions = Vec::new();
        let mut faces = Vec::new();
        for i in 0..n {
            for j in 0..n {
                let inner = i > 0 && i + 1 < n && j > 0 && j + 1 < n;
                let by = if inner { 0.2 * ((3 * i + 5 * j) as f32).sin() } else { 0.0 };
                positions.push([i as f32 + by, j as f32 - by, 0.5]);
                if i + 1 < n && j + 1 < n {
                    let a = (i * n + j) as u32;
                    faces.extend([
                        [a, a + n as u32, a + 1],
                        [a + 1, a + n as u32, a + n as u32 + 1],
                    ]);
                }
            }
        }
        let mesh = TriMesh::new(positions, faces);
        let border = |mesh: &TriMesh| {
            testing::value(mesh, |x| laplacian_cotangent(x, &[matrix::<f64>(mesh)]))
        };
        let mut inner_only = matrix::<f32>(&mesh);
        for row in
            (0..n * n).filter(|r| r / n == 0 || r / n == n - 1 || r % n == 0 || r % n == n - 1)
        {
            let range = inner_only.rows.range(row);
            inner_only.values[range].fill(0.0);
        }
        let inner =
            testing::value(&mesh, |x| laplacian_cotangent(x, std::slice::from_ref(&inner_only)));
        assert!(inner < 1e-6, "{inner}");
        assert!(border(&mesh) > 0.01);
        let topology = Topology::new(n * n, &mesh.faces);
        let uniform =
            testing::value(&mesh, |x| crate::laplacian_norm(x, &topology.vertex_vertices));
        assert!(uniform > 0.02, "{uniform}");
    }

    /// A tilted plane: what pulled with full strength at every vertex was rounding.
    #[test]
    fn a_plane_is_quiet_within() {
        let (n, mesh) = crate::testing::tilted_plane();
        let tape = autodiff_lite::Tape::<f32>::train(0);
        let x = tape.leaf(testing::array::<f32>(&mesh.positions));
        let loss = laplacian_cotangent(x, &[matrix::<f32>(&mesh)]);
        let gradients = loss.backward();
        crate::testing::assert_quiet(n, gradients.wrt(x).expect("a leaf"));
    }

    #[test]
    fn a_regular_tetrahedron_by_hand() {
        // All weights are alike, so it is the uniform one: L v = -4/3 v on the unit sphere.
        let s = 1.0 / 3.0f32.sqrt();
        let positions = vec![[s, s, s], [s, -s, -s], [-s, s, -s], [-s, -s, s]];
        let mesh = TriMesh::new(positions, vec![[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]);
        let found = testing::value(&mesh, |x| laplacian_cotangent(x, &[matrix::<f64>(&mesh)]));
        assert_relative_eq!(found, 4.0 / 3.0, epsilon = 1e-6);
    }

    #[test]
    fn a_finer_ball_bends_less_between_vertices() {
        let of = |level| {
            let ball = primitives::icosphere(level);
            testing::value(&ball, |x| laplacian_cotangent(x, &[matrix::<f32>(&ball)]))
        };
        // Quadratic in the length of an edge.
        assert!((3.0..5.0).contains(&(of(2) / of(3))));
    }
}
