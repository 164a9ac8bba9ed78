//! A closed surface that can be changed: faces and, for each corner, the corner across its edge.

use super::error::RemeshError;
use crate::{Topology, TriMesh};

/// Corner `3 f + i` is the one of face `f` at its `i`-th vertex. "The edge of a corner" is the one
/// opposite to it.
#[derive(Clone, Debug)]
pub(super) struct Surface {
    pub(super) faces: Vec<[u32; 3]>,
    /// For each corner the other corner of the same edge.
    opposite: Vec<u32>,
    /// For each vertex any one of its corners; [`Surface::GONE`] once it is removed.
    corner_of: Vec<u32>,
    /// For each face whether it is still there.
    alive: Vec<bool>,
}

pub(super) const fn next(corner: u32) -> u32 {
    if corner % 3 == 2 { corner - 2 } else { corner + 1 }
}

pub(super) const fn previous(corner: u32) -> u32 {
    if corner.is_multiple_of(3) { corner + 2 } else { corner - 1 }
}

impl Surface {
    pub(super) const GONE: u32 = u32::MAX;

    /// Takes the faces of a closed, oriented mesh where a single fan surrounds each vertex.
    pub(super) fn new(mesh: &TriMesh) -> Result<Self, RemeshError> {
        mesh.validate()?;
        Self::along(mesh, &Topology::of(mesh))
    }

    /// The same where it is known who is next to whom.
    pub(super) fn along(mesh: &TriMesh, topology: &Topology) -> Result<Self, RemeshError> {
        if mesh.texture.is_some() {
            return Err(RemeshError::Textured);
        }
        let mut opposite = vec![Self::GONE; 3 * mesh.faces.len()];
        for (edge, &[left, right]) in topology.edge_faces.iter().enumerate() {
            let [a, b] = topology.edges[edge];
            if left == Topology::NONE || right == Topology::NONE {
                let faces = topology.edge_rings.row(edge).len();
                return Err(RemeshError::NotClosed { edge: [a, b], faces });
            }
            let [c, o] = [left, right].map(|face| {
                let corners = mesh.faces[face as usize];
                3 * face + corners.iter().position(|&v| v != a && v != b).unwrap_or(0) as u32
            });
            let at = |corner: u32| mesh.faces[corner as usize / 3][corner as usize % 3];
            if at(next(c)) != at(previous(o)) {
                return Err(RemeshError::NotOriented { edge: [a, b] });
            }
            opposite[c as usize] = o;
            opposite[o as usize] = c;
        }
        let mut corner_of = vec![Self::GONE; mesh.positions.len()];
        for (corner, &v) in mesh.faces.as_flattened().iter().enumerate() {
            corner_of[v as usize] = corner as u32;
        }
        let alive = vec![true; mesh.faces.len()];
        let surface = Self { faces: mesh.faces.clone(), opposite, corner_of, alive };
        for (vertex, ring) in topology.vertex_faces.rows().enumerate() {
            if ring.is_empty() {
                return Err(RemeshError::Isolated { vertex });
            }
            if surface.fan(vertex as u32).count() != ring.len() {
                return Err(RemeshError::NotManifold { vertex });
            }
        }
        Ok(surface)
    }

    pub(super) fn vertex(&self, corner: u32) -> u32 {
        self.faces[corner as usize / 3][corner as usize % 3]
    }

    pub(super) fn opposite(&self, corner: u32) -> u32 {
        self.opposite[corner as usize]
    }

    pub(super) fn is_alive(&self, corner: u32) -> bool {
        self.alive[corner as usize / 3]
    }

    pub(super) fn corner_count(&self) -> u32 {
        self.opposite.len() as u32
    }

    /// The ends of the edge of a corner.
    pub(super) fn edge(&self, corner: u32) -> [u32; 2] {
        [self.vertex(next(corner)), self.vertex(previous(corner))]
    }

    /// The corners at a vertex, once around.
    pub(super) fn fan(&self, vertex: u32) -> impl Iterator<Item = u32> {
        let first = self.corner_of[vertex as usize];
        let mut at = Some(first).filter(|&corner| corner != Self::GONE);
        std::iter::from_fn(move || {
            let here = at?;
            let turned = next(self.opposite(next(here)));
            at = (turned != first).then_some(turned);
            Some(here)
        })
    }

