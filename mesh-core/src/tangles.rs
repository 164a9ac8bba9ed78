//! Where a mesh passes through itself or is folded, as its vertices move.

use crate::Topology;
use crate::crossings::{Crossings, Moved};
use crate::vector::{area_vector, dot, narrow, sub, triangle, unit};

/// Edges at which the surface turns by more than so many degrees are folds: 0 is flat, 180 folded back.
const FOLD: f32 = 165.0;

/// The faces of a mesh that run through each other, and the edges that are folds. What stays where it was is not looked at again.
pub(crate) struct Tangles<'a> {
    faces: &'a [[u32; 3]],
    topology: &'a Topology,
    crossings: Crossings,
    positions: Vec<[f32; 3]>,
    /// Of the faces.
    normals: Vec<[f32; 3]>,
    /// Of the edges.
    folds: Vec<Option<Fold>>,
}

#[derive(Clone, Copy, PartialEq)]
enum Fold {
    /// The edge of a blade: the rest of the other face is behind each of its faces.
    Blade,
    /// The bottom of a crease.
    Crease,
}

/// Vertices that something is wrong with.
pub(crate) struct Tangled {
    /// Those of sheets whose sides have met.
    pub(crate) thin: Vec<bool>,
    /// All.
    pub(crate) all: Vec<bool>,
}

impl<'a> Tangles<'a> {
    /// # Panics
    /// If a face or `topology` names a vertex that does not exist.
    pub(crate) fn of(
        positions: &[[f32; 3]],
        faces: &'a [[u32; 3]],
        topology: &'a Topology,
    ) -> Self {
        let mut tangles = Self {
            faces,
            topology,
            crossings: Crossings::of(positions, faces),
            positions: positions.to_vec(),
            normals: crate::face_normals(positions, faces),
            folds: Vec::new(),
        };
        tangles.folds = (0..topology.edges.len()).map(|edge| tangles.fold(edge)).collect();
        tangles
    }

    /// The vertices have moved.
    pub(crate) fn update(&mut self, positions: &[[f32; 3]]) {
        let moved = self.moved(positions);
        self.positions.copy_from_slice(positions);
        self.crossings.update(positions, self.faces, &moved);
        for face in moved.faces.iter().map(|&face| face as usize) {
            self.normals[face] = narrow(unit(area_vector(triangle(positions, self.faces[face]))));
        }
        for edge in moved.faces.iter().flat_map(|&face| self.topology.face_edges[face as usize]) {
            if edge != Topology::NONE {
                self.folds[edge as usize] = self.fold(edge as usize);
            }
        }
    }

    fn moved(&self, positions: &[[f32; 3]]) -> Moved {
        let both = self.positions.iter().zip(positions).enumerate();
        let vertices: Vec<u32> =
            both.filter(|(_, (old, new))| old != new).map(|(v, _)| v as u32).collect();
        let mut is_listed = vec![false; self.faces.len()];
        let around = vertices.iter().flat_map(|&v| self.topology.vertex_faces.row(v as usize));
        let faces = around
            .copied()
            .filter(|&face| !std::mem::replace(&mut is_listed[face as usize], true))
            .collect();
        Moved { vertices, faces }
    }

    fn fold(&self, edge: usize) -> Option<Fold> {
        let [f, g] = self.topology.edge_faces[edge];
        if f == Topology::NONE
            || g == Topology::NONE
            || self.along([f, g]) >= FOLD.to_radians().cos()
        {
            return None;
        }
        let middle = |f: u32| -> [f32; 3] {
            let corners = self.faces[f as usize].map(|v| self.positions[v as usize]);
            std::array::from_fn(|k| corners.iter().map(|p| p[k]).sum())
        };
        let behind = dot(sub(middle(g), middle(f)), self.normals[f as usize]) < 0.0;
        Some(if behind { Fold::Blade } else { Fold::Crease })
    }

    /// Cosine of the angle between two faces.
    fn along(&self, [f, g]: [u32; 2]) -> f32 {
        dot(self.normals[f as usize], self.normals[g as usize])
    }

    /// Whether there are none.
    pub(crate) fn is_empty(&self) -> bool {
        self.crossings.pairs.is_empty() && self.folds.iter().all(Option::is_none)
    }

    /// The vertices of faces that run through others or are folded onto a neighbour.
    pub(crate) fn found(&self) -> Tangled {
        let none = || vec![false; self.positions.len()];
        let mut tangled = Tangled { thin: none(), all: none() };
        for &pair in &self.crossings.pairs {
            tangled.mark(pair, self.faces, self.along(pair) < 0.0);
        }
        for (fold, &pair) in self.folds.iter().zip(&self.topology.edge_faces) {
            if let Some(fold) = fold {
                tangled.mark(pair, self.faces, *fold == Fold::Blade);
            }
        }
        tangled
    }
}

impl Tangled {
    fn mark(&mut self, pair: [u32; 2], faces: &[[u32; 3]], thin: bool) {
        for vertex in pair.into_iter().flat_map(|face| faces[face as usize]) {
            self.all[vertex as usize] = true;
            self.thin[vertex as usize] |= thin;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::primitives;

    /// A ball that is dented through its far side, turned inside out at a vertex, and mended again.
    #[test]
    fn what_moved_is_found_as_if_all_were_looked_at_again() {
        let ball = primitives::icosphere(3);
        let topology = Topology::new(ball.positions.len(), &ball.faces);
        let mut positions = ball.positions.clone();
        let mut tangles = Tangles::of(&positions, &ball.faces, &topology);
        assert!(tangles.is_empty());
        let mut seen = 0;
        for (vertex, factor) in [(5, -1.5), (40, 0.2), (41, 0.9), (5, 1.0), (41, 1.0), (40, 1.0)] {
            positions[vertex] = ball.positions[vertex].map(|x| factor * x);
            tangles.update(&positions);
            let again = Tangles::of(&positions, &ball.faces, &topology);
            let (found, expected) = (tangles.found(), again.found());
            assert_eq!((found.all, found.thin), (expected.all.clone(), expected.thin));
            assert_eq!(tangles.is_empty(), !expected.all.contains(&true));
            seen += expected.all.iter().filter(|&&wrong| wrong).count();
        }
        assert!(tangles.is_empty() && seen > 20, "{seen}");
    }
}
