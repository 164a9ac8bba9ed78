//! An object while it is put together.

use mesh_core::TriMesh;

use super::family::Family;
use super::shape::{Part, Shape};
use super::solid::{Point, mirrored};

/// The parts so far.
#[derive(Debug, Default)]
pub(super) struct Assembly {
    parts: Vec<Part>,
}

impl Assembly {
    /// A part of one colour.
    pub(super) fn add(&mut self, name: &'static str, mesh: TriMesh, color: [f32; 3]) {
        self.parts.push(Part { name, mesh: mesh.colored(color) });
    }

    /// A part and its mirror image on the other side.
    pub(super) fn pair(&mut self, name: &'static str, mesh: TriMesh, color: [f32; 3]) {
        self.add(name, mirrored(&mesh), color);
        self.add(name, mesh, color);
    }

    /// A part whose colour depends on the place.
    pub(super) fn painted(
        &mut self,
        name: &'static str,
        mut mesh: TriMesh,
        paint: impl Fn(Point) -> [f32; 3],
    ) {
        mesh.colors = Some(mesh.positions.iter().map(|p| paint(p.map(f64::from))).collect());
        self.parts.push(Part { name, mesh });
    }

    /// Turns all parts from the given one on.
    pub(super) fn move_since(&mut self, first: usize, f: impl Fn(TriMesh) -> TriMesh) {
        for part in &mut self.parts[first..] {
            part.mesh = f(std::mem::take(&mut part.mesh));
        }
    }

    /// Takes over all parts of another.
    pub(super) fn absorb(&mut self, other: Self) {
        self.parts.extend(other.parts);
    }

    /// How many parts there are.
    pub(super) fn len(&self) -> usize {
        self.parts.len()
    }

    /// The object.
    pub(super) fn finish(
        self,
        family: Family,
        seed: u64,
        traits: Vec<(&'static str, String)>,
    ) -> Shape {
        Shape { family, seed, parts: self.parts, traits }
    }
}
