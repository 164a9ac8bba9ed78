//! Fewer triangles on nearly the same surface.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use nalgebra::{Matrix3, Vector3};

use super::error::RemeshError;
use super::isotropic::{Remeshed, on_surface};
use super::shape::keeps_shape;
use super::surface::{Surface, next};
use crate::vector::{Vec3, add, area_vector, dot, norm, scale, sub, unit, widen};
use crate::{ClosestPoint, TriMesh};

/// The share of their area that planes must weigh against a motion to say where it ends: where they
/// leave a vertex free to slide, it stays in the middle of its edge.
const FREE: f64 = 1e-3;
/// Cosine of the most that a face may turn in a collapse, and the smallest angle that it may get, radians.
const LEAST: [f64; 2] = [0.2, 0.05];

/// Takes edges out of a closed mesh until it has at most so many faces, those first that move the
/// surface least: where it is flat the triangles become large, at edges and where it bends they
/// stay.
///
/// Genus, closedness and orientation stay: a collapse that would break them, or turn a face over, is
/// not made, so a mesh may keep more faces than were asked for. Colours are those of the nearest
/// place of the old surface. The order is fixed, so the result is the same on every machine.
///
/// ```
/// use mesh_core::{primitives, simplify};
///
/// let ball = primitives::icosphere(5);
/// let coarse = simplify(&ball, 1000)?.mesh;
/// assert_eq!(coarse.faces.len(), 1000);
/// assert!(coarse.health().is_watertight() && coarse.volume() > 0.99 * ball.volume());
/// # Ok::<(), mesh_core::RemeshError>(())
/// ```
///
/// # Cost
/// Some 10 microseconds for each face that goes.
///
/// # Errors
/// If the mesh is not a closed, oriented manifold, or has a texture.
///
/// # References
/// Garland and Heckbert 1997, *Surface Simplification Using Quadric Error Metrics*, with areas as
/// weights.
pub fn simplify(mesh: &TriMesh, faces: usize) -> Result<Remeshed, RemeshError> {
    let mut surface = Surface::new(mesh)?;
    let mut positions: Vec<Vec3> = mesh.positions.iter().map(|&p| widen(p)).collect();
    let mut quadrics = vec![Quadric::default(); positions.len()];
    for &face in &mesh.faces {
        let corners = face.map(|v| positions[v as usize]);
        let plane = Quadric::of_plane(corners);
        for v in face {
            quadrics[v as usize].add(&plane);
        }
    }
    let mut left = mesh.faces.len();
    // Of each vertex how often it was moved: what was queued before is out of date.
    let mut moved = vec![0_u32; positions.len()];
    let mut queue = BinaryHeap::new();
    for corner in (0..surface.corner_count()).filter(|&c| c < surface.opposite(c)) {
        queue.push(Collapse::new(&surface, &positions, &quadrics, &moved, corner));
    }
    while left > faces {
        let Some(collapse) = queue.pop() else { break };
        let Collapse { corner, .. } = collapse;
        if !surface.is_alive(corner) || collapse.is_old(&surface, &moved) {
            continue;
        }
        let [b, d] = surface.edge(corner);
        let at = optimum(&quadrics, &positions, [b, d]);
        if !surface.can_collapse(corner)
            || !keeps_shape(&surface, &positions, [b, d], at, LEAST)
            || !keeps_shape(&surface, &positions, [d, b], at, LEAST)
        {
            continue;
        }
        surface.collapse(corner);
        left -= 2;
        positions[b as usize] = at;
        let other = quadrics[d as usize];
        quadrics[b as usize].add(&other);
        moved[b as usize] += 1;
        let spokes: Vec<u32> = surface.fan(b).map(next).collect();
        queue.extend(
            spokes.into_iter().map(|c| Collapse::new(&surface, &positions, &quadrics, &moved, c)),
        );
    }
    Ok(on_surface(&surface, &positions, mesh, &ClosestPoint::new(mesh)))
}

/// The sum of squared distances from planes, `x A x + 2 b x + c`, each weighted by its area.
#[derive(Clone, Copy, Debug, Default)]
struct Quadric {
    /// `A` by its upper triangle: xx, xy, xz, yy, yz, zz.
    a: [f64; 6],
    b: Vec3,
    c: f64,
    area: f64,
}

impl Quadric {
    fn of_plane(corners: [Vec3; 3]) -> Self {
        let twice = area_vector(corners);
        let (normal, area) = (unit(twice), 0.5 * norm(twice));
        let [x, y, z] = normal;
        let offset = -dot(normal, corners[0]);
        Self {
            a: [x * x, x * y, x * z, y * y, y * z, z * z].map(|v| area * v),
            b: scale(normal, area * offset),
            c: area * offset * offset,
            area,
        }
    }

    fn add(&mut self, other: &Self) {
        self.a.iter_mut().zip(other.a).for_each(|(a, b)| *a += b);
        self.b = add(self.b, other.b);
        self.c += other.c;
        self.area += other.area;
    }

