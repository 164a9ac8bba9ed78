//! One thing that was drawn.

use mesh_core::{TriMesh, bounds};

use super::family::Family;

/// One instance of a family.
///
/// Upright (+Y), its front towards +Z, in units of its own; [`Shape::mesh`] is centred on its box
/// and has a box whose diagonal is 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// What it is an instance of.
    pub family: Family,
    /// What it was drawn from.
    pub seed: u64,
    /// Closed, outward-oriented, coloured parts; they may touch and sink into each other.
    pub parts: Vec<Part>,
    /// What was drawn, in words: `("legs", "3")`. The same names for all instances of a family.
    pub traits: Vec<(&'static str, String)>,
}

/// One closed part of a [`Shape`].
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// What it is; several parts may share a name.
    pub name: &'static str,
    /// Its surface, with one colour a vertex.
    pub mesh: TriMesh,
}

impl Shape {
    /// All parts as one coloured mesh, centred on its box, whose diagonal is 1.
    pub fn mesh(&self) -> TriMesh {
        let mut all = TriMesh::default();
        for part in &self.parts {
            all.append(&part.mesh).expect("parts are small and all coloured");
        }
        let around = all.bounds().expect("a shape has vertices");
        let (middle, diagonal) = (bounds::center(around), bounds::diagonal::<f32>(around));
        for p in &mut all.positions {
            *p = std::array::from_fn(|k| (p[k] - middle[k]) / diagonal);
        }
        all
    }
}
