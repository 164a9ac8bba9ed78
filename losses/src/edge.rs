//! Edge length: keeps edges short, or near a length.

use autodiff_lite::{Real, Var};

use crate::kernels::vec3::{add, dot, points, points_mut, scale, sub};
use crate::scalar::{record, vertices, wanted};

/// The sum of squared edge lengths, averaged over the batch.
///
/// ```text
/// (1/N) Σ_n Σ_(i,j) ‖v_i - v_j‖²
/// ```
///
/// This is the form of img2mesh, where its weight is 1e-8 for a mesh of radius 37.5; it grows with the
/// number of edges. For a figure that does not, see [`edge_length`].
///
/// # Shapes
/// `positions [V, 3]` or `[N, V, 3]`, `edges` a `mesh_core::Topology` or its list of edges → a scalar.
/// # Cost
/// `O(N E)`; the gradient is made in the same pass.
/// # Panics
/// If the shape is another or an edge names a vertex that does not exist.
#[track_caller]
pub fn edge_length_sum<'t, F: Real>(
    positions: Var<'t, F>,
    edges: &(impl AsRef<[[u32; 2]]> + ?Sized),
) -> Var<'t, F> {
    let [n, _] = vertices("edge_length_sum", "positions", positions);
    let weight = 1.0 / n.max(1) as f64;
    over_edges("edge_length_sum", positions, edges.as_ref(), weight, |square| {
        (square.to_f64(), F::one() + F::one())
    })
}

/// The mean squared deviation of the edge lengths from `target`, in the units of the positions.
///
/// ```text
/// (1/N) Σ_n (1/E) Σ_(i,j) (‖v_i - v_j‖ - target)²
/// ```
///
/// With `target = 0` this is the mean squared edge length.
///
/// # Shapes
/// `positions [V, 3]` or `[N, V, 3]`, `edges` a `mesh_core::Topology` or its list of edges → a scalar.
/// # Gradient
/// Zero at an edge of no length, where the direction is undefined.
/// # Cost
/// `O(N E)`; the gradient is made in the same pass.
/// # Panics
/// If the shape is another or an edge names a vertex that does not exist.
/// # References
/// `mesh_edge_loss` of PyTorch3D.
#[track_caller]
pub fn edge_length<'t, F: Real>(
    positions: Var<'t, F>,
    edges: &(impl AsRef<[[u32; 2]]> + ?Sized),
    target: f64,
) -> Var<'t, F> {
    let edges = edges.as_ref();
    let [n, _] = vertices("edge_length", "positions", positions);
    let weight = 1.0 / (n.max(1) * edges.len().max(1)) as f64;
    let (goal, two) = (F::from_f64(target), F::one() + F::one());
    over_edges("edge_length", positions, edges, weight, |square| {
        let length = square.sqrt();
        let excess = length - goal;
        let derivative = if length > F::zero() { two * excess / length } else { F::zero() };
        (Real::to_f64(excess * excess), derivative)
    })
}

/// `weight Σ f(‖d‖²)`, where `f` gives its value and its derivative along `d`, as a factor of `d`.
#[track_caller]
fn over_edges<'t, F: Real>(
    name: &'static str,
    positions: Var<'t, F>,
    edges: &[[u32; 2]],
    weight: f64,
    f: impl Fn(F) -> (f64, F),
) -> Var<'t, F> {
    let [_, v] = vertices(name, "positions", positions);
    let value = positions.value();
    let value = value.as_slice();
    let mut gradient = wanted(positions);
    let factor = F::from_f64(weight);
    let mut total = 0.0;
    for (k, mesh) in points(value).chunks(v.max(1)).enumerate() {
        let mut out = gradient.as_mut().map(|g| &mut points_mut(g)[k * v..(k + 1) * v]);
        for &[i, j] in edges {
            let (i, j) = (i as usize, j as usize);
            let d = sub(mesh[i], mesh[j]);
            let (part, derivative) = f(dot(d, d));
            total += part;
            if let Some(out) = &mut out {
                let g = scale(d, derivative * factor);
                out[i] = add(out[i], g);
                out[j] = sub(out[j], g);
            }
        }
    }
    record(name, [positions], weight * total, [gradient])
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
            let edges = Topology::new(v, &faces).edges;
            let shapes = [testing::shape(batch, v)];
            testing::checked(&|x: &[Var<'_, f64>]| edge_length_sum(x[0], &edges), &shapes, &testing::options(seed))?;
            testing::checked(&|x: &[Var<'_, f64>]| edge_length(x[0], &edges, 0.7), &shapes, &testing::options(seed))?;
        }

        #[test]
        fn only_scale_matters(a in -3.0f32..3.0, b in -3.0f32..3.0, s in 0.5f32..2.0) {
            let ball = primitives::icosphere(1);
            let edges = Topology::new(42, &ball.faces).edges;
            let other = testing::moved(&ball, [a, b], s, [0.3, -0.2, 0.9]);
            let of = |mesh: &TriMesh| testing::value(mesh, |x| edge_length_sum(x, &edges));
            let expected = of(&ball) * f64::from(s * s);
            prop_assert!((of(&other) - expected).abs() < 1e-5 * expected);
        }
    }

    #[test]
    fn a_unit_square_by_hand() {
        let mesh = TriMesh::new(
            vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]],
            vec![[0, 1, 2], [0, 2, 3]],
        );
        let edges = Topology::new(4, &mesh.faces).edges;
        // Four sides of 1 and a diagonal of √2.
        assert_relative_eq!(testing::value(&mesh, |x| edge_length_sum(x, &edges)), 6.0);
        assert_relative_eq!(testing::value(&mesh, |x| edge_length(x, &edges, 0.0)), 6.0 / 5.0);
        let off = (2.0f64.sqrt() - 1.0).powi(2) / 5.0;
        assert_relative_eq!(
            testing::value(&mesh, |x| edge_length(x, &edges, 1.0)),
            off,
            epsilon = 1e-12
        );
    }

    #[test]
    fn a_vanished_edge_has_no_derivative() {
        let tape = autodiff_lite::Tape::<f64>::train(0);
        let x = tape.leaf(ndarray::Array2::zeros((2, 3)));
        let gradients = edge_length(x, &[[0, 1]], 0.5).backward();
        assert!(gradients.wrt(x).is_some_and(|g| g.iter().all(|&g| g == 0.0)));
    }
}
