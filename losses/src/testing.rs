//! What the tests of several losses share.

use autodiff_lite::testkit::check;
pub(crate) use autodiff_lite::testkit::{Options, function};
use autodiff_lite::{Real, Tape, Tensor, Var};
use mesh_core::TriMesh;
use ndarray::{Array2, ArrayD, IxDyn};
use proptest::prelude::*;

/// Gradients of losses are divided by lengths, so differences are a little less exact than for plain ops; and most losses
/// are smooth in pieces only: between assignments, orders and signs.
pub(crate) fn options(seed: u64) -> Options {
    Options { tolerance: 1e-6, seed, ..Options::default().pieces() }
}

/// Vertices and faces among them: any winding, borders, edges of three faces, stray vertices.
pub(crate) fn soup() -> impl Strategy<Value = (usize, Vec<[u32; 3]>)> {
    (3usize..9).prop_flat_map(|v| {
        let corners = proptest::sample::subsequence((0..v as u32).collect::<Vec<_>>(), 3);
        let face = corners.prop_shuffle().prop_map(|c| [c[0], c[1], c[2]]);
        (Just(v), proptest::collection::vec(face, 1..10)).prop_map(|(v, mut faces)| {
            // Two faces on the same corners may cancel exactly, and a zero normal has no gradient.
            let mut seen = std::collections::BTreeSet::new();
            faces.retain(|face: &[u32; 3]| {
                let mut corners = *face;
                corners.sort_unstable();
                seen.insert(corners)
            });
            (v, faces)
        })
    })
}

/// `[V, 3]` for one mesh, `[N, V, 3]` for a batch.
pub(crate) fn shape(batch: Option<usize>, v: usize) -> Vec<usize> {
    batch.into_iter().chain([v, 3]).collect()
}

/// Whether the rule agrees with central differences at random inputs.
pub(crate) fn checked<C>(
    f: &C,
    shapes: &[Vec<usize>],
    options: &Options,
) -> Result<(), TestCaseError>
where
    C: for<'t> Fn(&[Var<'t, f64>]) -> Var<'t, f64>,
{
    check(f, &options.draw(shapes), options).map_err(|e| TestCaseError::fail(e.to_string()))
}

/// The vertices of a mesh as an array.
pub(crate) fn array<F: Real>(points: &[[f32; 3]]) -> Array2<F> {
    Array2::from_shape_fn((points.len(), 3), |(i, k)| F::from_f64(f64::from(points[i][k])))
}

/// The value of a loss of one mesh.
pub(crate) fn value(mesh: &TriMesh, f: impl for<'t> Fn(Var<'t, f64>) -> Var<'t, f64>) -> f64 {
    let tape = Tape::<f64>::eval();
    f(tape.constant(array(&mesh.positions))).item()
}

/// The mesh turned about two axes, scaled and moved.
pub(crate) fn moved(mesh: &TriMesh, angles: [f32; 2], scale: f32, by: [f32; 3]) -> TriMesh {
    let (sa, ca) = angles[0].sin_cos();
    let (sb, cb) = angles[1].sin_cos();
    let place = |&[x, y, z]: &[f32; 3]| {
        let (x, y) = (ca * x - sa * y, sa * x + ca * y);
        let (y, z) = (cb * y - sb * z, sb * y + cb * z);
        [scale * x + by[0], scale * y + by[1], scale * z + by[2]]
    };
    TriMesh::new(mesh.positions.iter().map(place).collect(), mesh.faces.clone())
}

/// Random values of a shape from a range.
pub(crate) fn random(shape: &[usize], low: f64, high: f64, seed: u64) -> ArrayD<f64> {
    let drawn = Options { seed, ..Options::default() }.range(low, high).draw(&[shape.to_vec()]);
    drawn.into_iter().next().unwrap_or_else(|| ArrayD::zeros(IxDyn(shape)))
}

/// A regular grid of `n²` vertices on a plane that is askew to all axes.
pub(crate) fn tilted_plane() -> (usize, TriMesh) {
    let n = 17_usize;
    let place = |k: usize| {
        let (u, v) = ((k % n) as f32 * 0.11 - 0.7, (k / n) as f32 * 0.13 - 0.9);
        [0.91 * u - 0.17 * v + 0.3, 0.23 * u + 0.83 * v - 0.4, 0.31 * u - 0.57 * v + 1.1]
    };
    let mut faces = Vec::new();
    for k in (0..n * n - n).filter(|k| k % n + 1 < n) {
        let (a, below) = (k as u32, (k + n) as u32);
        faces.extend([[a, below, a + 1], [a + 1, below, below + 1]]);
    }
    (n, TriMesh::new((0..n * n).map(place).collect(), faces))
}

/// No vertex two steps from the border of such a grid is pulled.
pub(crate) fn assert_quiet(n: usize, gradient: &Tensor) {
    for k in 0..n * n {
        if (2..n - 2).contains(&(k % n)) && (2..n - 2).contains(&(k / n)) {
            let row = [0, 1, 2].map(|axis| gradient[[k, axis]]);
            assert_eq!(row, [0.0; 3], "vertex {k}");
        }
    }
    assert!(gradient.iter().any(|&g| g != 0.0), "the border is not a mean of its neighbours");
}
