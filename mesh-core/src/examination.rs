//! Whether a mesh is a solid: one count and one wording for all who ask.

use std::fmt;

use crate::{Health, TriMesh};

/// What there is to say about a mesh by itself, its health and whether it runs through itself.
///
/// Its text is what summaries say: `a closed solid`, or the reasons why it is none.
///
/// ```
/// use mesh_core::primitives::icosphere;
///
/// let ball = icosphere(2);
/// assert_eq!(ball.examined().to_string(), "a closed solid");
///
/// // Two balls that overlap: closed, and no solid all the same.
/// let mut two = ball.clone();
/// let _ = two.append(&ball.translated([0.9, 0.1, 0.2]));
/// let found = two.examined();
/// assert!(found.health.is_watertight() && !found.is_solid());
/// assert!(found.to_string().ends_with("pairs of faces run through each other"));
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Examination {
    /// Counts, holes, orientation, angles.
    pub health: Health,
    /// Pairs of faces that run through each other.
    pub self_intersections: usize,
}

impl TriMesh {
    /// Examines the mesh; never fails, whatever the mesh is.
    ///
    /// # Cost
    /// That of [`self_intersections`](Self::self_intersections), some 20 ms for 20,000 faces.
    pub fn examined(&self) -> Examination {
        self.examined_with(&|_, _| ())
    }

    /// [`examined`](Self::examined), telling how many parts of how many are done: a fan of 100,000 faces, whose boxes all
    /// meet, takes minutes.
    pub fn examined_with(&self, progress: &(dyn Fn(usize, usize) + Sync)) -> Examination {
        let self_intersections = self.self_intersections_with(progress).len();
        Examination { health: self.health(), self_intersections }
    }
}

impl Examination {
    /// Whether the mesh bounds a solid and no face runs through another one.
    pub fn is_solid(&self) -> bool {
        self.health.is_watertight() && self.self_intersections == 0
    }

    /// What is wrong, one phrase each; empty exactly where [`is_solid`](Self::is_solid).
    pub fn problems(&self) -> Vec<String> {
        let health = &self.health;
        let mut problems = Vec::new();
        let mut note = |wrong: bool, text: String| {
            if wrong {
                problems.push(text);
            }
        };
        note(health.faces == 0, "no faces".into());
        note(!health.finite, "coordinates that are not finite".into());
        note(!health.indices_in_range, "faces that name vertices that are not there".into());
        for (count, one, more, what) in [
            (health.boundary_edges, "edge", "edges", "with one face (holes)"),
            (health.non_manifold_edges, "edge", "edges", "with more than two faces"),
            (health.non_manifold_vertices, "vertex", "vertices", "where surfaces only touch"),
        ] {
            note(count > 0, format!("{count} {} {what}", if count == 1 { one } else { more }));
        }
        note(!health.oriented, "neighbouring faces of opposite orientation".into());
        // The volume of what is open says little.
        let inward = health.oriented
            && !health.outward
            && health.faces > 0
            && (health.volume == 0.0 || (health.volume < 0.0 && health.boundary_edges == 0));
        let text = match (health.volume == 0.0, health.area > 0.0) {
            (false, _) => "faces point inward",
            (true, true) => "it encloses no volume",
            (true, false) => "its faces have no area: all vertices lie in one point or on one line",
        };
        note(inward, text.into());
        // Where all point inward that is said already.
        let (pieces, points) =
            if health.inward_pieces == 1 { ("piece", "points") } else { ("pieces", "point") };
        let text = format!("{} {pieces} {points} inward", health.inward_pieces);
        note(health.outward && health.inward_pieces > 0, text);
        problems.extend(self.crossings());
        problems
    }

    /// How many faces run through others, in words; none where none does.
    pub fn crossings(&self) -> Option<String> {
        Self::crossings_of(self.self_intersections)
    }

    /// The same of a count that was kept.
    pub fn crossings_of(self_intersections: usize) -> Option<String> {
        match self_intersections {
            0 => None,
            1 => Some("1 pair of faces runs through each other".to_owned()),
            count => Some(format!("{count} pairs of faces run through each other")),
        }
    }
}

impl fmt::Display for Examination {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_solid() {
            return f.write_str("a closed solid");
        }
        let closed = if self.health.is_watertight() { "closed, but " } else { "no solid: " };
        write!(f, "{closed}{}", self.problems().join("; "))
    }
}

#[cfg(test)]
mod tests {
    use crate::primitives;

    use super::*;

    #[test]
    fn what_is_no_solid_says_why() {
        let ball = primitives::icosphere(1);
        let mut open = ball.clone();
        open.faces.pop();
        assert_eq!(open.examined().to_string(), "no solid: 3 edges with one face (holes)");
        let mut inward = ball.clone();
        inward.faces.iter_mut().for_each(|face| face.swap(0, 1));
        assert_eq!(inward.examined().to_string(), "no solid: faces point inward");
        assert_eq!(TriMesh::default().examined().to_string(), "no solid: no faces");
        // A hollow in a sheet: below its border, and nothing about it is inside out.
        let positions = vec![
            [1.0, 1.0, 0.0],
            [-1.0, 1.0, 0.0],
            [-1.0, -1.0, 0.0],
            [1.0, -1.0, 0.0],
            [0.0, 0.0, -1.0],
        ];
        let pit = TriMesh::new(positions, vec![[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]);
        assert!(pit.health().volume < 0.0);
        assert_eq!(pit.examined().to_string(), "no solid: 4 edges with one face (holes)");
        let mut two = ball.clone();
        let _ = two.append(&ball.translated([1.9, 0.0, 0.0]));
        let found = two.examined();
        let text = found.to_string();
        assert!(found.health.is_watertight() && !found.is_solid() && found.problems().len() == 1);
        assert_eq!(text, format!("closed, but {}", found.crossings().unwrap_or_default()));
    }

    #[test]
    fn solids_are_those_without_problems() {
        for mesh in [primitives::icosphere(2), primitives::torus(1.0, 0.3, 16, 8)] {
            let found = mesh.examined();
            assert!(found.is_solid() && found.problems().is_empty());
        }
        let text = |corners: [[f32; 3]; 4]| {
            let faces = vec![[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]];
            TriMesh::new(corners.to_vec(), faces).examined().to_string()
        };
        assert_eq!(
            text([[1.0, 2.0, 3.0]; 4]),
            "no solid: its faces have no area: all vertices lie in one point or on one line"
        );
        let square = [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        assert!(text(square).starts_with("no solid: it encloses no volume"), "{}", text(square));
        let card = TriMesh::new(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2]]);
        assert!(!card.examined().is_solid() && !card.examined().problems().is_empty());
    }
}
