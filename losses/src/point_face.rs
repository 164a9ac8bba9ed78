//! Distances between points and the faces of a mesh.

use autodiff_lite::kernels::parallel::{InParts, Parts};
use autodiff_lite::{Backward, Real, Var};
use mesh_core::ClosestPoint;
use mesh_core::vector::Vec3;

use crate::kernels::point_tree::{PointTree, offset_to_triangle};
use crate::kernels::vec3::{accumulate, points, points_mut, scale};

/// The face nearest to each point: of equally near ones the lowest, `u32::MAX` where there is none (no face, or a
/// coordinate that is not finite).
///
/// # Shapes
/// `x [P, 3]`, `positions [V, 3]` → P.
/// # Cost
/// A tree of boxes around the faces, `O(F log F)`, and about `O(log F)` for each point, in double precision, in parallel.
/// # Panics
/// If a shape is another, or a face names a vertex that does not exist.
#[track_caller]
pub fn nearest_faces<F: Real>(
    x: Var<'_, F>,
    positions: Var<'_, F>,
    faces: &(impl AsRef<[[u32; 3]]> + ?Sized),
) -> Vec<u32> {
    let [from, mesh] = operands("nearest_faces", x, positions, faces.as_ref());
    let tree = ClosestPoint::of(&mesh, faces.as_ref());
    let find = |&p: &Vec3| tree.find_wide(p).map_or(u32::MAX, |found| found.point.face);
    let mut faces = vec![u32::MAX; from.len()];
    let points = faces.par_iter_mut().zip(from.par_iter()).with_min_len(64);
    points.for_each(|(face, p)| *face = find(p));
    faces
}

/// The point nearest to each face: of equally near ones the lowest, `u32::MAX` where there is none.
///
/// # Shapes
/// `x [P, 3]`, `positions [V, 3]`, F faces → F.
/// # Cost
/// A tree of boxes around the points, and about `O(log P)` for each face that is small beside the distances between
/// points, in double precision, in parallel.
/// # Panics
/// As [`nearest_faces`].
#[track_caller]
pub fn nearest_points<F: Real>(
    x: Var<'_, F>,
    positions: Var<'_, F>,
    faces: &(impl AsRef<[[u32; 3]]> + ?Sized),
) -> Vec<u32> {
    let [from, mesh] = operands("nearest_points", x, positions, faces.as_ref());
    let tree = PointTree::new(from);
    let find =
        |face: &[u32; 3]| tree.closest_to(face.map(|v| mesh[v as usize])).unwrap_or(u32::MAX);
    let faces = faces.as_ref();
    let mut points = vec![u32::MAX; faces.len()];
    let each = points.par_iter_mut().zip(faces.par_iter()).with_min_len(64);
    each.for_each(|(point, face)| *point = find(face));
    points
}

/// The **squared** distance from each point to the nearest face.
///
/// ```
/// use autodiff_lite::Tape;
/// use losses::point_face_distance;
/// use mesh_core::primitives;
///
/// let cube = primitives::cuboid([2.0; 3]);
/// let tape = Tape::<f64>::train(0);
/// let x = tape.leaf(ndarray::arr2(&[[0.3, 0.2, 4.0]]));
/// let vertices = tape.leaf(cube.vertices());
/// let squared = point_face_distance(x, vertices, &cube.faces);
/// assert_eq!(squared.value().as_slice(), [9.0]);
/// let gradients = squared.sum().backward();
/// let found = gradients.wrt(x).unwrap();
/// assert!(found.iter().zip([0.0, 0.0, 6.0]).all(|(a, b)| (a - b).abs() < 1e-12));
/// ```
///
/// # Shapes
/// `x [P, 3]`, `positions [V, 3]`, `faces` F of them or a `mesh_core::Topology` → `[P]`. Several meshes are several calls.
/// # Gradient
/// To the points, and to the corners of the nearest faces by the weights of the closest point on them; exact but where
/// two faces are equally near.
/// # Cost
/// That of [`nearest_faces`]; its tree is fresh memory in each call.
/// # Panics
/// If a shape is another, there are points and no face, or a face names a vertex that does not exist.
/// # References
/// `point_face_distance` of PyTorch3D, which takes faces of an area below `min_triangle_area` (5e-3) for their edges alone;
/// `point_to_mesh_distance` of kaolin.
#[track_caller]
pub fn point_face_distance<'t, F: Real>(
    x: Var<'t, F>,
    positions: Var<'t, F>,
    faces: &(impl AsRef<[[u32; 3]]> + ?Sized),
) -> Var<'t, F> {
    let faces = faces.as_ref();
    let nearest = nearest_faces(x, positions, faces);
    let pairs = nearest.iter().enumerate().map(|(point, &face)| (point as u32, face));
    between("point_face_distance", x, positions, faces, pairs)
}

