//! Which vertices, edges and faces of a triangle mesh touch each other.

use crate::{Csr, TriMesh};

/// The edges of a triangle mesh and its neighbourhoods, in a deterministic order.
///
/// Any triangle list is accepted: edges with one face (borders) or with three and more
/// (non-manifold), isolated vertices, and faces that name a vertex twice (the corner pair that is
/// no edge gets [`Topology::NONE`]).
///
/// ```
/// use mesh_core::{Topology, primitives};
/// let cube = primitives::cuboid([1.0, 1.0, 1.0]);
/// let topology = Topology::new(cube.positions.len(), &cube.faces);
/// assert_eq!(topology.edges.len(), 18);
/// assert!(topology.is_closed());
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Topology {
    /// Unique edges `[E]` as `[v0, v1]` with `v0 < v1`, sorted.
    pub edges: Vec<[u32; 2]>,
    /// For each edge the one or two faces on it, ascending; [`Topology::NONE`] where there is
    /// none, and twice `NONE` on an edge of three or more faces (see [`Topology::edge_rings`]).
    pub edge_faces: Vec<[u32; 2]>,
    /// For each face `[a, b, c]` its edges `[ab, bc, ca]`.
    pub face_edges: Vec<[u32; 3]>,
    /// For each edge all of its faces, ascending.
    pub edge_rings: Csr,
    /// For each vertex the faces around it, ascending.
    pub vertex_faces: Csr,
    /// For each vertex the vertices joined to it by an edge, ascending.
    pub vertex_vertices: Csr,
    /// The faces it was made of, `[F]`.
    pub faces: Vec<[u32; 3]>,
}

/// The edges.
impl AsRef<[[u32; 2]]> for Topology {
    fn as_ref(&self) -> &[[u32; 2]] {
        &self.edges
    }
}

/// The faces.
impl AsRef<[[u32; 3]]> for Topology {
    fn as_ref(&self) -> &[[u32; 3]] {
        &self.faces
    }
}

/// The neighbours of the vertices.
impl AsRef<Csr> for Topology {
    fn as_ref(&self) -> &Csr {
        &self.vertex_vertices
    }
}

/// Two faces on one edge, and the corner of each that is not on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct FacePair {
    /// The edge, as an index into [`Topology::edges`].
    pub edge: u32,
    /// The faces, ascending.
    pub faces: [u32; 2],
    /// The vertex of each face that is opposite to the edge.
    pub opposite: [u32; 2],
}

/// The edges of a list of faces.
struct Edges {
    /// As [`Topology::edges`].
    ends: Vec<[u32; 2]>,
    /// As [`Topology::face_edges`].
    of_faces: Vec<[u32; 3]>,
    /// As [`Topology::edge_rings`].
    rings: Csr,
}

impl Edges {
    fn of(vertex_count: usize, faces: &[[u32; 3]]) -> Self {
        let by_low = slots_by_low(faces);
        let mut slots = Csr::from_pairs(vertex_count, &by_low);
        let mut edges = Self {
            ends: Vec::with_capacity(faces.len() * 3 / 2),
            of_faces: vec![[Topology::NONE; 3]; faces.len()],
            rings: Csr { offsets: vec![0], indices: Vec::with_capacity(by_low.len()) },
        };
        for vertex in 0..vertex_count {
            let range = slots.range(vertex);
            let row = &mut slots.indices[range];
            row.sort_unstable_by_key(|&slot| (ends(faces, slot).1, slot));
            let mut rest = &*row;
            while let Some(&first) = rest.first() {
                let (low, high) = ends(faces, first);
                let count = rest.iter().take_while(|&&slot| ends(faces, slot).1 == high).count();
                edges.push([low, high], &rest[..count]);
                rest = &rest[count..];
            }
        }
        edges
    }

    /// Adds an edge and the corner slots that run along it, ascending.
    fn push(&mut self, ends: [u32; 2], slots: &[u32]) {
        let edge = self.ends.len() as u32;
        let mut last = Topology::NONE;
        for &slot in slots {
            let face = slot / 3;
            self.of_faces[face as usize][slot as usize % 3] = edge;
            // A face that names a vertex twice runs along the same edge twice.
            if face != last {
                self.rings.indices.push(face);
                last = face;
            }
        }
        self.ends.push(ends);
        self.rings.offsets.push(self.rings.indices.len() as u32);
    }
}

impl Topology {
    /// Stands for "no face" and "no edge".
    pub const NONE: u32 = u32::MAX;

