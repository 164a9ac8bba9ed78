//! Face angle and normal consistency: neighbouring faces should lie flat.

use autodiff_lite::{PoolVec, Real, Var};
use mesh_core::Topology;

use crate::kernels::vec3::{
    accumulate, add, area_vector, area_vector_grad, cross, dot, points, points_mut, scale, sub,
    unit, unit_grad,
};
use crate::scalar::{record, vertices, wanted};

/// The face-angle ("flat") loss of img2mesh: squared departure from flatness, summed over edges.
///
/// ```text
/// (1/N) Σ_n Σ_e (n_f · n_g - 1)²         f, g the two faces on edge e, n their unit normals
/// ```
///
/// Rotating the mesh changes nothing, so camera-space and world-space normals give the same figure; one
/// mesh seen in N views is one mesh here. It is quartic in small angles: it leaves gentle curvature alone
/// and pulls folds open. Its weight in img2mesh is 1e-3 at 1,920 edges.
///
/// # Shapes
/// `positions [V, 3]` or `[N, V, 3]`, and the mesh's topology (edges without exactly two faces are skipped) →
/// a scalar.
/// # Gradient
/// Exact; a face of no area has a zero normal and pulls at nothing.
/// # Cost
/// `O(N (E + F))`; the gradient is made in the same pass.
/// # Panics
/// If the shape is another, or an index is out of range.
/// # References
/// img2mesh (`flat` loss) after the DIB-R tutorial of kaolin.
#[track_caller]
pub fn face_angle<'t, F: Real>(positions: Var<'t, F>, topology: &Topology) -> Var<'t, F> {
    let Topology { faces, edge_faces, .. } = topology;
    let name = "face_angle";
    let [n, v] = vertices(name, "positions", positions);
    let tape = positions.tape();
    let value = positions.value();
    let value = value.as_slice();
    let mut gradient = wanted(positions);
    let weight = F::from_f64(1.0 / n.max(1) as f64);
    let two = F::one() + F::one();

    let mut normals = tape.buffer(3 * faces.len());
    let mut inverses = tape.buffer(faces.len());
    let mut pulls: Option<PoolVec<F>> = gradient.as_ref().map(|_| tape.buffer(3 * faces.len()));
    let mut total = 0.0;
    for (k, mesh) in points(value).chunks(v.max(1)).enumerate() {
        let normals = points_mut(&mut normals);
        for ((normal, inverse), &face) in normals.iter_mut().zip(inverses.iter_mut()).zip(faces) {
            (*normal, *inverse) = unit(area_vector(mesh, face));
        }
        let pulls = pulls.as_mut().map(|p| {
            p.fill(F::zero());
            points_mut(p)
        });
        let pairs = edge_faces
            .iter()
            .filter(|pair| !pair.contains(&Topology::NONE))
            .map(|pair| pair.map(|f| f as usize));
        let Some((pulls, gradient)) = pulls.zip(gradient.as_mut()) else {
            for [f, g] in pairs {
                let away = dot(normals[f], normals[g]) - F::one();
                total += Real::to_f64(away * away);
            }
            continue;
        };
        for [f, g] in pairs {
            let away = dot(normals[f], normals[g]) - F::one();
            total += Real::to_f64(away * away);
            let derivative = two * away * weight;
            accumulate(&mut pulls[f], scale(normals[g], derivative));
            accumulate(&mut pulls[g], scale(normals[f], derivative));
        }
        let out = &mut points_mut(gradient)[k * v..(k + 1) * v];
        for (f, &face) in faces.iter().enumerate() {
            let g = unit_grad(normals[f], inverses[f], pulls[f]);
            area_vector_grad(mesh, face, g, out);
        }
    }
    record(name, [positions], total / n.max(1) as f64, [gradient])
}

