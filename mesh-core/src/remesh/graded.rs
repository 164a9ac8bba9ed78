//! Fewer triangles, as large at each place as is wished there.

use super::error::RemeshError;
use super::improve::{ImproveOptions, flip_sweep, relax_sweep};
use super::shape::{Bounds, keeps_shape};
use super::surface::Surface;
use crate::vector::{Vec3, add, narrow, norm, scale, sub, widen};
use crate::{Topology, TriMesh};

/// Shares of the lengths that are aimed at, one after the other: edges that are collapsed a few at a time stay even.
const STAGES: [f64; 5] = [0.3, 0.45, 0.65, 1.0, 1.0];
/// What faces must be after a collapse: no angle below 0.2.
const BOUNDS: Bounds = Bounds { facing: 0.3, smallest: 0.202_710_035_508_672_5, share: 1.0 };

/// Takes edges out of a closed mesh until they are about as long as `lengths`, one for each vertex, asks around there: short
/// where detail is, long elsewhere. Edges that are longer already stay.
///
/// Genus, closedness and orientation stay: a collapse that would break them, turn a face over or make a sliver is not made.
/// The new vertices are near the old surface, not on it. Colours are not kept. The order is fixed, so the result is the same on
/// every machine.
///
/// ```
/// use mesh_core::{Topology, coarsen, primitives};
///
/// // Fine on the right, coarse on the left.
/// let ball = primitives::icosphere(5);
/// let lengths: Vec<f64> = ball.positions.iter().map(|p| if p[0] > 0.0 { 0.05 } else { 0.3 }).collect();
/// let mesh = coarsen(&ball, &Topology::of(&ball), &lengths)?;
/// assert!(mesh.health().is_watertight());
/// let right = mesh.positions.iter().filter(|p| p[0] > 0.0).count();
/// assert!(right > 5 * (mesh.positions.len() - right));
/// # Ok::<(), mesh_core::RemeshError>(())
/// ```
///
/// # Cost
/// Some three microseconds for each face that goes.
///
/// # Errors
/// If the mesh is not a closed, oriented manifold, or has a texture, or if there are not as many lengths as vertices.
///
/// # Panics
/// If `topology` is that of other faces.
pub fn coarsen(
    mesh: &TriMesh,
    topology: &Topology,
    lengths: &[f64],
) -> Result<TriMesh, RemeshError> {
    assert!(topology.faces == mesh.faces, "coarsen: the topology of other faces");
    mesh.validate()?;
    if lengths.len() != mesh.positions.len() {
        let (lengths, vertices) = (lengths.len(), mesh.positions.len());
        return Err(RemeshError::Lengths { lengths, vertices });
    }
    let mut graded = Graded {
        surface: Surface::along(mesh, topology)?,
        positions: mesh.positions.iter().map(|&p| widen(p)).collect(),
        lengths: lengths.to_vec(),
    };
    let improve = ImproveOptions::default();
    for share in STAGES {
        // What could not go at first may when its neighbours are gone.
        while graded.collapse_short(share) > graded.positions.len() / 50 {}
        if share >= 0.65 {
            flip_sweep(&mut graded.surface, &graded.positions, &improve);
            relax_sweep(&graded.surface, &mut graded.positions, &improve);
        }
    }
    let (faces, numbers) = graded.surface.compact();
    let kept = graded.positions.iter().zip(&numbers).filter(|(_, number)| number.is_some());
    Ok(TriMesh::new(kept.map(|(&p, _)| narrow(p)).collect(), faces))
}

struct Graded {
    surface: Surface,
    positions: Vec<Vec3>,
    lengths: Vec<f64>,
}

impl Graded {
    /// Makes one vertex of the ends of edges shorter than 4/5 of this share of their length; gives their number.
    fn collapse_short(&mut self, share: f64) -> usize {
        let mut count = 0;
        for corner in 0..self.surface.corner_count() {
            if !self.surface.is_alive(corner) {
                continue;
            }
            let [b, d] = self.surface.edge(corner);
            let (p, q) = (self.positions[b as usize], self.positions[d as usize]);
            let length = share * self.lengths[b as usize].min(self.lengths[d as usize]);
            let middle = scale(add(p, q), 0.5);
            // What is cheap first.
            if norm(sub(q, p)) < 0.8 * length
                && [[b, d], [d, b]]
                    .iter()
                    .all(|&ends| self.stays_short(ends, middle, 4.0 / 3.0 * length))
                && self.surface.can_collapse(corner)
                && [[b, d], [d, b]]
                    .iter()
                    .all(|&ends| keeps_shape(&self.surface, &self.positions, ends, middle, BOUNDS))
            {
                self.surface.collapse(corner);
                self.positions[b as usize] = middle;
                self.lengths[b as usize] = length / share;
                count += 1;
            }
        }
        count
    }

    /// Whether no edge of `vertex` but that to `other` becomes longer than this with it at `at`.
    fn stays_short(&self, [vertex, other]: [u32; 2], at: Vec3, longest: f64) -> bool {
        let here = self.positions[vertex as usize];
        self.surface.ring(vertex).all(|v| {
            let end = self.positions[v as usize];
            // An edge that is too long already may stay as it is.
            v == other || norm(sub(end, at)) <= longest.max(norm(sub(end, here)))
        })
    }
}
