//! Random points on the surface of a mesh.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::TriMesh;
use crate::vector::{add, area_vector, interpolate, narrow, norm, scale, triangle};

/// A point on a face, as weights of its three corners.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SurfacePoint {
    /// The face.
    pub face: u32,
    /// Weights of its corners, not negative, of sum 1.
    pub barycentric: [f32; 3],
}

impl SurfacePoint {
    /// Where the point is.
    ///
    /// # Panics
    /// If the mesh has no such face.
    pub fn position(&self, mesh: &TriMesh) -> [f32; 3] {
        self.interpolate(mesh, &mesh.positions)
    }

    /// The mean of a per-vertex value over the face's corners, by their weights.
    ///
    /// # Panics
    /// If the mesh has no such face, or `values` are fewer than its vertices.
    pub fn interpolate<const K: usize>(&self, mesh: &TriMesh, values: &[[f32; K]]) -> [f32; K] {
        let corners = mesh.faces[self.face as usize].map(|v| values[v as usize]);
        interpolate(self.barycentric, &corners)
    }
}

/// Draws `count` points, uniform over the surface; the same points for the same seed.
///
/// A face is drawn in proportion to its area and a point on it as
/// `(1 - √u, √u (1 - v), √u v)` with `u, v` uniform in `[0, 1)`, the definition of PyTorch3D
/// (the sequence of random numbers is our own: ChaCha8 of the seed).
/// Returns nothing for a mesh without area.
///
/// ```
/// use mesh_core::{primitives, sample_surface};
/// let cube = primitives::cuboid([1.0; 3]);
/// for point in sample_surface(&cube, 100, 7) {
///     let p = point.position(&cube);
///     assert!(p.iter().any(|x| (x.abs() - 0.5).abs() < 1e-6));
/// }
/// ```
///
/// # Cost
/// `O(F + count log F)`.
/// # Panics
/// If a face names a vertex that does not exist.
pub fn sample_surface(mesh: &TriMesh, count: usize, seed: u64) -> Vec<SurfacePoint> {
    let mut total = 0.0_f64;
    let ends: Vec<f64> = mesh
        .faces
        .iter()
        .map(|&face| {
            let area = norm(area_vector(triangle(&mesh.positions, face)));
            total += if area.is_finite() { area } else { 0.0 };
            total
        })
        .collect();
    if !(total > 0.0 && total.is_finite()) {
        return Vec::new();
    }
    let last = ends.partition_point(|&end| end < total);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..count)
        .map(|_| {
            let target = rng.random::<f64>() * total;
            // The first face whose end lies beyond the target: it has area, and it exists unless
            // the product was rounded up to the total itself.
            let face = ends.partition_point(|&end| end <= target);
            let (root, v) = (rng.random::<f64>().sqrt(), rng.random::<f64>());
            SurfacePoint {
                face: face.min(last) as u32,
                barycentric: narrow([1.0 - root, root * (1.0 - v), root * v]),
            }
        })
        .collect()
}

/// `count` points of the surface with the unit normals of their faces, `([P, 3], [P, 3])`.
///
/// What most metrics want; the same points as [`sample_surface`] draws.
pub fn sample_points(mesh: &TriMesh, count: usize, seed: u64) -> (Vec<[f32; 3]>, Vec<[f32; 3]>) {
    let normals = crate::face_normals(&mesh.positions, &mesh.faces);
    sample_surface(mesh, count, seed)
        .iter()
        .map(|point| {
            let corners = triangle(&mesh.positions, mesh.faces[point.face as usize]);
            let [a, b, c]: [_; 3] =
                std::array::from_fn(|k| scale(corners[k], f64::from(point.barycentric[k])));
            (narrow(add(a, add(b, c))), normals[point.face as usize])
        })
        .unzip()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::primitives;

    #[test]
    fn in_proportion_to_area_and_uniform_on_each_face() {
        // A square of area 1 beside a triangle of area 2.
        let mesh = TriMesh::new(
            vec![
                [0.0, 0.0, 0.0],
                [2.0, 0.0, 0.0],
                [0.0, 2.0, 0.0],
                [5.0, 0.0, 0.0],
                [9.0, 0.0, 0.0],
                [5.0, 0.5, 0.0],
            ],
            vec![[0, 1, 2], [3, 4, 5]],
        );
        let n = 40_000;
        let points = sample_surface(&mesh, n, 1);
        let first = points.iter().filter(|p| p.face == 0).count() as f64 / n as f64;
        approx::assert_abs_diff_eq!(first, 2.0 / 3.0, epsilon = 0.01);
        for corner in 0..3 {
            let on_first = points.iter().filter(|p| p.face == 0);
            let mean = on_first.clone().map(|p| f64::from(p.barycentric[corner])).sum::<f64>()
                / on_first.count() as f64;
            approx::assert_abs_diff_eq!(mean, 1.0 / 3.0, epsilon = 0.01);
        }
        for p in &points {
            assert!(p.barycentric.iter().all(|&w| w >= 0.0));
            approx::assert_abs_diff_eq!(p.barycentric.iter().sum::<f32>(), 1.0, epsilon = 1e-6);
        }
    }

    #[test]
    fn the_seed_decides() {
        let mesh = primitives::icosphere(2);
        assert_eq!(sample_surface(&mesh, 50, 3), sample_surface(&mesh, 50, 3));
        assert_ne!(sample_surface(&mesh, 50, 3), sample_surface(&mesh, 50, 4));
        // More points begin with the same ones.
        assert_eq!(sample_surface(&mesh, 20, 3), sample_surface(&mesh, 50, 3)[..20]);
    }

    #[test]
    fn positions_and_normals_belong_together() {
        let mesh = primitives::cuboid([1.0; 3]);
        let (positions, normals) = sample_points(&mesh, 200, 5);
        for (p, n) in positions.iter().zip(&normals) {
            let height: f32 = p.iter().zip(n).map(|(a, b)| a * b).sum();
            approx::assert_abs_diff_eq!(height, 0.5, epsilon = 1e-6);
        }
        let points = sample_surface(&mesh, 200, 5);
        approx::assert_abs_diff_eq!(points[9].position(&mesh)[0], positions[9][0], epsilon = 1e-6);
    }

    #[test]
    fn faces_without_area_are_never_drawn() {
        let mut mesh = primitives::icosphere(0);
        mesh.faces.insert(0, [3, 3, 3]);
        mesh.faces.push([1, 1, 2]);
        assert!(sample_surface(&mesh, 500, 0).iter().all(|p| p.face != 0 && p.face != 21));
        assert!(sample_surface(&TriMesh::default(), 5, 0).is_empty());
    }
}
