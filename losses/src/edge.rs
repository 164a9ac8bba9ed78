//! Edge length: keeps edges short, or near a length.

use autodiff_lite::{CONTIGUOUS, Real, Var};

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
/// `positions [V, 3]` or `[N, V, 3]`, `edges` as in `mesh_core::Topology::edges` → a scalar.
/// # Cost
/// `O(N E)`; the gradient is made in the same pass.
/// # Panics
/// If the shape is another or an edge names a vertex that does not exist.
#[track_caller]
pub fn edge_length_sum<'t, F: Real>(positions: Var<'t, F>, edges: &[[u32; 2]]) -> Var<'t, F> {
    let [n, _] = vertices("edge_length_sum", "positions", positions);
    let weight = 1.0 / n.max(1) as f64;
    over_edges("edge_length_sum", positions, edges, weight, |square| {
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
/// `positions [V, 3]` or `[N, V, 3]`, `edges` as in `mesh_core::Topology::edges` → a scalar.
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
    edges: &[[u32; 2]],
    target: f64,
) -> Var<'t, F> {
    let [n, _] = vertices("edge_length", "positions", positions);
    let weight = 1.0 / (n.max(1) * edges.len().max(1)) as f64;
    let (goal, two) = (F::from_f64(target), F::one() + F::one());
    over_edges("edge_length", positions, edges, weight, |square| {
        let length = square.sqrt();
        let excess = length - goal;
        let slope = if length > F::zero() { two * excess / length } else { F::zero() };
        (Real::to_f64(excess * excess), slope)
    })
}

/// `weight Σ f(‖d‖²)`, where `f` gives its value and its slope along `d`, as a factor of `d`.
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
    let value = value.as_slice().expect(CONTIGUOUS);
    let mut gradient = wanted(positions);
    let factor = F::from_f64(weight);
    let mut total = 0.0;
    for (k, mesh) in points(value).chunks(v.max(1)).enumerate() {
        let mut out = gradient.as_mut().map(|g| &mut points_mut(g)[k * v..(k + 1) * v]);
        for &[i, j] in edges {
            let (i, j) = (i as usize, j as usize);
            let d = sub(mesh[i], mesh[j]);
            let (part, slope) = f(dot(d, d));
            total += part;
            if let Some(out) = &mut out {
                let g = scale(d, slope * factor);
                out[i] = add(out[i], g);
                out[j] = sub(out[j], g);
            }
        }
    }
    record(name, [positions], weight * total, [gradient])
}