/// The **squared** distance from each face to the nearest point.
///
/// # Shapes
/// `x [P, 3]`, `positions [V, 3]`, F faces → `[F]`.
/// # Gradient, cost, panics
/// As [`point_face_distance`], with points and faces exchanged.
/// # References
/// `face_point_distance` of PyTorch3D.
#[track_caller]
pub fn face_point_distance<'t, F: Real>(
    x: Var<'t, F>,
    positions: Var<'t, F>,
    faces: &(impl AsRef<[[u32; 3]]> + ?Sized),
) -> Var<'t, F> {
    let faces = faces.as_ref();
    let nearest = nearest_points(x, positions, faces);
    let pairs = nearest.iter().enumerate().map(|(face, &point)| (point, face as u32));
    between("face_point_distance", x, positions, faces, pairs)
}

/// The mean of [`point_face_distance`] plus the mean of [`face_point_distance`]: how far points and a surface are
/// from each other, squared.
///
/// # Shapes
/// `x [P, 3]`, `positions [V, 3]`, F faces → a scalar.
/// # Gradient, cost, panics
/// As those two.
/// # References
/// `point_mesh_face_distance` of PyTorch3D, of one mesh and one cloud; of a batch it is the mean.
#[track_caller]
pub fn point_mesh_face_distance<'t, F: Real>(
    x: Var<'t, F>,
    positions: Var<'t, F>,
    faces: &(impl AsRef<[[u32; 3]]> + ?Sized),
) -> Var<'t, F> {
    let to_faces = point_face_distance(x, positions, faces).mean();
    to_faces.add(face_point_distance(x, positions, faces).mean())
}

/// Both sets in double precision.
#[track_caller]
fn operands<F: Real>(
    op: &'static str,
    x: Var<'_, F>,
    positions: Var<'_, F>,
    faces: &[[u32; 3]],
) -> [Vec<Vec3>; 2] {
    let tape = x.tape();
    let [_, v] = tape.check(op, |shapes| {
        let [_, d] = shapes.axes("x", &x.shape(), ["P", "3"])?;
        let [v, e] = shapes.axes("positions", &positions.shape(), ["V", "3"])?;
        if [d, e] == [3, 3] { Ok([d, v]) } else { Err(shapes.error("three coordinates expected")) }
    });
    if let Some(face) = faces.iter().flatten().find(|&&corner| corner as usize >= v) {
        let message = format!("a face names vertex {face} of {v}");
        tape.refuse(op, message, &[("positions", &positions.shape(), "V, 3")]);
    }
    [x, positions]
        .map(|var| points(var.value().as_slice()).iter().map(|p| p.map(Real::to_f64)).collect())
}

