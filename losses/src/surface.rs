//! Points on a surface that follow its vertices.
//!
//! mesh-core draws a surface point as a face and three weights; [`surface_points`] makes positions of them,
//! [`surface_normals`] the normals there.

use autodiff_lite::{Backward, Real, Var};
use mesh_core::SurfacePoint;

use crate::kernels::vec3::{accumulate, add, points, points_mut, scale};

/// The positions of points on the surface, following the vertices.
///
/// ```text
/// p = w_0 v_a + w_1 v_b + w_2 v_c
/// ```
///
/// # Shapes
/// `positions [V, 3]`, `faces` F of them or a `mesh_core::Topology`, `samples [P]` (from `mesh_core::sample_surface`) → `[P, 3]`.
/// # Gradient
/// To the vertices; the choice of faces and weights counts as fixed.
/// # Cost
/// `O(P)`.
/// # Panics
/// If the shape is another, or an index is out of range.
#[track_caller]
pub fn surface_points<'t, F: Real>(
    positions: Var<'t, F>,
    faces: &(impl AsRef<[[u32; 3]]> + ?Sized),
    samples: &[SurfacePoint],
) -> Var<'t, F> {
    let faces = faces.as_ref();
    let name = "surface_points";
    let tape = positions.tape();
    let shape = positions.shape();
    if shape.len() != 2 || shape[1] != 3 {
        tape.refuse(name, "one set of vertices expected", &[("positions", &shape, "V, 3")]);
    }
    let value = positions.value();
    let mesh = points(value.as_slice());
    let mut out = tape.array(&[samples.len(), 3]);
    let found = points_mut(out.as_slice_mut());
    let mut corners = tape.indices(3 * samples.len());
    let mut weights = tape.buffer(3 * samples.len());
    let kept = corners.as_chunks_mut::<3>().0.iter_mut().zip(points_mut(&mut weights));
    for ((found, sample), (corners, weights)) in found.iter_mut().zip(samples).zip(kept) {
        *corners = faces[sample.face as usize];
        *weights = sample.barycentric.map(|w| F::from_f64(f64::from(w)));
        let [a, b, c] = corners.map(|v| mesh[v as usize]);
        *found = add(scale(a, weights[0]), add(scale(b, weights[1]), scale(c, weights[2])));
    }
    tape.record_fn(name, &[positions], out, move |cx: &mut Backward<'_, F>| {
        let grad = cx.grad_out();
        let out = points_mut(cx.grad_slice_mut(0));
        let corners = corners.as_chunks::<3>().0.iter();
        for ((corners, weights), &g) in corners.zip(points(&weights)).zip(points(grad.as_slice())) {
            for (&v, &w) in corners.iter().zip(weights) {
                accumulate(&mut out[v as usize], scale(g, w));
            }
        }
    })
}

