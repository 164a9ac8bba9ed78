//! Uniform Laplacian smoothing in its two published forms.
//!
//! ```text
//! (L x)_i = (1/deg i) Σ_(j ~ i) x_j - x_i          L = D⁻¹ A - I
//! ```
//!
//! A vertex without neighbours has a zero row.

use autodiff_lite::{Real, Var};
use mesh_core::Csr;

use crate::kernels::vec3::{accumulate, add, dot, points, points_mut, scale, sub};
use crate::scalar::{record, vertices, wanted};

/// The squared Laplacian, summed over the vertices: `mean((L x)²) · 3 V`, averaged over the batch.
///
/// Give the offsets from the template rather than the positions to smooth the deformation and leave the
/// template's own curvature alone, as the DIB-R authors and the kaolin tutorial do.
///
/// ```text
/// (1/N) Σ_n Σ_i ‖(L x)_i‖²
/// ```
///
/// # Shapes
/// `offsets [V, 3]` or `[N, V, 3]`, `neighbors` a `mesh_core::Topology`, or V symmetric rows as its
/// `vertex_vertices` → a scalar.
/// # Cost
/// `O(N (V + E))`; the gradient is made in the same pass.
/// # Panics
/// If the shape is another, or the rows are not as many as the vertices.
/// # References
/// Chen et al. 2019 (DIB-R), the loss in their code; kaolin's DIB-R tutorial.
#[track_caller]
pub fn laplacian_squared<'t, F: Real>(
    offsets: Var<'t, F>,
    neighbors: &impl AsRef<Csr>,
) -> Var<'t, F> {
    let [n, _] = vertices("laplacian_squared", "offsets", offsets);
    let weight = 1.0 / n.max(1) as f64;
    let derivative = F::from_f64(2.0 * weight);
    over_rows("laplacian_squared", offsets, neighbors.as_ref(), weight, |square, _| {
        (Real::to_f64(square), derivative)
    })
}

/// The length of the Laplacian, averaged over the vertices: not squared, so it forgives sharp features.
///
/// ```text
/// (1/N) Σ_n (1/V) Σ_i ‖(L v)_i‖
/// ```
///
/// # Shapes
/// `positions [V, 3]` or `[N, V, 3]`, `neighbors` a `mesh_core::Topology`, or V symmetric rows as its
/// `vertex_vertices` → a scalar.
/// # Gradient
/// Zero at a vertex whose Laplacian is zero, where the norm has no derivative, or no longer than the rounding errors
/// of positions and sums: on flat parts there is no direction in which to pull.
/// # Cost
/// `O(N (V + E))`; the gradient is made in the same pass.
/// # Panics
/// If the shape is another, or the rows are not as many as the vertices.
/// # References
/// `mesh_laplacian_smoothing(method="uniform")` of PyTorch3D; MCMR applies it to shape and deformation.
#[track_caller]
pub fn laplacian_norm<'t, F: Real>(
    positions: Var<'t, F>,
    neighbors: &impl AsRef<Csr>,
) -> Var<'t, F> {
    let [n, v] = vertices("laplacian_norm", "positions", positions);
    let weight = 1.0 / (n * v).max(1) as f64;
    let factor = F::from_f64(weight);
    over_rows("laplacian_norm", positions, neighbors.as_ref(), weight, |square, noise| {
        let length = square.sqrt();
        let derivative = if length > noise { factor / length } else { F::zero() };
        (Real::to_f64(length), derivative)
    })
}

/// How many units in the last place of its largest coordinate a weighted mean of so many positions, less one more, may
/// be long by rounding alone: of the positions, which are rounded as they come, and of the sum.
pub(crate) fn rounding(terms: usize) -> f64 {
    // √3 (terms / 2 + 2), rounded up.
    terms as f64 + 4.0
}

/// The largest coordinate.
#[inline]
pub(crate) fn largest<F: Real>([x, y, z]: [F; 3]) -> F {
    x.abs().max(y.abs()).max(z.abs())
}