    /// The sum at a point; rounding may not make it negative.
    fn at(&self, p: Vec3) -> f64 {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        let [x, y, z] = p;
        let square = xx * x * x + yy * y * y + zz * z * z;
        let mixed = 2.0 * (xy * x * y + xz * x * z + yz * y * z);
        (square + mixed + 2.0 * dot(self.b, p) + self.c).max(0.0)
    }
}

/// Where the vertex that an edge becomes moves the surface least.
fn optimum(quadrics: &[Quadric], positions: &[Vec3], [b, d]: [u32; 2]) -> Vec3 {
    let mut sum = quadrics[b as usize];
    sum.add(&quadrics[d as usize]);
    let middle = scale(add(positions[b as usize], positions[d as usize]), 0.5);
    let [xx, xy, xz, yy, yz, zz] = sum.a;
    let planes = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    // Around the middle, so that nothing cancels far from the origin; only along directions that the
    // planes decide.
    let gradient = planes * Vector3::from(middle) + Vector3::from(sum.b);
    let eigen = planes.symmetric_eigen();
    let mut at = middle;
    for (value, axis) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        if *value > FREE * sum.area {
            let step = axis.dot(&gradient) / value;
            at = sub(at, [step * axis.x, step * axis.y, step * axis.z]);
        }
    }
    at
}

/// An edge that may be taken out, the cheapest of which is the greatest.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Collapse {
    /// The bits of a number that is not negative are in its order; of equals the lowest corner comes first.
    cost: Reverse<u64>,
    order: Reverse<u32>,
    corner: u32,
    ends: [u32; 2],
    moved: [u32; 2],
}

impl Collapse {
    fn new(
        surface: &Surface,
        positions: &[Vec3],
        quadrics: &[Quadric],
        moved: &[u32],
        corner: u32,
    ) -> Self {
        let ends = surface.edge(corner);
        let at = optimum(quadrics, positions, ends);
        let cost: f64 = ends.iter().map(|&v| quadrics[v as usize].at(at)).sum();
        Self {
            cost: Reverse(cost.to_bits()),
            order: Reverse(corner),
            corner,
            ends,
            moved: ends.map(|v| moved[v as usize]),
        }
    }

    fn is_old(&self, surface: &Surface, moved: &[u32]) -> bool {
        surface.edge(self.corner) != self.ends || self.ends.map(|v| moved[v as usize]) != self.moved
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::primitives;

    #[test]
    fn fewer_faces_on_the_same_closed_surface() {
        for (mesh, faces, genus, far) in [
            (primitives::icosphere(5), 2000, 0, 0.01),
            (primitives::torus(1.0, 0.4, 96, 48), 1500, 1, 0.02),
            (primitives::icosphere(5).scaled([0.1, 2.0, 1.0]), 800, 0, 0.03),
        ] {
            let coarse = simplify(&mesh, faces).unwrap();
            let health = coarse.mesh.health();
            assert_eq!(coarse.mesh.faces.len(), faces);
            assert!(health.is_watertight(), "{health}");
            assert_eq!(health.genus(), Some(genus));
            approx::assert_relative_eq!(health.volume, mesh.health().volume, max_relative = 0.02);
            let old = ClosestPoint::new(&mesh);
            let worst = coarse.mesh.positions.iter().map(|&p| old.find(p).unwrap().distance);
            assert!(worst.fold(0.0, f64::max) < far);
            assert_eq!(coarse, simplify(&mesh, faces).unwrap(), "the same each time");
        }
    }

    #[test]
    fn flats_and_edges_of_a_box_stay_exact() {
        // Far from the origin, where squares of coordinates lose their digits.
        let mut fine = primitives::cuboid([1.0, 2.0, 3.0]).translated([1e3, 0.0, 0.0]);
        for _ in 0..4 {
            fine = crate::subdivide(&fine);
        }
        let coarse = simplify(&fine, 12).unwrap().mesh;
        assert_eq!(coarse.faces.len(), 12);
        approx::assert_relative_eq!(coarse.volume(), 6.0, max_relative = 1e-3);
    }

    #[test]
    fn colours_follow_and_nothing_is_asked_too_much() {
        let mut ball = primitives::icosphere(4);
        ball.colors = Some(ball.positions.iter().map(|p| p.map(|x| 0.5 + 0.5 * x)).collect());
        let coarse = simplify(&ball, 300).unwrap().mesh;
        for (p, c) in coarse.positions.iter().zip(coarse.colors.as_ref().unwrap()) {
            for k in 0..3 {
                approx::assert_abs_diff_eq!(c[k], 0.5 + 0.5 * p[k], epsilon = 0.03);
            }
        }
        // No closed surface has fewer than four faces, and none is made of nothing.
        let least = simplify(&ball, 0).unwrap().mesh;
        assert!(least.faces.len() >= 4 && least.health().is_watertight());
        assert_eq!(simplify(&ball, 1_000_000).unwrap().mesh.faces.len(), ball.faces.len());
        let open = TriMesh::new(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2]]);
        assert!(matches!(simplify(&open, 1), Err(RemeshError::NotClosed { .. })));
    }
}
