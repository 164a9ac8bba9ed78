//! Differentiable geometry: normals of faces and vertices.
//!
//! The plain twins, over meshes without a tape, are in mesh-core.

use autodiff_lite::{Backward, Real, Var};

use crate::kernels::vec3::{
    accumulate, add, area_vector, area_vector_grad, points, points_mut, unit, unit_grad,
};
use crate::scalar::vertices;

/// The unit normals of the faces, along `(b - a) × (c - a)`.
///
/// # Shapes
/// `positions [V, 3]` or `[N, V, 3]`, `faces` F of them or a `mesh_core::Topology` → `[F, 3]` or `[N, F, 3]`.
/// # Gradient
/// A face of (nearly) no area has a normal shorter than one, and no gradient.
/// # Cost
/// `O(N F)`; backward computes the normals again.
/// # Panics
/// If the shape is another, or a face names a vertex that does not exist.
#[track_caller]
pub fn face_normals<'t, F: Real>(
    positions: Var<'t, F>,
    faces: &(impl AsRef<[[u32; 3]]> + ?Sized),
) -> Var<'t, F> {
    normals("face_normals", positions, faces.as_ref(), Site::Face)
}

/// The unit normals of the vertices: the mean of the faces around, weighted by their area.
///
/// # Shapes
/// `positions [V, 3]` or `[N, V, 3]`, `faces` or a `mesh_core::Topology` → the shape of `positions`. A vertex without faces gets
/// zero.
/// # Gradient
/// Finite also where the faces around cancel.
/// # Cost
/// `O(N (V + F))`; backward computes the sums again.
/// # Panics
/// If the shape is another, or a face names a vertex that does not exist.
#[track_caller]
pub fn vertex_normals<'t, F: Real>(
    positions: Var<'t, F>,
    faces: &(impl AsRef<[[u32; 3]]> + ?Sized),
) -> Var<'t, F> {
    normals("vertex_normals", positions, faces.as_ref(), Site::Vertex)
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Site {
    Face,
    Vertex,
}

#[track_caller]
fn normals<'t, F: Real>(
    name: &'static str,
    positions: Var<'t, F>,
    faces: &[[u32; 3]],
    site: Site,
) -> Var<'t, F> {
    let [_, v] = vertices(name, "positions", positions);
    let tape = positions.tape();
    let mut shape = positions.shape();
    if site == Site::Face {
        let axis = shape.len() - 2;
        shape[axis] = faces.len();
    }
    let count = shape[shape.len() - 2];
    let value = positions.value();
    let mut normals = tape.array(&shape);
    let out = points_mut(normals.as_slice_mut());
    if count > 0 {
        let meshes = points(value.as_slice()).chunks(v.max(1));
        for (mesh, out) in meshes.zip(out.chunks_mut(count)) {
            sums(mesh, faces, site, out);
            for normal in out {
                (*normal, _) = unit(*normal);
            }
        }
    }
    let mut kept = tape.indices(3 * faces.len());
    kept.copy_from_slice(faces.as_flattened());
    tape.record_fn(name, &[positions], normals, move |cx: &mut Backward<'_, F>| {
        let faces = kept.as_chunks::<3>().0;
        let count = if site == Site::Face { faces.len() } else { v };
        if count == 0 || v == 0 {
            return;
        }
        let (positions, grad) = (cx.input(0), cx.grad_out());
        let meshes = points(positions.as_slice()).chunks(v);
        let grads = points(grad.as_slice()).chunks(count);
        let mut pulls = cx.scratch(3 * count);
        let pulls = points_mut(&mut pulls);
        for (k, (mesh, grads)) in meshes.zip(grads).enumerate() {
            sums(mesh, faces, site, pulls);
            for (pull, &g) in pulls.iter_mut().zip(grads) {
                let (normal, inverse) = unit(*pull);
                *pull = unit_grad(normal, inverse, g);
            }
            let out = &mut points_mut(cx.grad_slice_mut(0))[k * v..(k + 1) * v];
            for (f, &face) in faces.iter().enumerate() {
                let pull = match site {
                    Site::Face => pulls[f],
                    Site::Vertex => {
                        let [a, b, c] = face.map(|v| pulls[v as usize]);
                        add(a, add(b, c))
                    }
                };
                area_vector_grad(mesh, face, pull, out);
            }
        }
    })
}

/// The area vectors of the faces, or their sums around the vertices.
fn sums<F: Real>(mesh: &[[F; 3]], faces: &[[u32; 3]], site: Site, out: &mut [[F; 3]]) {
    match site {
        Site::Face => {
            for (out, &face) in out.iter_mut().zip(faces) {
                *out = area_vector(mesh, face);
            }
        }
        Site::Vertex => {
            out.fill([F::zero(); 3]);
            for &face in faces {
                let area = area_vector(mesh, face);
                for corner in face {
                    accumulate(&mut out[corner as usize], area);
                }
            }
        }
    }
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
        fn gradients((v, faces) in testing::soup(), batch in proptest::option::of(1usize..3), seed: u64) {
            let shapes = [testing::shape(batch, v)];
            // Slivers and cancelling faces make differences inexact, not the rule.
            let options = testing::options(seed).tolerance(1e-4);
            testing::checked(&|x: &[Var<'_, f64>]| face_normals(x[0], &faces), &shapes, &options)?;
            testing::checked(&|x: &[Var<'_, f64>]| vertex_normals(x[0], &faces), &shapes, &options)?;
        }
    }

    #[test]
    fn the_plain_twins() {
        let torus = primitives::torus(1.0, 0.3, 12, 8);
        let tape = Tape::<f64>::eval();
        let x = tape.constant(testing::array(&torus.positions));
        let near = |ours: Var<'_, f64>, plain: &[[f32; 3]]| {
            let ours = ours.value();
            assert_eq!(ours.shape(), [plain.len(), 3]);
            ours.iter().zip(plain.as_flattened()).for_each(|(&a, &b)| {
                assert!((a - f64::from(b)).abs() < 1e-6, "{a} {b}");
            });
        };
        near(
            face_normals(x, &torus.faces),
            &mesh_core::face_normals(&torus.positions, &torus.faces),
        );
        near(
            vertex_normals(x, &torus.faces),
            &mesh_core::vertex_normals(&torus.positions, &torus.faces),
        );
    }
}
