//! What a mesh is worth: the checks that a user would run before using it.

use std::fmt;

use crate::inside::inside_out;
use crate::mesh::signed_volume;
use crate::vector::{angle, area_vector, cross, dot, norm, sub, triangle, widen};
use crate::{Topology, TriMesh};

/// The state of a mesh, as plain numbers.
///
/// Made by [`TriMesh::health`] for any mesh, however broken: faces that name vertices which do not
/// exist are counted and otherwise left out. Where coordinates are not finite, volume and area are no numbers either.
///
/// ```
/// use mesh_core::primitives;
/// let health = primitives::icosphere(3).health();
/// assert!(health.is_watertight());
/// assert_eq!(health.genus(), Some(0));
/// assert!(health.smallest_angle_degrees > 50.0);
/// println!("{health}");
/// ```
#[allow(clippy::struct_excessive_bools, reason = "a list of independent findings")]
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct Health {
    /// The number of vertices.
    pub vertices: usize,
    /// The number of faces.
    pub faces: usize,
    /// Whether every coordinate is finite.
    pub finite: bool,
    /// Whether every face names vertices that exist.
    pub indices_in_range: bool,
    /// Edges with a single face.
    pub boundary_edges: usize,
    /// Edges with more than two faces.
    pub non_manifold_edges: usize,
    /// Vertices where more than one fan of faces meets.
    pub non_manifold_vertices: usize,
    /// `V - E + F`, isolated vertices not counted: 2 for each closed piece, less 2 for each handle.
    pub euler: i64,
    /// Whether the two faces on each edge that has two run along it in opposite directions.
    pub oriented: bool,
    /// Whether the enclosed volume is positive.
    pub outward: bool,
    /// Pieces of a closed, oriented mesh that point inward without being the wall of a hollow in another piece.
    pub inward_pieces: usize,
    /// The enclosed volume; means something for closed meshes only.
    pub volume: f64,
    /// The area of all faces.
    pub area: f64,
    /// The smallest angle of any face, in degrees; 0 without faces.
    pub smallest_angle_degrees: f64,
    /// The share of all angles that are under 5 degrees.
    pub angles_below_5_fraction: f64,
    /// The sharpest fold between two faces on an edge, in degrees: 0 is flat, 180 folded back.
    pub largest_dihedral_degrees: f64,
    /// The share of the edges between two faces at which the surface turns by more than 120 degrees: a crease that is folded
    /// over, sharper than any corner of a box.
    pub folded_edges_fraction: f64,
    /// Pieces that are connected through vertices; isolated vertices are not counted.
    pub components: usize,
    /// Vertices that no face names.
    pub isolated_vertices: usize,
    /// Faces that name a vertex twice, or whose height is below `1e-7` of their longest side.
    pub degenerate_faces: usize,
}

impl Health {
    /// Whether the mesh bounds a solid: finite, closed, manifold, oriented, and outward, each piece of it but the walls of hollows.
    pub fn is_watertight(&self) -> bool {
        self.finite
            && self.indices_in_range
            && self.faces > 0
            && self.boundary_edges == 0
            && self.non_manifold_edges == 0
            && self.non_manifold_vertices == 0
            && self.oriented
            && self.outward
            && self.inward_pieces == 0
    }

    /// The number of handles of a closed, oriented, manifold mesh, all pieces together.
    pub fn genus(&self) -> Option<usize> {
        let surface = self.boundary_edges == 0
            && self.non_manifold_edges == 0
            && self.non_manifold_vertices == 0
            && self.oriented
            && self.indices_in_range;
        // V - E + F = 2 (components - genus)
        let twice = 2 * self.components as i64 - self.euler;
        (surface && twice >= 0 && twice % 2 == 0).then_some(twice as usize / 2)
    }
}