    /// Finds the edges of `faces` and who is next to whom.
    ///
    /// # Cost
    /// Linear in vertices and faces, except for sorting the edges of each single vertex.
    /// # Panics
    /// If a face names a vertex that is not below `vertex_count`, or if there are more than
    /// `u32::MAX / 3` faces.
    pub fn new(vertex_count: usize, faces: &[[u32; 3]]) -> Self {
        check(vertex_count, faces);
        let Edges { ends, of_faces, rings } = Edges::of(vertex_count, faces);
        let edge_faces = rings
            .rows()
            .map(|ring| match *ring {
                [a] => [a, Self::NONE],
                [a, b] => [a, b],
                _ => [Self::NONE; 2],
            })
            .collect();
        // Edges are sorted, so listing first the smaller neighbours and then the larger ones
        // leaves every row sorted.
        let both: Vec<[u32; 2]> =
            ends.iter().map(|&[a, b]| [b, a]).chain(ends.iter().copied()).collect();
        Self {
            edge_faces,
            face_edges: of_faces,
            edge_rings: rings,
            vertex_faces: faces_around(vertex_count, faces),
            vertex_vertices: Csr::from_pairs(vertex_count, &both),
            edges: ends,
            faces: faces.to_vec(),
        }
    }

    /// That of a mesh.
    ///
    /// # Panics
    /// As [`new`](Self::new).
    pub fn of(mesh: &TriMesh) -> Self {
        Self::new(mesh.positions.len(), &mesh.faces)
    }

    /// The number of vertices, isolated ones included.
    pub fn vertex_count(&self) -> usize {
        self.vertex_vertices.len()
    }

    /// The number of faces.
    pub fn face_count(&self) -> usize {
        self.face_edges.len()
    }

    /// Whether every edge has exactly two faces.
    pub fn is_closed(&self) -> bool {
        self.edge_faces.iter().all(|&[a, b]| a != Self::NONE && b != Self::NONE)
    }

    /// The index of the edge between two vertices, if there is one. `O(log E)`.
    pub fn edge_between(&self, a: u32, b: u32) -> Option<u32> {
        self.edges.binary_search(&[a.min(b), a.max(b)]).ok().map(|edge| edge as u32)
    }

    /// The Euler number `V - E + F`, isolated vertices not counted.
    ///
    /// Two for each closed surface without handles; each handle takes two away.
    pub fn euler_number(&self) -> i64 {
        let used = self.vertex_faces.rows().filter(|ring| !ring.is_empty()).count();
        used as i64 - self.edges.len() as i64 + self.face_count() as i64
    }

    /// The connected component of each vertex, numbered from 0 by their first vertices; [`NONE`](Self::NONE) for one that no face has.
    /// What shares a vertex hangs together.
    ///
    /// ```
    /// use mesh_core::{Topology, primitives};
    /// let mut two = primitives::icosphere(0); // 12 vertices
    /// two.append(&primitives::icosphere(1).translated([3.0, 0.0, 0.0]))?;
    /// let components = Topology::of(&two).components();
    /// assert_eq!((components[11], components[12]), (0, 1));
    /// # Ok::<(), mesh_core::MeshError>(())
    /// ```
    ///
    /// # Cost
    /// Linear in vertices and edges.
    pub fn components(&self) -> Vec<u32> {
        let mut components = vec![Self::NONE; self.vertex_count()];
        let (mut count, mut open) = (0, Vec::new());
        for start in 0..components.len() {
            if components[start] != Self::NONE || self.vertex_faces.row(start).is_empty() {
                continue;
            }
            components[start] = count;
            open.push(start as u32);
            while let Some(vertex) = open.pop() {
                for &next in self.vertex_vertices.row(vertex as usize) {
                    if components[next as usize] == Self::NONE {
                        components[next as usize] = count;
                        open.push(next);
                    }
                }
            }
            count += 1;
        }
        components
    }

    /// How many [components](Self::components) there are.
    ///
    /// # Cost
    /// Linear in vertices and edges.
    pub fn component_count(&self) -> usize {
        let components = self.components();
        let last = components.iter().filter(|&&component| component != Self::NONE).max();
        last.map_or(0, |&last| last as usize + 1)
    }

    /// Every pair of faces that share an edge, ordered by edge.
    ///
    /// On an edge of more than two faces these are all pairs of them, the definition of
    /// PyTorch3D's normal consistency. Faces that name a vertex twice are left out.
    ///
    /// # Panics
    /// If `faces` are not those that the topology was made of.
    pub fn face_pairs(&self, faces: &[[u32; 3]]) -> Vec<FacePair> {
        assert_eq!(faces.len(), self.face_count(), "face_pairs: another mesh");
        let mut pairs = Vec::with_capacity(self.edges.len());
        self.each_face_pair(|pair| pairs.push(pair));
        pairs
    }

    /// Calls `f` with the pairs of [`face_pairs`](Self::face_pairs), in their order, without a list of them.
    pub fn each_face_pair(&self, mut f: impl FnMut(FacePair)) {
        let opposite = |face: u32, [a, b]: [u32; 2]| {
            let [p, q, r] = self.faces[face as usize];
            (p != q && q != r && r != p)
                .then(|| [p, q, r].into_iter().find(|&v| v != a && v != b))
                .flatten()
        };
        for (edge, &ends) in self.edges.iter().enumerate() {
            let (edge, ring) = (edge as u32, self.edge_rings.row(edge));
            for (i, &first) in ring.iter().enumerate() {
                for &second in &ring[i + 1..] {
                    if let (Some(a), Some(b)) = (opposite(first, ends), opposite(second, ends)) {
                        f(FacePair { edge, faces: [first, second], opposite: [a, b] });
                    }
                }
            }
        }
    }
}

