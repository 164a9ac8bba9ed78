//! The sphere that everything starts as.

use crate::vector::{narrow, unit, widen};
use crate::{Subdivision, TriMesh};

/// The unit sphere from an icosahedron, subdivided `level` times.
///
/// `10·4^level + 2` vertices and `20·4^level` faces, every level a subdivision of the one before
/// (the first vertices are the same), all vertices on the sphere:
///
/// | level | 0 | 1 | 2 | 3 | 4 | 5 | 6 |
/// |---|---|---|---|---|---|---|---|
/// | vertices | 12 | 42 | 162 | 642 | 2562 | 10242 | 40962 |
/// | faces | 20 | 80 | 320 | 1280 | 5120 | 20480 | 81920 |
///
/// # Panics
/// If `level` is above 8 (1.3 million faces).
pub fn icosphere(level: u32) -> TriMesh {
    assert!(level <= 8, "icosphere: level {level}, expected 0..=8");
    // Three golden rectangles, one in each coordinate plane.
    let long = f64::midpoint(1.0, 5.0_f64.sqrt());
    let positions = (0..12_u32)
        .map(|i| {
            let (axis, a, b) = (i as usize / 4, i & 1, i >> 1 & 1);
            let mut p = [0.0; 3];
            p[axis] = if a == 0 { -1.0 } else { 1.0 };
            p[(axis + 1) % 3] = if b == 0 { -long } else { long };
            narrow(unit(p))
        })
        .collect();
    #[rustfmt::skip]
    let faces = vec![
        [0, 4, 1], [0, 1, 6], [0, 8, 4], [0, 6, 9], [0, 9, 8],
        [1, 4, 10], [1, 11, 6], [1, 10, 11], [2, 3, 5], [2, 7, 3],
        [2, 5, 8], [2, 9, 7], [2, 8, 9], [3, 10, 5], [3, 7, 11],
        [3, 11, 10], [4, 8, 5], [4, 5, 10], [6, 7, 9], [6, 11, 7],
    ];
    let mut mesh = TriMesh::new(positions, faces);
    for _ in 0..level {
        mesh = subdivide_sphere(&mesh);
    }
    mesh
}

/// Midpoint subdivision of a mesh on the unit sphere, the new vertices pushed out onto it.
///
/// Carries over neither colours nor texture; [`subdivide`](crate::subdivide()) does.
///
/// # Panics
/// If a face names a vertex that does not exist, or if the result does not fit in `u32`.
pub fn subdivide_sphere(mesh: &TriMesh) -> TriMesh {
    let finer = Subdivision::of(mesh.positions.len(), &mesh.faces);
    let mut positions = finer.apply(&mesh.positions);
    for position in &mut positions[mesh.positions.len()..] {
        *position = narrow(unit(widen(*position)));
    }
    TriMesh::new(positions, finer.faces)
}

#[cfg(test)]
mod tests {
    use super::super::tests::assert_sound;
    use super::*;

    #[test]
    fn counts_and_radius() {
        for level in 0..=5 {
            let mesh = icosphere(level);
            assert_sound(&mesh, 2);
            assert_eq!(mesh.positions.len(), 10 * 4_usize.pow(level) + 2);
            assert_eq!(mesh.faces.len(), 20 * 4_usize.pow(level));
            for p in &mesh.positions {
                approx::assert_abs_diff_eq!(crate::vector::norm(widen(*p)), 1.0, epsilon = 1e-7);
            }
        }
    }

    #[test]
    fn the_icosahedron_is_regular_and_the_sphere_nearly_full() {
        // Volume of the icosahedron of circumradius 1: 2.5361507...; of the ball: 4π/3.
        approx::assert_abs_diff_eq!(icosphere(0).volume(), 2.536_150_7, epsilon = 1e-6);
        let ball = 4.0 / 3.0 * std::f64::consts::PI;
        approx::assert_relative_eq!(icosphere(5).volume(), ball, max_relative = 1e-3);
        approx::assert_relative_eq!(
            icosphere(5).area(),
            4.0 * std::f64::consts::PI,
            max_relative = 1e-3
        );
    }

    #[test]
    fn levels_begin_alike() {
        assert_eq!(icosphere(3).positions[..162], icosphere(2).positions);
    }
}