/// The squared distance of each pair of a point and a face.
#[track_caller]
fn between<'t, F: Real>(
    name: &'static str,
    x: Var<'t, F>,
    positions: Var<'t, F>,
    faces: &[[u32; 3]],
    pairs: impl ExactSizeIterator<Item = (u32, u32)>,
) -> Var<'t, F> {
    let tape = x.tape();
    if pairs.len() > 0 && (faces.is_empty() || x.is_empty()) {
        let message =
            format!("{} faces and {} points: there is no distance", faces.len(), x.shape()[0]);
        tape.refuse(name, message, &[("x", &x.shape(), "P, 3")]);
    }
    let count = pairs.len();
    let (from, mesh) = (x.value(), positions.value());
    let wide = |p: [F; 3]| p.map(Real::to_f64);
    let mut out = tape.array(&[count]);
    // For each pair: the point and the corners, the offset from the surface, the weights of the corners.
    let mut places = tape.indices(4 * count);
    let mut offsets = tape.buffer(3 * count);
    let mut weights = tape.buffer(3 * count);
    let kept = places.as_chunks_mut::<4>().0.iter_mut();
    let kept = kept.zip(points_mut(&mut offsets).iter_mut().zip(points_mut(&mut weights)));
    for ((out, (place, (offset, weight))), (point, face)) in
        out.as_slice_mut().iter_mut().zip(kept).zip(pairs)
    {
        if point == u32::MAX || face == u32::MAX {
            // What is not a number stays visible, and pulls at nothing.
            *out = F::nan();
            (*place, *offset, *weight) = ([0; 4], [F::zero(); 3], [F::zero(); 3]);
            continue;
        }
        let [a, b, c] = faces[face as usize];
        let p = wide(points(from.as_slice())[point as usize]);
        let corners = [a, b, c].map(|v| wide(points(mesh.as_slice())[v as usize]));
        let (on_face, away, squared) = offset_to_triangle(corners, p);
        *out = F::from_f64(squared);
        (*place, *offset, *weight) =
            ([point, a, b, c], away.map(F::from_f64), on_face.map(F::from_f64));
    }
    tape.record_fn(name, &[x, positions], out, move |cx: &mut Backward<'_, F>| {
        let grad = cx.grad_out();
        let two = F::one() + F::one();
        let places = places.as_chunks::<4>().0;
        for side in 0..2 {
            if !cx.needs(side) {
                continue;
            }
            let out = points_mut(cx.grad_slice_mut(side));
            let pairs = places.iter().zip(points(&offsets)).zip(points(&weights));
            for ((&[point, corners @ ..], (&offset, &weight)), &g) in pairs
                .map(|((place, offset), weight)| (place, (offset, weight)))
                .zip(grad.as_slice())
            {
                if side == 0 {
                    accumulate(&mut out[point as usize], scale(offset, two * g));
                } else {
                    for (&corner, w) in corners.iter().zip(weight) {
                        accumulate(&mut out[corner as usize], scale(offset, -(two * g * w)));
                    }
                }
            }
        }
    })
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use autodiff_lite::Tape;
    use mesh_core::{Topology, primitives, sample_surface};
    use proptest::prelude::*;

    use super::*;
    use crate::testing;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn gradients((v, faces) in testing::soup(), p in 1usize..9, seed: u64) {
            let shapes = [vec![p, 3], vec![v, 3]];
            let options = testing::options(seed).tolerance(1e-5);
            testing::checked(&|x: &[Var<'_, f64>]| point_face_distance(x[0], x[1], &faces), &shapes, &options)?;
            testing::checked(&|x: &[Var<'_, f64>]| face_point_distance(x[0], x[1], &faces), &shapes, &options)?;
            testing::checked(&|x: &[Var<'_, f64>]| point_mesh_face_distance(x[0], x[1], &faces), &shapes, &options)?;
        }

        #[test]
        fn no_pair_is_nearer((v, faces) in testing::soup(), p in 1usize..12, seed: u64) {
            let tape = Tape::<f64>::eval();
            let x = testing::random(&[p, 3], -1.5, 1.5, seed);
            let positions = testing::random(&[v, 3], -1.0, 1.0, seed ^ 5);
            let all: Vec<Vec<f64>> = (0..p).map(|i| faces.iter().map(|face| {
                let at = |a: &ndarray::ArrayD<f64>, i: usize| [0, 1, 2].map(|k| a[[i, k]]);
                offset_to_triangle(face.map(|v| at(&positions, v as usize)), at(&x, i)).2
            }).collect()).collect();
            let (x, positions) = (tape.constant(x), tape.constant(positions));
            let rows = point_face_distance(x, positions, &faces).value();
            let columns = face_point_distance(x, positions, &faces).value();
            for i in 0..p {
                let least = all[i].iter().copied().fold(f64::INFINITY, f64::min);
                prop_assert!((rows[i] - least).abs() < 1e-12);
            }
            for f in 0..faces.len() {
                let least = all.iter().map(|row| row[f]).fold(f64::INFINITY, f64::min);
                prop_assert!((columns[f] - least).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn points_on_a_surface_are_on_it() {
        let torus = primitives::torus(1.0, 0.3, 24, 16);
        let samples = sample_surface(&torus, 400, 3);
        let on: Vec<[f32; 3]> = samples.iter().map(|s| s.position(&torus)).collect();
        let tape = Tape::<f64>::train(0);
        let (x, mesh) = (tape.leaf(testing::array(&on)), tape.leaf(torus.vertices::<f64>()));
        let topology = Topology::of(&torus);
        let there = point_face_distance(x, mesh, &topology);
        assert!(there.value().iter().all(|&d| d < 1e-12));
        // Moved along z by a quarter; the mean of squares is at most that, and moving back is downhill.
        let moved = x.add(tape.constant(ndarray::arr1(&[0.0, 0.0, 0.25])));
        let loss = point_mesh_face_distance(moved, mesh, &topology);
        let gradients = loss.backward();
        assert!(loss.item() > 0.01 && loss.item() < 0.2);
        let along: f64 = gradients.wrt(x).expect("a leaf").outer_iter().map(|g| g[2]).sum();
        let back: f64 = gradients.wrt(mesh).expect("a leaf").outer_iter().map(|g| g[2]).sum();
        assert!(along > 0.0);
        assert_relative_eq!(along, -back, epsilon = 1e-12);
    }

    #[test]
    fn what_is_not_a_number_stays_visible_and_no_face_is_refused() {
        let tape = Tape::<f32>::train(0);
        let x = tape.leaf(ndarray::arr2(&[[f32::NAN, 0.0, 0.0], [0.0, 0.0, 2.0]]));
        let mesh =
            tape.constant(ndarray::arr2(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]));
        let found = point_face_distance(x, mesh, &[[0, 1, 2]]);
        assert!(found.value()[0].is_nan());
        assert_eq!(found.value()[1], 4.0);
        assert!(found.sum().backward().is_finite());
        let refused = std::panic::catch_unwind(|| {
            let tape = Tape::<f32>::eval();
            let x = tape.constant(ndarray::Array2::zeros((2, 3)));
            let none: [[u32; 3]; 0] = [];
            point_face_distance(x, x, &none).len()
        });
        assert!(refused.is_err());
    }
}
