//! Triangles of one size all over.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::error::RemeshError;
use super::improve::{ImproveOptions, flip_sweep, keeps_facing, relax_sweep};
use super::shape::{Bounds, keeps_shape};
use super::surface::{Surface, next, previous};
use crate::vector::{Vec3, add, narrow, norm, scale, sub, widen};
use crate::{ClosestPoint, SurfacePoint, TriMesh};

/// What [`remesh`] aims at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RemeshOptions {
    /// The length that all edges should have, in the units of the positions.
    pub edge_length: f64,
    /// How many times to split, collapse, turn and slide.
    pub passes: usize,
}

/// A mesh of new triangles, and where they come from.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Remeshed {
    /// The new mesh; its colours are taken from `sources`.
    pub mesh: TriMesh,
    /// For each new vertex its place on the old mesh, to carry over anything else that lives there.
    pub sources: Vec<SurfacePoint>,
}

/// Faces that are aimed at, at most.
const MOST_FACES: f64 = 2e7;

/// What faces must be after a collapse: no angle below 0.2.
const BOUNDS: Bounds = Bounds { facing: 0.5, smallest: 0.202_710_035_508_672_5, share: 1.0 };

/// Gives a closed mesh new triangles, all nearly equilateral and of one size, on the same surface.
///
/// Each pass splits edges longer than 4/3 of the aim, collapses those shorter than 4/5 of it, turns
/// edges and slides vertices as [`improve`](crate::improve) does, and puts every vertex back on the
/// old surface. Genus, closedness and orientation stay: a change that would break them is not made.
/// The order is fixed, so the result is the same on every machine. Sharp edges are not treated
/// apart, so they are cut like all others and lose some of their sharpness.
///
/// ```
/// use mesh_core::{RemeshOptions, primitives, remesh};
/// let old = primitives::uv_sphere(16, 64); // slivers at the poles
/// let new = remesh(&old, &RemeshOptions { edge_length: 0.15, passes: 5 }).unwrap().mesh;
/// assert!(new.health().is_watertight());
/// assert!(new.health().smallest_angle_degrees > 25.0);
/// ```
///
/// # Cost
/// Some 150 ms a pass for 10,000 faces.
/// # Errors
/// If the mesh is not a closed, oriented manifold, or has a texture, or if the length is not
/// positive or asks for more than 20 million faces.
/// # References
/// Botsch and Kobbelt 2004, *A Remeshing Approach to Multiresolution Modeling*, section 4.
pub fn remesh(mesh: &TriMesh, options: &RemeshOptions) -> Result<Remeshed, RemeshError> {
    let length = options.edge_length;
    // An equilateral triangle of side l has the area √3/4 l².
    let faces = mesh.validate().map(|()| mesh.area() / (0.433 * length * length))?;
    if !(length > 0.0 && length.is_finite() && faces <= MOST_FACES) {
        return Err(RemeshError::EdgeLength { found: length });
    }
    let mut surface = Surface::new(mesh)?;
    let old = ClosestPoint::new(mesh);
    let back = |p: Vec3| {
        let Some(closest) = old.find_wide(p) else { return p };
        let corners = mesh.faces[closest.point.face as usize];
        let weights = closest.point.barycentric.map(f64::from);
        (0..3).fold([0.0; 3], |sum, k| {
            add(sum, scale(widen(mesh.positions[corners[k] as usize]), weights[k]))
        })
    };
    let mut positions: Vec<Vec3> = mesh.positions.iter().map(|&p| widen(p)).collect();
    let improve = ImproveOptions::default();
    for _ in 0..options.passes {
        split_long(&mut surface, &mut positions, 4.0 / 3.0 * length);
        collapse_short(&mut surface, &mut positions, 0.8 * length, 4.0 / 3.0 * length);
        for _ in 0..3 {
            if flip_sweep(&mut surface, &positions, &improve) == 0 {
                break;
            }
        }
        relax_sweep(&surface, &mut positions, &improve);
        for vertex in 0..positions.len() as u32 {
            let there = back(positions[vertex as usize]);
            if keeps_facing(&surface, &positions, vertex, there) {
                positions[vertex as usize] = there;
            }
        }
    }
    Ok(on_surface(&surface, &positions, mesh, &old))
}

/// What is left of a surface, its vertices at these places, and where on the old mesh they are.
pub(super) fn on_surface(
    surface: &Surface,
    positions: &[Vec3],
    mesh: &TriMesh,
    old: &ClosestPoint,
) -> Remeshed {
    let (faces, numbers) = surface.compact();
    let kept = positions.iter().zip(&numbers).filter(|(_, number)| number.is_some());
    let mut result = TriMesh::new(kept.map(|(&p, _)| narrow(p)).collect(), faces);
    let sources: Vec<SurfacePoint> = result
        .positions
        .iter()
        .map(|&p| old.find(p).map(|closest| closest.point).unwrap_or_default())
        .collect();
    result.colors = mesh
        .colors
        .as_ref()
        .map(|colors| sources.iter().map(|point| point.interpolate(mesh, colors)).collect());
    Remeshed { mesh: result, sources }
}

