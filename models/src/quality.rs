//! What a distance between surfaces does not say of a predicted mesh.

use mesh_core::TriMesh;

/// How sound a surface is, whatever it is compared with.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Quality {
    /// The share of the faces that run through another one.
    pub self_intersecting: f64,
    /// The share of the edges at which the surface is folded over: it turns by more than 120 degrees.
    pub folded: f64,
}

impl Quality {
    /// Of a mesh; both are not a number where it has no faces, or positions that are none.
    ///
    /// # Cost
    /// That of [`TriMesh::self_intersections`]: some milliseconds for 5,000 faces.
    pub fn of(mesh: &TriMesh) -> Self {
        let health = mesh.health();
        if mesh.faces.is_empty() || !health.finite || !health.indices_in_range {
            return Self { self_intersecting: f64::NAN, folded: f64::NAN };
        }
        let mut crossed = vec![false; mesh.faces.len()];
        mesh.self_intersections().iter().flatten().for_each(|&face| crossed[face as usize] = true);
        let count = crossed.iter().filter(|&&is| is).count();
        Self {
            self_intersecting: count as f64 / crossed.len() as f64,
            folded: health.folded_edges_fraction,
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use mesh_core::primitives::{cuboid, icosphere};

    #[test]
    fn a_sphere_is_sound_and_two_through_each_other_are_not() {
        assert_eq!(Quality::of(&icosphere(2)), Quality::default());
        assert_eq!(Quality::of(&cuboid([1.0; 3])), Quality::default());
        let mut two = icosphere(2);
        two.append(&icosphere(2).translated([1.0, 0.1, 0.2])).unwrap();
        let found = Quality::of(&two);
        assert!((0.05..0.5).contains(&found.self_intersecting) && found.folded == 0.0, "{found:?}");
    }

    #[test]
    fn what_is_pushed_through_and_what_is_folded_over_are_seen() {
        let mut ball = icosphere(2);
        ball.positions[0] = ball.positions[0].map(|x| -1.5 * x);
        let found = Quality::of(&ball);
        assert!((0.005..0.1).contains(&found.self_intersecting), "{found:?}");
        // A page turned over its edge, a little above the other.
        let corners = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 1.0, 0.0], [0.5, 1.0, 0.1]];
        let page = TriMesh::new(corners, vec![[0, 1, 2], [1, 0, 3]]);
        assert_eq!(Quality::of(&page), Quality { self_intersecting: 0.0, folded: 1.0 });
        assert!(Quality::of(&TriMesh::default()).folded.is_nan());
    }
}