/// The unit normals of the surface at points on it: those of their faces, following the vertices.
///
/// With [`surface_points`] and [`chamfer_normals`](crate::chamfer_normals) the distance between the normals of
/// two sampled surfaces, as PyTorch3D samples them.
///
/// ```
/// use autodiff_lite::Tape;
/// use losses::{Directions, Matches, chamfer_distance, chamfer_normals, surface_normals, surface_points};
/// use mesh_core::{primitives::icosphere, sample_surface};
/// # use ndarray::Array2;
///
/// let (ball, finer) = (icosphere(2), icosphere(3));
/// let tape = Tape::<f32>::train(0);
/// let vertices = |mesh: &mesh_core::TriMesh| {
///     Array2::from_shape_fn((mesh.positions.len(), 3), |(v, k)| mesh.positions[v][k])
/// };
/// let (x, truth) = (tape.leaf(vertices(&ball)), tape.constant(vertices(&finer)));
/// let (own, other) = (sample_surface(&ball, 500, 1), sample_surface(&finer, 500, 2));
///
/// let points = surface_points(x, &ball.faces, &own);
/// let true_points = surface_points(truth, &finer.faces, &other);
/// let mut matches = Matches::default();
/// matches.find(points, true_points);
/// let normals = surface_normals(x, &ball.faces, &own);
/// let true_normals = surface_normals(truth, &finer.faces, &other);
/// let both = Directions::default();
/// let far = chamfer_distance(points, true_points, &matches, both);
/// let turned = chamfer_normals(normals, true_normals, &matches, both);
/// assert!(far.item() < 0.02 && turned.item() < 0.1);
/// assert!(far.add(turned).backward().wrt(x).is_some());
/// ```
///
/// # Shapes
/// `positions [V, 3]`, `faces` F of them or a `mesh_core::Topology`, `samples [P]` → `[P, 3]`.
/// # Gradient
/// To the vertices of the faces that are drawn; the choice of faces counts as fixed. A face of (nearly) no area
/// has a normal shorter than one, and no gradient; it is never drawn.
/// # Cost
/// `O(P)`; backward computes the normals again.
/// # Panics
/// If the shape is another, or an index is out of range.
#[track_caller]
pub fn surface_normals<'t, F: Real>(
    positions: Var<'t, F>,
    faces: &(impl AsRef<[[u32; 3]]> + ?Sized),
    samples: &[SurfacePoint],
) -> Var<'t, F> {
    let faces = faces.as_ref();
    let tape = positions.tape();
    let mut drawn = tape.indices(3 * samples.len());
    let corners = drawn.as_chunks_mut::<3>().0;
    for (corners, sample) in corners.iter_mut().zip(samples) {
        *corners = faces[sample.face as usize];
    }
    crate::face_normals(positions, drawn.as_chunks::<3>().0)
}

#[cfg(test)]
mod tests {
    use autodiff_lite::Tape;
    use mesh_core::primitives;
    use proptest::prelude::*;

    use super::*;
    use crate::testing;

    proptest! {
        #[test]
        fn gradients((v, faces) in testing::soup(), at in proptest::collection::vec((0usize..10, 0.0f32..1.0, 0.0f32..1.0), 0..6), seed: u64) {
            let samples: Vec<SurfacePoint> = at
                .into_iter()
                .map(|(f, a, b)| SurfacePoint {
                    face: (f % faces.len()) as u32,
                    barycentric: [1.0 - a, a * (1.0 - b), a * b],
                })
                .collect();
            testing::checked(&|x: &[Var<'_, f64>]| surface_points(x[0], &faces, &samples), &[vec![v, 3]], &testing::options(seed))?;
            // Slivers make differences inexact, not the rule.
            let options = testing::options(seed).tolerance(1e-4);
            testing::checked(&|x: &[Var<'_, f64>]| surface_normals(x[0], &faces, &samples), &[vec![v, 3]], &options)?;
        }
    }

    /// Each point has its face's normal, whatever the order and however often a face is drawn.
    #[test]
    fn normals_are_those_of_the_faces() {
        let torus = primitives::torus(1.0, 0.3, 12, 8);
        let plain = mesh_core::face_normals(&torus.positions, &torus.faces);
        let samples = mesh_core::sample_surface(&torus, 400, 3);
        let tape = Tape::<f32>::eval();
        let x = tape.constant(testing::array::<f32>(&torus.positions));
        let found = surface_normals(x, &torus.faces, &samples).value();
        assert_eq!(found.shape(), [400, 3]);
        for (row, sample) in found.outer_iter().zip(&samples) {
            for (a, b) in row.iter().zip(plain[sample.face as usize]) {
                assert!((a - b).abs() < 1e-6);
            }
        }
        assert_eq!(surface_normals(x, &torus.faces, &[]).shape(), [0, 3]);
    }

    #[test]
    fn the_plain_twin() {
        let torus = primitives::torus(1.0, 0.3, 12, 8);
        let samples = mesh_core::sample_surface(&torus, 50, 3);
        let tape = Tape::<f32>::eval();
        let x = tape.constant(testing::array::<f32>(&torus.positions));
        let found = surface_points(x, &torus.faces, &samples).value();
        for (row, sample) in found.outer_iter().zip(&samples) {
            for (a, b) in row.iter().zip(sample.position(&torus)) {
                assert!((a - b).abs() < 1e-6);
            }
        }
    }
}