    /// The vertices around a vertex.
    pub(super) fn ring(&self, vertex: u32) -> impl Iterator<Item = u32> {
        self.fan(vertex).map(|corner| self.vertex(next(corner)))
    }

    pub(super) fn valence(&self, vertex: u32) -> usize {
        self.fan(vertex).count()
    }

    /// Whether no more than three corners are at a vertex.
    fn has_three(&self, vertex: u32) -> bool {
        self.fan(vertex).nth(3).is_none()
    }

    fn join(&mut self, a: u32, b: u32) {
        self.opposite[a as usize] = b;
        self.opposite[b as usize] = a;
    }

    fn set(&mut self, corner: u32, vertex: u32) {
        self.faces[corner as usize / 3][corner as usize % 3] = vertex;
        self.corner_of[vertex as usize] = corner;
    }

    /// Whether the edge of `corner` can be turned without doubling another or losing a vertex.
    pub(super) fn can_flip(&self, corner: u32) -> bool {
        let (a, e) = (self.vertex(corner), self.vertex(self.opposite(corner)));
        let [b, d] = self.edge(corner);
        a != e && self.ring(a).all(|v| v != e) && self.valence(b) > 3 && self.valence(d) > 3
    }

    /// Turns the edge `b d` of `corner` into `a e`: `(a b d) (e d b)` become `(a b e) (e d a)`.
    pub(super) fn flip(&mut self, c: u32) {
        let o = self.opposite(c);
        let (a, e) = (self.vertex(c), self.vertex(o));
        let [b, d] = self.edge(c);
        let (from_da, from_be) = (self.opposite(next(c)), self.opposite(next(o)));
        self.set(previous(c), e);
        self.set(previous(o), a);
        self.set(next(c), b);
        self.set(next(o), d);
        self.join(c, from_be);
        self.join(o, from_da);
        self.join(next(c), next(o));
    }

    /// Puts a new vertex on the edge of `corner`, and joins it to both corners of the edge.
    pub(super) fn split(&mut self, c: u32) -> u32 {
        let o = self.opposite(c);
        let (a, e) = (self.vertex(c), self.vertex(o));
        let [b, d] = self.edge(c);
        let (from_da, from_be) = (self.opposite(next(c)), self.opposite(next(o)));
        let m = self.corner_of.len() as u32;
        let first = self.opposite.len() as u32;
        let (c2, o2) = (first, first + 3);
        self.corner_of.push(Self::GONE);
        self.faces.extend([[a, m, d], [e, m, b]]);
        self.alive.extend([true, true]);
        self.opposite.extend([Self::GONE; 6]);
        self.set(previous(c), m);
        self.set(previous(o), m);
        self.corner_of[d as usize] = previous(c2);
        self.corner_of[b as usize] = previous(o2);
        // f = (a b m), f2 = (a m d), g = (e d m), g2 = (e m b)
        self.join(c, o2);
        self.join(next(c), previous(c2));
        self.join(c2, o);
        self.join(next(c2), from_da);
        self.join(next(o), previous(o2));
        self.join(next(o2), from_be);
        m
    }

    /// Whether the ends of the edge of `corner` can become one vertex and leave a closed surface:
    /// they have just the two corners of the edge as common neighbours, and those keep three others.
    pub(super) fn can_collapse(&self, c: u32) -> bool {
        let (a, e) = (self.vertex(c), self.vertex(self.opposite(c)));
        if a == e || self.has_three(a) || self.has_three(e) {
            return false;
        }
        let [b, d] = self.edge(c);
        // Both rings have `a` and `e`, and of the rest nothing in common.
        self.ring(b).all(|v| v == a || v == e || self.ring(d).all(|w| w != v))
    }