/// `weight Σ_i f(‖(L x)_i‖², noise)`, where `f` gives its value and the weighted derivative along `(L x)_i`, as a factor;
/// the noise is how long `(L x)_i` may be by rounding alone.
#[track_caller]
fn over_rows<'t, F: Real>(
    name: &'static str,
    x: Var<'t, F>,
    neighbors: &Csr,
    weight: f64,
    f: impl Fn(F, F) -> (f64, F),
) -> Var<'t, F> {
    let [_, v] = vertices(name, "vertices", x);
    if neighbors.len() != v {
        let message = format!("{} rows of neighbours for {v} vertices", neighbors.len());
        x.tape().refuse(name, message, &[("vertices", &x.shape(), "")]);
    }
    let value = x.value();
    let value = value.as_slice();
    let mut gradient = wanted(x);
    // For each row the derivative of the loss by (L x)_i, divided by the number of neighbours.
    let mut derivatives = gradient.as_ref().map(|_| x.tape().buffer(3 * v));
    let mut total = 0.0;
    for (k, mesh) in points(value).chunks(v.max(1)).enumerate() {
        let mut derivatives = derivatives.as_mut().map(|s| points_mut(s));
        let mut out = gradient.as_mut().map(|g| &mut points_mut(g)[k * v..(k + 1) * v]);
        for (i, row) in neighbors.rows().enumerate() {
            let mut row_derivative = [F::zero(); 3];
            if !row.is_empty() {
                let share = F::one() / F::from_f64(row.len() as f64);
                let (mut sum, mut reach) = ([F::zero(); 3], largest(mesh[i]));
                for &j in row {
                    accumulate(&mut sum, mesh[j as usize]);
                    reach = reach.max(largest(mesh[j as usize]));
                }
                let laplacian = sub(scale(sum, share), mesh[i]);
                let noise = reach * F::from_f64(rounding(row.len())) * F::epsilon();
                let (part, derivative) = f(dot(laplacian, laplacian), noise);
                total += part;
                row_derivative = scale(laplacian, derivative * share);
                if let Some(out) = &mut out {
                    out[i] = sub(out[i], scale(laplacian, derivative));
                }
            }
            if let Some(derivatives) = &mut derivatives {
                derivatives[i] = row_derivative;
            }
        }
        // The transposed product: neighbourhood is mutual, so each vertex gathers from its own row.
        if let (Some(derivatives), Some(out)) = (derivatives, out) {
            for (out, row) in out.iter_mut().zip(neighbors.rows()) {
                let sum =
                    row.iter().fold([F::zero(); 3], |sum, &j| add(sum, derivatives[j as usize]));
                accumulate(out, sum);
            }
        }
    }
    record(name, [x], weight * total, [gradient])
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use mesh_core::{Topology, TriMesh, primitives};
    use proptest::prelude::*;

    use super::*;
    use crate::testing;

    proptest! {
        #[test]
        fn gradients((v, faces) in testing::soup(), batch in proptest::option::of(1usize..4), seed: u64) {
            let rows = Topology::new(v, &faces).vertex_vertices;
            let shapes = [testing::shape(batch, v)];
            testing::checked(&|x: &[Var<'_, f64>]| laplacian_squared(x[0], &rows), &shapes, &testing::options(seed))?;
            testing::checked(&|x: &[Var<'_, f64>]| laplacian_norm(x[0], &rows), &shapes, &testing::options(seed))?;
        }

        #[test]
        fn turning_and_moving_change_nothing(a in -3.0f32..3.0, b in -3.0f32..3.0) {
            let ball = primitives::icosphere(1);
            let rows = Topology::new(42, &ball.faces).vertex_vertices;
            let other = testing::moved(&ball, [a, b], 1.0, [3.0, -2.0, 0.5]);
            let of = |mesh: &TriMesh| testing::value(mesh, |x| laplacian_norm(x, &rows));
            prop_assert!((of(&ball) - of(&other)).abs() < 1e-5);
        }
    }

    /// A tilted plane: what pulled with full strength at every vertex was rounding. A bump still pulls.
    #[test]
    fn a_plane_is_quiet_within() {
        let (n, mut mesh) = testing::tilted_plane();
        let topology = Topology::of(&mesh);
        let gradient = |mesh: &TriMesh| {
            let tape = autodiff_lite::Tape::<f32>::train(0);
            let x = tape.leaf(testing::array::<f32>(&mesh.positions));
            laplacian_norm(x, &topology).backward().wrt(x).expect("a leaf").to_owned()
        };
        testing::assert_quiet(n, &gradient(&mesh).into());
        let middle = n / 2 * n + n / 2;
        mesh.positions[middle][2] += 1e-3;
        assert!(gradient(&mesh)[[middle, 2]] > 0.5 / (n * n) as f32);
    }

    #[test]
    fn a_regular_tetrahedron_by_hand() {
        // About its centre the three others of a vertex v have the mean -v/3, so L v = -4/3 v.
        let s = 1.0 / 3.0f32.sqrt();
        let positions = vec![[s, s, s], [s, -s, -s], [-s, s, -s], [-s, -s, s]];
        let mesh = TriMesh::new(positions, vec![[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]);
        let rows = Topology::new(4, &mesh.faces).vertex_vertices;
        assert_relative_eq!(
            testing::value(&mesh, |x| laplacian_norm(x, &rows)),
            4.0 / 3.0,
            epsilon = 1e-6
        );
        // mean((L x)²) · 3 V = Σ ‖L x‖²
        assert_relative_eq!(
            testing::value(&mesh, |x| laplacian_squared(x, &rows)),
            64.0 / 9.0,
            epsilon = 1e-5
        );
    }

    #[test]
    fn a_stray_vertex_does_not_count() {
        let mesh = TriMesh::new(
            vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [9.0; 3]],
            vec![[0, 1, 2]],
        );
        let rows = Topology::new(4, &mesh.faces).vertex_vertices;
        // Each corner of a triangle lies 3/2 of its way to the centroid from the middle of the other two.
        let lengths = [0.5f64.hypot(0.5), 1.0f64.hypot(0.5), 0.5f64.hypot(1.0)];
        let expected = lengths.iter().sum::<f64>() / 4.0;
        assert_relative_eq!(
            testing::value(&mesh, |x| laplacian_norm(x, &rows)),
            expected,
            epsilon = 1e-6
        );
    }
}
