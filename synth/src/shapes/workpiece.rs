//! A thing while its parts are put together.

use mesh_core::{TriMesh, subdivide};

use super::family::Family;
use super::shape::{Part, Shape};

/// The fewest faces that a finished thing has.
const FACES: usize = 2_000;

/// Parts and traits so far.
#[derive(Debug, Default)]
pub(super) struct Workpiece {
    parts: Vec<Part>,
    traits: Vec<(&'static str, String)>,
}

impl Workpiece {
    /// Adds a part that is in its place and painted.
    pub(super) fn add(&mut self, name: &'static str, mesh: TriMesh) {
        self.parts.push(Part { name, mesh });
    }

    /// Adds a part and its mirror image about the plane `x = 0`.
    pub(super) fn add_pair(&mut self, name: &'static str, mesh: TriMesh) {
        let mirrored = mesh.clone().map_positions(|[x, y, z]| [-x, y, z]).flipped();
        self.add(name, mesh);
        self.add(name, mirrored);
    }

    /// Says what was drawn.
    pub(super) fn note(&mut self, name: &'static str, value: impl Into<String>) {
        self.traits.push((name, value.into()));
    }

    /// The finished thing, with faces enough for what is made of few and plain ones.
    pub(super) fn finish(mut self, family: Family, seed: u64) -> Shape {
        let count = |parts: &[Part]| parts.iter().map(|part| part.mesh.faces.len()).sum::<usize>();
        while count(&self.parts) < FACES {
            for part in &mut self.parts {
                part.mesh = subdivide(&part.mesh);
            }
        }
        Shape { family, seed, parts: self.parts, traits: self.traits }
    }
}