/// Halves every edge longer than `longest`, also those that halving makes; the longest one first,
/// since halving short sides of long triangles makes ever longer ones.
fn split_long(surface: &mut Surface, positions: &mut Vec<Vec3>, longest: f64) {
    let length = |surface: &Surface, positions: &[Vec3], corner: u32| {
        let [a, b] = surface.edge(corner).map(|v| positions[v as usize]);
        norm(sub(b, a))
    };
    // Positive numbers are in the order of their bits. Of equals the lowest corner comes first.
    let mut queue: BinaryHeap<(u64, Reverse<u32>)> = (0..surface.corner_count())
        .filter(|&c| surface.is_alive(c) && c < surface.opposite(c))
        .map(|c| (length(surface, positions, c), c))
        .filter(|&(length, _)| length > longest)
        .map(|(length, c)| (length.to_bits(), Reverse(c)))
        .collect();
    while let Some((bits, Reverse(corner))) = queue.pop() {
        if length(surface, positions, corner).to_bits() != bits {
            continue; // the corner has another edge by now, queued on its own
        }
        let [a, b] = surface.edge(corner).map(|v| positions[v as usize]);
        let middle = surface.split(corner);
        positions.push(scale(add(a, b), 0.5));
        // The edges at the new vertex and around it: some of those have other corners now.
        for around in surface.fan(middle) {
            for corner in [around, next(around)] {
                let length = length(surface, positions, corner);
                if length > longest {
                    queue.push((length.to_bits(), Reverse(corner)));
                }
            }
        }
    }
}

/// Makes one vertex of the ends of edges shorter than `shortest`, where that leaves no edge longer
/// than `longest`, turns no face over and makes no sliver.
fn collapse_short(surface: &mut Surface, positions: &mut [Vec3], shortest: f64, longest: f64) {
    for corner in 0..surface.corner_count() {
        if !surface.is_alive(corner) {
            continue;
        }
        let [b, d] = surface.edge(corner);
        let (p, q) = (positions[b as usize], positions[d as usize]);
        let middle = scale(add(p, q), 0.5);
        if norm(sub(q, p)) < shortest
            && surface.can_collapse(corner)
            && fits(surface, positions, [b, d], middle, longest)
            && fits(surface, positions, [d, b], middle, longest)
        {
            surface.collapse(corner);
            positions[b as usize] = middle;
        }
    }
}

/// Whether the faces around `vertex`, less those that also have `other`, do well with it at `at`.
fn fits(
    surface: &Surface,
    positions: &[Vec3],
    [vertex, other]: [u32; 2],
    at: Vec3,
    longest: f64,
) -> bool {
    let short = |corner: u32| {
        let [b, c] = [next(corner), previous(corner)].map(|corner| surface.vertex(corner));
        b == other || c == other || norm(sub(positions[b as usize], at)) <= longest
    };
    surface.fan(vertex).all(short) && keeps_shape(surface, positions, [vertex, other], at, BOUNDS)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::primitives;

    #[test]
    fn edges_of_one_length_on_the_same_surface() {
        for (mesh, length, genus) in [
            (primitives::uv_sphere(16, 64), 0.15, 0),
            (primitives::icosphere(2).scaled([0.4, 2.0, 1.0]), 0.12, 0),
            (primitives::torus(1.0, 0.4, 64, 12), 0.12, 1),
            (primitives::cylinder(0.5, 2.0, 48), 0.1, 0),
        ] {
            let options = RemeshOptions { edge_length: length, passes: 6 };
            let colored = {
                let colors = mesh.positions.iter().map(|p| p.map(|x| 0.25 * x + 0.5)).collect();
                TriMesh { colors: Some(colors), ..mesh.clone() }
            };
            let new = remesh(&colored, &options).unwrap();
            let (before, after) = (mesh.health(), new.mesh.health());
            assert!(after.is_watertight());
            assert_eq!((after.genus(), after.components), (Some(genus), before.components));
            assert!(after.smallest_angle_degrees > 12.0, "{after}");
            approx::assert_relative_eq!(after.volume, before.volume, max_relative = 0.03);

            let topology = crate::Topology::new(new.mesh.positions.len(), &new.mesh.faces);
            let lengths: Vec<f64> = topology
                .edges
                .iter()
                .map(|e| e.map(|v| widen(new.mesh.positions[v as usize])))
                .map(|[a, b]| norm(sub(b, a)))
                .collect();
            let mean = lengths.iter().sum::<f64>() / lengths.len() as f64;
            approx::assert_relative_eq!(mean, length, max_relative = 0.15);
            assert!(lengths.iter().all(|l| (0.3..1.7).contains(&(l / length))), "{after}");

            // Every vertex is on the old surface, where its source says, with the colour of there.
            assert_eq!(new.sources.len(), new.mesh.positions.len());
            let colors = new.mesh.colors.as_ref().unwrap();
            for ((p, source), color) in new.mesh.positions.iter().zip(&new.sources).zip(colors) {
                let there = source.position(&mesh);
                for k in 0..3 {
                    approx::assert_abs_diff_eq!(p[k], there[k], epsilon = 0.02);
                    approx::assert_abs_diff_eq!(color[k], 0.25 * there[k] + 0.5, epsilon = 1e-5);
                }
            }
            assert_eq!(remesh(&colored, &options).unwrap(), new);
        }
    }

    #[test]
    fn bad_lengths_are_refused() {
        let ball = primitives::icosphere(1);
        for edge_length in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-9] {
            let options = RemeshOptions { edge_length, passes: 1 };
            assert!(matches!(remesh(&ball, &options), Err(RemeshError::EdgeLength { .. })));
        }
        // Coarser than the shape can be: it stops while it is still a closed surface.
        let coarse = remesh(&ball, &RemeshOptions { edge_length: 50.0, passes: 5 }).unwrap();
        assert!(coarse.mesh.health().is_watertight());
    }
}