impl fmt::Display for Health {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let yes = |fine: bool| if fine { "yes" } else { "NO" };
        writeln!(
            f,
            "{} vertices, {} faces, {} component{}, Euler number {}{}",
            self.vertices,
            self.faces,
            self.components,
            if self.components == 1 { "" } else { "s" },
            self.euler,
            self.genus().map(|genus| format!(" (genus {genus})")).unwrap_or_default()
        )?;
        writeln!(
            f,
            "watertight {} (boundary edges {}, non-manifold edges {}, non-manifold vertices {}, \
             oriented {}, outward {})",
            yes(self.is_watertight()),
            self.boundary_edges,
            self.non_manifold_edges,
            self.non_manifold_vertices,
            yes(self.oriented),
            yes(self.outward)
        )?;
        writeln!(f, "area {:.6}, volume {:.6}", self.area, self.volume)?;
        writeln!(
            f,
            "smallest angle {:.2}°, angles under 5° {:.2} %, sharpest fold {:.2}° (0 flat, 180 folded), edges beyond 120° {:.2} %",
            self.smallest_angle_degrees,
            100.0 * self.angles_below_5_fraction,
            self.largest_dihedral_degrees,
            100.0 * self.folded_edges_fraction
        )?;
        write!(
            f,
            "finite {}, indices in range {}, isolated vertices {}, degenerate faces {}",
            yes(self.finite),
            yes(self.indices_in_range),
            self.isolated_vertices,
            self.degenerate_faces
        )
    }
}

impl TriMesh {
    /// Examines the mesh; never fails, whatever the mesh is.
    ///
    /// Self-intersections are asked for separately, [`TriMesh::self_intersections`].
    ///
    /// # Cost
    /// `O(V + F)`; a few milliseconds for 20,000 faces.
    pub fn health(&self) -> Health {
        let count = self.positions.len();
        let faces: Vec<[u32; 3]> = self
            .faces
            .iter()
            .copied()
            .filter(|face| face.iter().all(|&v| (v as usize) < count))
            .collect();
        let topology = Topology::new(count, &faces);
        let shape = Shape::of(&self.positions, &faces, &topology);
        let rings = topology.edge_rings.rows();
        let (mut boundary_edges, mut non_manifold_edges) = (0, 0);
        for ring in rings {
            match ring.len() {
                1 => boundary_edges += 1,
                2 => {}
                _ => non_manifold_edges += 1,
            }
        }
        let volume = signed_volume(&self.positions, &faces);
        let oriented = oriented(&faces, &topology);
        let is_closed = oriented && boundary_edges + non_manifold_edges == 0;
        let inward_pieces =
            if is_closed { inside_out(&self.positions, &faces, &topology) } else { 0 };
        Health {
            vertices: count,
            faces: self.faces.len(),
            finite: self.positions.iter().flatten().all(|x| x.is_finite()),
            indices_in_range: faces.len() == self.faces.len(),
            boundary_edges,
            non_manifold_edges,
            non_manifold_vertices: non_manifold_vertices(&topology),
            euler: topology.euler_number(),
            oriented,
            outward: volume > 0.0,
            inward_pieces,
            volume,
            area: shape.area,
            smallest_angle_degrees: shape.smallest_angle.to_degrees(),
            angles_below_5_fraction: shape.small_angles as f64 / shape.angles.max(1) as f64,
            largest_dihedral_degrees: shape.largest_dihedral.to_degrees(),
            folded_edges_fraction: shape.folded as f64 / shape.dihedrals.max(1) as f64,
            components: topology.component_count(),
            isolated_vertices: topology.vertex_faces.rows().filter(|r| r.is_empty()).count(),
            degenerate_faces: shape.degenerate_faces,
        }
    }
}

/// What is measured rather than counted.
struct Shape {
    area: f64,
    smallest_angle: f64,
    angles: usize,
    small_angles: usize,
    largest_dihedral: f64,
    /// Edges between two faces that have areas, and those of them that are folded.
    dihedrals: usize,
    folded: usize,
    degenerate_faces: usize,
}

/// From where on an edge is folded.
const FOLDED_DEGREES: f64 = 120.0;