/// Panics where a face names no vertex, or there are too many faces.
fn check(vertex_count: usize, faces: &[[u32; 3]]) {
    let corners = faces.len() * 3;
    assert!(u32::try_from(corners).is_ok(), "Topology: {} faces exceed u32", faces.len());
    for (face, corners) in faces.iter().enumerate() {
        for &v in corners {
            assert!(
                (v as usize) < vertex_count,
                "Topology: face {face} names vertex {v} of {vertex_count}"
            );
        }
    }
}

/// The smaller and the larger end of the edge that begins at a corner slot: of face `slot / 3`, at corner `slot % 3`.
fn ends(faces: &[[u32; 3]], slot: u32) -> (u32, u32) {
    let corners = faces[slot as usize / 3];
    let (a, b) = (corners[slot as usize % 3], corners[(slot as usize + 1) % 3]);
    (a.min(b), a.max(b))
}

/// Corner slots, each after the smaller end of its edge; without those whose ends are one vertex.
fn slots_by_low(faces: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let slots = 0..faces.len() as u32 * 3;
    slots
        .filter_map(|slot| {
            let (low, high) = ends(faces, slot);
            (low != high).then_some([low, slot])
        })
        .collect()
}

/// For each vertex the faces around it, each once.
fn faces_around(vertex_count: usize, faces: &[[u32; 3]]) -> Csr {
    let around: Vec<[u32; 2]> = faces
        .iter()
        .enumerate()
        .flat_map(|(face, &[a, b, c])| {
            let face = face as u32;
            let second = (b != a).then_some([b, face]);
            let third = (c != a && c != b).then_some([c, face]);
            [Some([a, face]), second, third].into_iter().flatten()
        })
        .collect();
    Csr::from_pairs(vertex_count, &around)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::primitives;

    #[test]
    fn tetrahedron_by_hand() {
        let faces = [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]];
        let t = Topology::new(4, &faces);
        assert_eq!(t.edges, [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]);
        assert_eq!(t.edge_faces, [[0, 1], [0, 2], [1, 2], [0, 3], [1, 3], [2, 3]]);
        assert_eq!(t.face_edges, [[0, 3, 1], [2, 4, 0], [1, 5, 2], [4, 5, 3]]);
        assert_eq!(t.vertex_vertices.row(2), [0, 1, 3]);
        assert_eq!(t.vertex_faces.row(3), [1, 2, 3]);
        assert_eq!(t.euler_number(), 2);
        assert!(t.is_closed());
        let pairs = t.face_pairs(&faces);
        assert_eq!(pairs.len(), 6);
        assert_eq!(pairs[0], FacePair { edge: 0, faces: [0, 1], opposite: [2, 3] });
        assert_eq!(t.edge_between(3, 1), Some(4));
        assert_eq!(t.edge_between(3, 3), None);
    }

    #[test]
    fn borders_and_three_faces_on_an_edge() {
        let faces = [[0, 1, 2], [1, 0, 3], [0, 1, 4]];
        let t = Topology::new(6, &faces);
        let shared = t.edge_between(0, 1).unwrap() as usize;
        assert_eq!(t.edge_faces[shared], [Topology::NONE; 2]);
        assert_eq!(t.edge_rings.row(shared), [0, 1, 2]);
        let border = t.edge_between(1, 2).unwrap() as usize;
        assert_eq!(t.edge_faces[border], [0, Topology::NONE]);
        assert!(!t.is_closed());
        assert_eq!(t.face_pairs(&faces).len(), 3);
        assert!(t.vertex_vertices.row(5).is_empty());
        assert_eq!(t.euler_number(), 5 - 7 + 3);
    }

    #[test]
    fn a_face_that_names_a_vertex_twice() {
        let faces = [[0, 0, 1], [0, 1, 2], [1, 1, 1]];
        let t = Topology::new(3, &faces);
        assert_eq!(t.edges, [[0, 1], [0, 2], [1, 2]]);
        assert_eq!(t.face_edges[0], [Topology::NONE, 0, 0]);
        assert_eq!(t.edge_rings.row(0), [0, 1]);
        assert_eq!(t.vertex_faces.row(1), [0, 1, 2]);
        assert!(t.face_pairs(&faces).is_empty());
    }

    #[test]
    fn neighbors_are_sorted_and_mutual() {
        let mesh = primitives::torus(1.0, 0.3, 9, 7);
        let t = Topology::new(mesh.positions.len(), &mesh.faces);
        for (v, row) in t.vertex_vertices.rows().enumerate() {
            assert!(row.is_sorted());
            for &n in row {
                assert!(t.vertex_vertices.row(n as usize).contains(&(v as u32)));
            }
        }
    }

    #[test]
    #[should_panic(expected = "face 1 names vertex 4 of 4")]
    fn vertex_out_of_range() {
        Topology::new(4, &[[0, 1, 2], [0, 1, 4]]);
    }
}