/// Normal consistency: the mean of one minus the cosine of the angle between neighbouring faces.
///
/// ```text
/// (1/N) Σ_n (1/P) Σ_pairs (1 - cos(n_a, -n_b)),     n_o = (v1 - v0) × (o - v0)
/// ```
///
/// with `(v0, v1)` the edge of a pair and `a`, `b` the corners opposite to it. The winding of the faces
/// does not matter: it is 0 where two faces are coplanar and unfolded, 2 where one lies on the other.
///
/// # Shapes
/// `positions [V, 3]` or `[N, V, 3]`, and the mesh's topology, whose
/// [`face_pairs`](mesh_core::Topology::face_pairs) these are → a scalar, 0 when there are no pairs.
/// # Cost
/// `O(N P)`; the gradient is made in the same pass.
/// # Panics
/// If the shape is another, or an index is out of range.
/// # References
/// `mesh_normal_consistency` of PyTorch3D.
#[track_caller]
pub fn normal_consistency<'t, F: Real>(positions: Var<'t, F>, topology: &Topology) -> Var<'t, F> {
    let name = "normal_consistency";
    let [n, v] = vertices(name, "positions", positions);
    let value = positions.value();
    let value = value.as_slice();
    let mut gradient = wanted(positions);
    let mut pairs = 0_usize;
    topology.each_face_pair(|_| pairs += 1);
    let count = (n.max(1) * pairs.max(1)) as f64;
    let weight = F::from_f64(1.0 / count);
    let mut total = 0.0;
    for (k, mesh) in points(value).chunks(v.max(1)).enumerate() {
        let mut out = gradient.as_mut().map(|g| &mut points_mut(g)[k * v..(k + 1) * v]);
        topology.each_face_pair(|pair| {
            let [v0, v1] = topology.edges[pair.edge as usize].map(|v| v as usize);
            let [a, b] = pair.opposite.map(|v| v as usize);
            let edge = sub(mesh[v1], mesh[v0]);
            let (to_a, to_b) = (sub(mesh[a], mesh[v0]), sub(mesh[b], mesh[v0]));
            let (unit_a, inverse_a) = unit(cross(edge, to_a));
            let (unit_b, inverse_b) = unit(cross(edge, to_b));
            total += 1.0 + Real::to_f64(dot(unit_a, unit_b));
            if let Some(out) = &mut out {
                // d(1 - cos) = d(u_a · u_b), through the lengths and then the two cross products.
                let at_a = scale(unit_grad(unit_a, inverse_a, unit_b), weight);
                let at_b = scale(unit_grad(unit_b, inverse_b, unit_a), weight);
                let on_edge = add(cross(to_a, at_a), cross(to_b, at_b));
                let (on_a, on_b) = (cross(at_a, edge), cross(at_b, edge));
                accumulate(&mut out[v1], on_edge);
                accumulate(&mut out[a], on_a);
                accumulate(&mut out[b], on_b);
                out[v0] = sub(out[v0], add(on_edge, add(on_a, on_b)));
            }
        });
    }
    record(name, [positions], total / count, [gradient])
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use mesh_core::{TriMesh, primitives};
    use proptest::prelude::*;

    use super::*;
    use crate::testing;

    /// Two triangles on one edge, with an angle between them: 0 is flat, π folded shut.
    fn hinge(angle: f32) -> (TriMesh, Topology) {
        let (s, c) = angle.sin_cos();
        let positions = vec![[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.3, 0.0], [c, 0.6, s]];
        let mesh = TriMesh::new(positions, vec![[0, 1, 2], [1, 0, 3]]);
        let topology = Topology::new(4, &mesh.faces);
        (mesh, topology)
    }

    /// Of two faces on an edge one has two corners at one place.
    #[test]
    fn a_face_of_no_area_pulls_at_nothing() {
        let (mut mesh, topology) = hinge(0.3);
        mesh.positions[2] = mesh.positions[0];
        let tape = autodiff_lite::Tape::<f64>::train(0);
        let x = tape.leaf(testing::array::<f64>(&mesh.positions));
        let gradients = face_angle(x, &topology).backward();
        let largest = gradients.wrt(x).map(|g| g.iter().fold(0.0, |m: f64, g| m.max(g.abs())));
        assert!(largest.is_none_or(|g| g < 1e-9), "{largest:?}");
    }

    fn both(mesh: &TriMesh, topology: &Topology) -> [f64; 2] {
        [
            testing::value(mesh, |x| face_angle(x, topology)),
            testing::value(mesh, |x| normal_consistency(x, topology)),
        ]
    }

    proptest! {
        #[test]
        fn gradients((v, faces) in testing::soup(), batch in proptest::option::of(1usize..3), seed: u64) {
            let topology = Topology::new(v, &faces);
            let shapes = [testing::shape(batch, v)];
            // A sliver among random triangles makes differences inexact, not the rule.
            let options = testing::options(seed).tolerance(1e-4);
            testing::checked(&|x: &[Var<'_, f64>]| face_angle(x[0], &topology), &shapes, &options)?;
            testing::checked(&|x: &[Var<'_, f64>]| normal_consistency(x[0], &topology), &shapes, &options)?;
        }

        #[test]
        fn a_hinge_by_hand(angle in 0.0f32..3.1) {
            let (mesh, topology) = hinge(angle);
            let cosine = f64::from(angle).cos();
            let [flat, consistent] = both(&mesh, &topology);
            prop_assert!((flat - (cosine - 1.0).powi(2)).abs() < 1e-6);
            prop_assert!((consistent - (1.0 - cosine)).abs() < 1e-6);
        }

        #[test]
        fn place_and_size_do_not_matter(a in -3.0f32..3.0, b in -3.0f32..3.0, s in 0.1f32..10.0) {
            let torus = primitives::torus(1.0, 0.4, 8, 6);
            let topology = Topology::new(torus.positions.len(), &torus.faces);
            let other = testing::moved(&torus, [a, b], s, [0.3, -0.2, 0.9]);
            for (x, y) in both(&torus, &topology).into_iter().zip(both(&other, &topology)) {
                prop_assert!((x - y).abs() < 1e-3 * x, "{} {}", x, y);
            }
        }
    }

    #[test]
    fn a_cube_by_hand() {
        // Twelve edges of a right angle, six diagonals across flat sides.
        let cube = primitives::cuboid([1.0, 2.0, 3.0]);
        let topology = Topology::new(cube.positions.len(), &cube.faces);
        let [flat, consistent] = both(&cube, &topology);
        assert_relative_eq!(flat, 12.0, epsilon = 1e-9);
        assert_relative_eq!(consistent, 12.0 / 18.0, epsilon = 1e-9);
    }

    #[test]
    fn consistency_does_not_see_the_winding() {
        let (mut mesh, _) = hinge(0.7);
        mesh.faces[1].swap(0, 1);
        let topology = Topology::new(4, &mesh.faces);
        assert_relative_eq!(both(&mesh, &topology)[1], 1.0 - 0.7f64.cos(), epsilon = 1e-6);
    }

    #[test]
    fn vanished_faces_keep_gradients_finite() {
        let (_, topology) = hinge(0.0);
        let tape = autodiff_lite::Tape::<f32>::train(0);
        let x = tape.leaf(ndarray::Array2::zeros((4, 3)));
        let loss = face_angle(x, &topology).add(normal_consistency(x, &topology));
        assert!(loss.item().is_finite());
        assert!(loss.backward().is_finite());
    }
}