impl Shape {
    fn of(positions: &[[f32; 3]], faces: &[[u32; 3]], topology: &Topology) -> Self {
        let mut area = 0.0;
        let mut smallest = f64::INFINITY;
        let (mut angles, mut small_angles, mut degenerate_faces) = (0, 0, 0);
        for &face in faces {
            let [a, b, c] = triangle(positions, face);
            let sides = [sub(b, a), sub(c, b), sub(a, c)];
            let longest = sides.map(norm).into_iter().fold(0.0, f64::max);
            let twice = norm(area_vector([a, b, c]));
            if !twice.is_finite() {
                continue;
            }
            area += 0.5 * twice;
            if twice <= 1e-7 * longest * longest {
                degenerate_faces += 1;
            }
            for i in 0..3 {
                // Between the side that leaves the corner and the one that arrives, turned round.
                // A corner on a side of no length has no angle: count it as none at all.
                let (leaving, arriving) = (sides[i], sides[(i + 2) % 3]);
                let spread = if norm(leaving) == 0.0 || norm(arriving) == 0.0 {
                    0.0
                } else {
                    angle(leaving, arriving.map(|x| -x))
                };
                angles += 1;
                small_angles += usize::from(spread < 5.0_f64.to_radians());
                smallest = smallest.min(spread);
            }
        }
        let (mut largest_dihedral, mut dihedrals, mut folded) = (0.0_f64, 0, 0);
        for (&[p, q], &sides) in topology.edges.iter().zip(&topology.edge_faces) {
            if sides.contains(&Topology::NONE) {
                continue;
            }
            let at = |v: u32| widen(positions[v as usize]);
            let opposite = sides.map(|face| {
                let corners = faces[face as usize];
                corners.into_iter().find(|&v| v != p && v != q).map(at)
            });
            let [Some(a), Some(b)] = opposite else { continue };
            let (along, p) = (sub(at(q), at(p)), at(p));
            // Both normals are taken from the edge, so the faces' own orientation does not matter.
            let (left, right) = (cross(along, sub(a, p)), cross(sub(b, p), along));
            if dot(left, left) > 0.0 && dot(right, right) > 0.0 {
                let fold = angle(left, right);
                if fold.is_finite() {
                    largest_dihedral = largest_dihedral.max(fold);
                    dihedrals += 1;
                    folded += usize::from(fold > FOLDED_DEGREES.to_radians());
                }
            }
        }
        let smallest_angle = if smallest.is_finite() { smallest } else { 0.0 };
        Self {
            area,
            smallest_angle,
            angles,
            small_angles,
            largest_dihedral,
            dihedrals,
            folded,
            degenerate_faces,
        }
    }
}

/// Whether faces on an edge of two run along it in opposite directions.
fn oriented(faces: &[[u32; 3]], topology: &Topology) -> bool {
    topology.edges.iter().zip(&topology.edge_faces).all(|(&[a, b], &[left, right])| {
        let forward = |face: u32| {
            let [p, q, r] = faces[face as usize];
            [[p, q], [q, r], [r, p]].contains(&[a, b])
        };
        left == Topology::NONE || right == Topology::NONE || forward(left) != forward(right)
    })
}

