//! Closed shapes to begin from: all of them watertight, faces counter-clockwise seen from outside.
//!
//! Sizes are in the user's units, +Y is up, and the centre is at the origin unless said otherwise.

mod extrude;
mod lathe;
mod loft;
mod pixel2mesh;
mod rounded;
mod sphere;
mod torus;
mod tube;

pub use extrude::{PolygonError, extrude};
pub use lathe::{capsule, closed_rings, cone, cylinder, lathe, uv_sphere};
pub use loft::{loft, plate};
pub use pixel2mesh::pixel2mesh_ellipsoid;
pub use rounded::rounded_cuboid;
pub use sphere::{icosphere, subdivide_sphere};
pub use torus::torus;
pub use tube::{TubeEnds, smooth_path, tube};

use crate::TriMesh;

/// A box of `[width, height, depth]` with 8 vertices and 12 faces.
///
/// # Panics
/// If a side is not positive and finite.
pub fn cuboid(sides: [f32; 3]) -> TriMesh {
    for side in sides {
        assert!(side > 0.0 && side.is_finite(), "cuboid: sides {sides:?} must be positive");
    }
    let positions = (0..8_u8)
        .map(|corner| {
            std::array::from_fn(|k| if corner >> k & 1 == 1 { 0.5 } else { -0.5 } * sides[k])
        })
        .collect();
    // Two faces per side; bit k of a corner's number says on which end of axis k it is.
    let faces =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]]
            .into_iter()
            .flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]])
            .collect();
    TriMesh::new(positions, faces)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Topology;

    /// Watertight, consistently oriented, outward, of the given Euler number.
    #[track_caller]
    pub(super) fn assert_sound(mesh: &TriMesh, euler: i64) {
        assert_eq!(mesh.validate(), Ok(()));
        let topology = Topology::new(mesh.positions.len(), &mesh.faces);
        assert!(topology.is_closed());
        assert_eq!(topology.euler_number(), euler);
        assert!(topology.vertex_faces.rows().all(|ring| !ring.is_empty()));
        let mut directed: Vec<[u32; 2]> =
            mesh.faces.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
        directed.sort_unstable();
        assert!(directed.windows(2).all(|w| w[0] != w[1]), "a half-edge twice: not oriented");
        assert!(mesh.volume() > 0.0);
    }

    #[test]
    fn the_cuboid_is_exact() {
        let cube = cuboid([2.0, 3.0, 4.0]);
        assert_sound(&cube, 2);
        assert_eq!(cube.volume(), 24.0);
        assert_eq!(cube.area(), 52.0);
    }

    #[test]
    #[should_panic(expected = "must be positive")]
    fn a_flat_cuboid_is_refused() {
        cuboid([1.0, 0.0, 1.0]);
    }
}