    /// Makes the ends `b` and `d` of the edge of `corner` one vertex, `b`; `d` and two faces go.
    pub(super) fn collapse(&mut self, c: u32) {
        let o = self.opposite(c);
        let (a, e) = (self.vertex(c), self.vertex(o));
        let [b, d] = self.edge(c);
        let (from_da, from_ab) = (self.opposite(next(c)), self.opposite(previous(c)));
        let (from_be, from_ed) = (self.opposite(next(o)), self.opposite(previous(o)));
        let around: Vec<u32> = self.fan(d).collect();
        for corner in around {
            self.faces[corner as usize / 3][corner as usize % 3] = b;
        }
        self.join(from_da, from_ab);
        self.join(from_be, from_ed);
        self.alive[c as usize / 3] = false;
        self.alive[o as usize / 3] = false;
        self.corner_of[d as usize] = Self::GONE;
        for corner in [from_da, from_ab, from_be, from_ed] {
            for corner in [next(corner), previous(corner)] {
                let v = self.vertex(corner);
                if v == a || v == e || v == b {
                    self.corner_of[v as usize] = corner;
                }
            }
        }
    }

    /// The faces that are left, and for each vertex its new number; the order is kept.
    pub(super) fn compact(&self) -> (Vec<[u32; 3]>, Vec<Option<u32>>) {
        let mut count = 0;
        let numbers: Vec<Option<u32>> = self
            .corner_of
            .iter()
            .map(|&corner| {
                (corner != Self::GONE).then(|| {
                    count += 1;
                    count - 1
                })
            })
            .collect();
        let faces = self
            .faces
            .iter()
            .zip(&self.alive)
            .filter(|&(_, &alive)| alive)
            .map(|(face, _)| face.map(|v| numbers[v as usize].unwrap_or(Self::GONE)))
            .collect();
        (faces, numbers)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::primitives;

    /// What is kept up to date by hand must equal what is found from scratch.
    fn check(surface: &Surface) {
        let (faces, numbers) = surface.compact();
        let count = numbers.iter().flatten().count();
        let topology = Topology::new(count, &faces);
        assert!(topology.is_closed());
        assert_eq!(topology.euler_number(), 2);
        for corner in (0..surface.corner_count()).filter(|&c| surface.is_alive(c)) {
            let other = surface.opposite(corner);
            assert_eq!(surface.opposite(other), corner);
            let [a, b] = surface.edge(corner);
            assert_eq!(surface.edge(other), [b, a]);
        }
        for (vertex, number) in numbers.iter().enumerate() {
            if let Some(number) = number {
                let ring = topology.vertex_faces.row(*number as usize);
                assert_eq!(surface.valence(vertex as u32), ring.len());
                assert!(surface.fan(vertex as u32).all(|c| surface.vertex(c) == vertex as u32));
            }
        }
    }

    #[test]
    fn any_sequence_of_changes_leaves_a_closed_sphere() {
        let mut surface = Surface::new(&primitives::icosphere(1)).unwrap();
        let mut state = 1_u32;
        let (mut flips, mut collapses) = (0, 0);
        for step in 0..600 {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let corner = (state >> 8) % surface.corner_count();
            if !surface.is_alive(corner) {
                continue;
            }
            match step % 3 {
                0 if surface.can_flip(corner) => {
                    surface.flip(corner);
                    flips += 1;
                }
                1 => {
                    surface.split(corner);
                }
                2 if surface.can_collapse(corner) => {
                    surface.collapse(corner);
                    collapses += 1;
                }
                _ => {}
            }
            check(&surface);
        }
        assert!(flips > 80 && collapses > 50, "{flips} {collapses}");
    }

    #[test]
    fn a_tetrahedron_cannot_shrink() {
        let mesh = TriMesh::new(
            vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        );
        let surface = Surface::new(&mesh).unwrap();
        assert!((0..12).all(|c| !surface.can_flip(c) && !surface.can_collapse(c)));
    }

    #[test]
    fn what_is_not_closed_is_refused() {
        let mut open = primitives::icosphere(0);
        open.faces.pop();
        assert!(matches!(Surface::new(&open), Err(RemeshError::NotClosed { faces: 1, .. })));
        let mut turned = primitives::icosphere(0);
        turned.faces[3].swap(0, 1);
        assert!(matches!(Surface::new(&turned), Err(RemeshError::NotOriented { .. })));
        let mut loose = primitives::icosphere(0);
        loose.positions.push([0.0; 3]);
        assert!(matches!(Surface::new(&loose), Err(RemeshError::Isolated { vertex: 12 })));
    }
}
