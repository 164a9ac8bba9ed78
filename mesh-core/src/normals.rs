//! Normals and areas of faces and vertices.

use crate::vector::{Vec3, add, area_vector, narrow, norm, triangle, unit};

/// Unit normals of the faces, `[F, 3]`; zero where a face has no area.
///
/// # Panics
/// If a face names a vertex that does not exist.
pub fn face_normals(positions: &[[f32; 3]], faces: &[[u32; 3]]) -> Vec<[f32; 3]> {
    faces.iter().map(|&face| narrow(unit(area_vector(triangle(positions, face))))).collect()
}

/// Areas of the faces, `[F]`, in squared units of the positions.
///
/// # Panics
/// If a face names a vertex that does not exist.
pub fn face_areas(positions: &[[f32; 3]], faces: &[[u32; 3]]) -> Vec<f32> {
    faces.iter().map(|&face| (0.5 * norm(area_vector(triangle(positions, face)))) as f32).collect()
}

/// Unit normals of the vertices, `[V, 3]`: the mean of the faces around, weighted by their area.
///
/// Zero for a vertex without faces, or where the faces around cancel.
///
/// # Panics
/// If a face names a vertex that does not exist.
pub fn vertex_normals(positions: &[[f32; 3]], faces: &[[u32; 3]]) -> Vec<[f32; 3]> {
    let mut sums: Vec<Vec3> = vec![[0.0; 3]; positions.len()];
    for &face in faces {
        let normal = area_vector(triangle(positions, face));
        for v in face {
            sums[v as usize] = add(sums[v as usize], normal);
        }
    }
    sums.into_iter().map(|sum| narrow(unit(sum))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::primitives;

    #[test]
    fn of_a_right_triangle() {
        let positions = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 4.0, 0.0]];
        assert_eq!(face_normals(&positions, &[[0, 1, 2]]), [[0.0, 0.0, 1.0]]);
        assert_eq!(face_areas(&positions, &[[0, 2, 1]]), [6.0]);
        assert_eq!(face_normals(&positions, &[[0, 1, 1]]), [[0.0; 3]]);
        assert_eq!(vertex_normals(&positions, &[]), [[0.0; 3]; 3]);
    }

    #[test]
    fn of_a_sphere_point_outward() {
        let sphere = primitives::icosphere(3);
        for (n, p) in vertex_normals(&sphere.positions, &sphere.faces).iter().zip(&sphere.positions)
        {
            let cosine: f32 = n.iter().zip(p).map(|(a, b)| a * b).sum();
            assert!(cosine > 0.9995, "{cosine}");
        }
    }
}