/// Vertices whose faces are not all joined to each other through edges at that vertex.
fn non_manifold_vertices(topology: &Topology) -> usize {
    // Which vertex last came by each face and edge: marks that need no clearing.
    let mut faces = vec![Topology::NONE; topology.face_count()];
    let mut edges = vec![Topology::NONE; topology.edges.len()];
    let (mut count, mut open) = (0, Vec::new());
    for (vertex, ring) in topology.vertex_faces.rows().enumerate() {
        let Some(&first) = ring.first() else { continue };
        let vertex = vertex as u32;
        faces[first as usize] = vertex;
        open.push(first);
        let mut reached = 0;
        while let Some(face) = open.pop() {
            reached += 1;
            for edge in topology.face_edges[face as usize] {
                if edge == Topology::NONE
                    || !topology.edges[edge as usize].contains(&vertex)
                    || std::mem::replace(&mut edges[edge as usize], vertex) == vertex
                {
                    continue;
                }
                for &next in topology.edge_rings.row(edge as usize) {
                    if std::mem::replace(&mut faces[next as usize], vertex) != vertex {
                        open.push(next);
                    }
                }
            }
        }
        count += usize::from(reached < ring.len());
    }
    count
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::primitives;

    #[test]
    fn of_a_cube() {
        let health = primitives::cuboid([1.0; 3]).health();
        assert!(health.is_watertight());
        assert_eq!(health.genus(), Some(0));
        assert_eq!((health.volume, health.area), (1.0, 6.0));
        approx::assert_abs_diff_eq!(health.smallest_angle_degrees, 45.0, epsilon = 1e-9);
        approx::assert_abs_diff_eq!(health.largest_dihedral_degrees, 90.0, epsilon = 1e-9);
        assert_eq!((health.components, health.degenerate_faces), (1, 0));
        assert_eq!(health.folded_edges_fraction, 0.0);
        assert!(health.to_string().contains("watertight yes"), "{health}");
    }

    #[test]
    fn of_an_icosahedron() {
        // Its dihedral angle is acos(-√5/3) = 138.19°, so two faces deviate by 41.81°.
        let health = primitives::icosphere(0).health();
        approx::assert_abs_diff_eq!(health.smallest_angle_degrees, 60.0, epsilon = 1e-4);
        approx::assert_abs_diff_eq!(health.largest_dihedral_degrees, 41.810_315, epsilon = 1e-4);
    }

    #[test]
    fn handles_and_pieces() {
        let mut mesh = primitives::torus(1.0, 0.3, 12, 8);
        assert_eq!(mesh.health().genus(), Some(1));
        mesh.append(&primitives::icosphere(1).translated([3.0, 0.0, 0.0])).unwrap();
        let health = mesh.health();
        assert_eq!((health.genus(), health.components, health.euler), (Some(1), 2, 2));
    }

    #[test]
    fn what_is_broken_is_told() {
        let mut mesh = primitives::icosphere(1);
        mesh.faces.pop();
        let health = mesh.health();
        assert_eq!((health.boundary_edges, health.is_watertight()), (3, false));
        assert_eq!(health.genus(), None);

        let mut mesh = primitives::icosphere(1);
        mesh.faces[7].swap(0, 1);
        assert!(!mesh.health().oriented);
        assert!(!primitives::icosphere(1).flipped().health().outward);

        let mut mesh = primitives::icosphere(1);
        mesh.faces.push([0, 0, 1]);
        mesh.faces.push([0, 1, 5000]);
        mesh.positions.push([f32::NAN, 0.0, 0.0]);
        let health = mesh.health();
        assert_eq!(health.degenerate_faces, 1);
        assert_eq!(health.isolated_vertices, 1);
        assert!(!health.indices_in_range && !health.finite);

        // A page folded back onto itself, and a cap of one degree.
        let mesh = TriMesh::new(
            vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 1.0, 0.0], [0.5, 1.0, 0.0]],
            vec![[0, 1, 2], [1, 0, 3]],
        );
        approx::assert_abs_diff_eq!(mesh.health().largest_dihedral_degrees, 180.0, epsilon = 1e-9);
        assert_eq!(mesh.health().folded_edges_fraction, 1.0);
        let height = 1.0_f32.to_radians().tan();
        let mesh = TriMesh::new(
            vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, height, 0.0]],
            vec![[0, 1, 2]],
        );
        let health = mesh.health();
        approx::assert_abs_diff_eq!(health.smallest_angle_degrees, 1.0, epsilon = 1e-4);
        approx::assert_abs_diff_eq!(health.angles_below_5_fraction, 1.0 / 3.0);
    }

    #[test]
    fn two_cones_that_touch_at_their_tips() {
        let tip = |sign: f32| {
            let cone = primitives::cone(1.0, 1.0, 8).translated([0.0, -0.5, 0.0]);
            if sign < 0.0 { cone.scaled([1.0, -1.0, 1.0]) } else { cone }
        };
        let mut mesh = tip(1.0);
        mesh.append(&tip(-1.0)).unwrap();
        let apexes: Vec<u32> = (0..mesh.positions.len() as u32)
            .filter(|&v| mesh.positions[v as usize] == [0.0; 3])
            .collect();
        assert_eq!(apexes.len(), 2);
        for v in mesh.faces.iter_mut().flatten() {
            if *v == apexes[1] {
                *v = apexes[0];
            }
        }
        let health = mesh.health();
        assert_eq!((health.non_manifold_vertices, health.boundary_edges), (1, 0));
        assert_eq!(health.isolated_vertices, 1);
        assert!(!health.is_watertight());
    }

    #[test]
    fn of_nothing() {
        let health = TriMesh::default().health();
        assert!(!health.is_watertight() && health.finite);
        assert_eq!(health.smallest_angle_degrees, 0.0);
    }
}
