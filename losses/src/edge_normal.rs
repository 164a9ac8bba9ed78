//! Edges against the normals of the surface that they should lie in.

use autodiff_lite::{Real, Var};

use crate::kernels::vec3::{add, dot, points, points_mut, scale, sub, unit, unit_grad};
use crate::scalar::{record, sign, vertices, wanted};

/// How far edges are from perpendicular to the true normals nearest to their ends.
///
/// ```text
/// (1/(2 N E)) Σ over both directions (u, v) of all edges |⟨ (v - u) / ‖v - u‖, n_near(u) ⟩|
/// ```
///
/// # Shapes
/// `positions [V, 3]` or `[N, V, 3]`; `edges` a list or a `mesh_core::Topology`; `normals`, three numbers for each true point, unit vectors, set after set in a
/// batch; `nearest`, for each vertex the index of the nearest true point in its set
/// ([`Matches::x_to_y`](crate::Matches::x_to_y)) → a scalar in `[0, 1]`.
/// # Gradient
/// To the positions, the nearest points being as they are; zero where an edge is perpendicular already, the kink of the
/// absolute value. An edge of no length counts as 0.
/// # Cost
/// `O(N E)`; the gradient is made in the same pass.
/// # Panics
/// If a shape is another, or an index names a point or vertex that does not exist.
/// # References
/// Wang et al. 2018, *Pixel2Mesh*, equation 5, as its code has it: an absolute value, where the paper squares. That code
/// lists each vertex as an edge of no length to itself, which makes its mean smaller by `2 E / (2 E + V)`.
#[track_caller]
pub fn edge_normal<'t, F: Real>(
    positions: Var<'t, F>,
    edges: &(impl AsRef<[[u32; 2]]> + ?Sized),
    normals: &[F],
    nearest: &[u32],
) -> Var<'t, F> {
    let edges = edges.as_ref();
    let [n, v] = vertices("edge_normal", "positions", positions);
    let normals = points(normals);
    let per_set = normals.len().checked_div(n).unwrap_or(0);
    let inside = nearest.len() == n * v
        && normals.len() == n * per_set
        && nearest.iter().all(|&i| (i as usize) < per_set)
        && edges.iter().flatten().all(|&i| (i as usize) < v);
    if !inside {
        let message = format!(
            "{} indices into {} normals, as many for each set, and edges among {v} vertices, do not fit",
            nearest.len(),
            normals.len()
        );
        let operands = [("positions", &positions.shape()[..], "N, V, 3")];
        positions.tape().refuse("edge_normal", message, &operands);
    }
    let x = positions.value();
    let x = points(x.as_slice());
    let mut gradient = wanted(positions);
    let weight = 1.0 / (2 * n * edges.len()).max(1) as f64;
    let mut total = 0.0;
    for k in 0..n {
        let (first, set) = (k * v, k * per_set);
        for (u, w) in edges.iter().flat_map(|&[a, b]| [(a, b), (b, a)]) {
            let (u, w) = (first + u as usize, first + w as usize);
            let normal = normals[set + nearest[u] as usize];
            let (along, inverse) = unit(sub(x[w], x[u]));
            let cosine = dot(along, normal);
            total += Real::to_f64(cosine.abs());
            if let Some(gradient) = &mut gradient {
                let weight = sign(cosine) * F::from_f64(weight);
                let pull = unit_grad(along, inverse, scale(normal, weight));
                let gradient = points_mut(gradient);
                gradient[w] = add(gradient[w], pull);
                gradient[u] = sub(gradient[u], pull);
            }
        }
    }
    record("edge_normal", [positions], total * weight, [gradient])
}

#[cfg(test)]
mod tests {
    use autodiff_lite::Tape;
    use mesh_core::{Topology, primitives};
    use proptest::prelude::*;

    use super::*;
    use crate::testing;

    proptest! {
        #[test]
        fn gradients(batch in proptest::option::of(1usize..3), (v, faces) in testing::soup(), seed: u64) {
            let edges = Topology::new(v, &faces).edges;
            let n = batch.unwrap_or(1);
            let normals: Vec<f64> = testing::options(seed ^ 5).draw(&[vec![n * 4, 3]])[0]
                .rows().into_iter().flat_map(|r| unit([r[0], r[1], r[2]]).0).collect();
            let nearest: Vec<u32> = (0..n * v).map(|i| (i as u32 * 7 + seed as u32 % 5) % 4).collect();
            let options = testing::options(seed);
            let shape = [testing::shape(batch, v)];
            // Where an edge is nearly perpendicular, differences would cross the kink; a short one
            // turns far within a difference.
            let x = options.draw(&shape);
            let x = points(x[0].as_slice().expect("drawn row-major"));
            let smooth = (0..n).all(|k| {
                edges.iter().flat_map(|&[a, b]| [(a, b), (b, a)]).all(|(a, b)| {
                    let (a, b) = (k * v + a as usize, k * v + b as usize);
                    let along = sub(x[b], x[a]);
                    let normal = points(&normals)[k * 4 + nearest[a] as usize];
                    dot(unit(along).0, normal).abs() > 1e-3 && dot(along, along) > 1e-2
                })
            });
            prop_assume!(smooth);
            testing::checked(&|x: &[Var<'_, f64>]| edge_normal(x[0], &edges, &normals, &nearest),
                &shape, &options)?;
        }
    }

    #[test]
    fn a_flat_sheet_lies_in_its_plane_and_a_tilted_one_does_not() {
        let tape = Tape::<f64>::train(0);
        let x = tape.leaf(ndarray::arr2(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 2.0]]));
        let edges = [[0, 1], [0, 2]];
        let up = [0.0, 0.0, 1.0];
        // One edge lies in the plane and one stands on it.
        assert_eq!(edge_normal(x, &edges, &up, &[0; 3]).item(), 0.5);
        assert_eq!(edge_normal(x, &edges[..1], &up, &[0; 3]).item(), 0.0);
        assert_eq!(edge_normal(x, &[[1, 1]], &up, &[0; 3]).item(), 0.0);
    }

    #[test]
    fn the_finer_a_sphere_the_better_its_edges_are_tangent() {
        let values = [1, 2, 3].map(|level| {
            let ball = primitives::icosphere(level);
            let edges = Topology::new(ball.positions.len(), &ball.faces).edges;
            let tape = Tape::<f64>::eval();
            let x = testing::array::<f64>(&ball.positions);
            let nearest: Vec<u32> = (0..ball.positions.len() as u32).collect();
            let normals: Vec<f64> = x.iter().copied().collect();
            edge_normal(tape.constant(x), &edges, &normals, &nearest).item()
        });
        // Half the chord's angle: it halves with the length of the edges.
        assert!(
            (values[0] / values[1] - 2.0).abs() < 0.15 && (values[1] / values[2] - 2.0).abs() < 0.1,
            "{values:?}"
        );
    }

    #[test]
    #[should_panic(
        expected = "edge_normal: 1 indices into 1 normals, as many for each set, and edges among 2 vertices"
    )]
    fn indices_must_fit() {
        let tape = Tape::<f64>::eval();
        let x = tape.constant(ndarray::Array2::zeros((2, 3)));
        let _ = edge_normal(x, &[[0, 1]], &[0.0, 0.0, 1.0], &[0]);
    }
}
