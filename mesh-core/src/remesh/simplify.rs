//! Fewer triangles on nearly the same surface.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use nalgebra::{Matrix3, Vector3};

use super::error::RemeshError;
use super::isotropic::{Remeshed, on_surface};
use super::shape::{Bounds, keeps_shape};
use super::surface::{Surface, next};
use crate::vector::{Vec3, add, area_vector, dot, norm, scale, sub, unit, widen};
use crate::{ClosestPoint, TriMesh};

/// The share of their area that planes must weigh against a motion to say where it ends: where they
/// leave a vertex free to slide, it stays in the middle of its edge.
const FREE: f64 = 1e-3;
/// What faces must be after a collapse: no angle below 0.05. Needles, as the sides of cylinders are made of, may lose a little: their
/// angles grow again as they become fewer.
const BOUNDS: Bounds = Bounds { facing: 0.2, smallest: 0.050_041_708_375_538_8, share: 0.9 };
/// How often all edges that are left are gone through, at most.
const ROUNDS: usize = 100;

/// Takes edges out of a closed mesh until it has at most so many faces, those first that move the
/// surface least: where it is flat the triangles become large, at edges and where it bends they
/// stay.
///
/// Genus, closedness and orientation stay: a collapse that would break them, turn a face over or make a
/// sliver is not made, so a mesh may keep more faces than were asked for; what may go later goes later. Colours are those of the nearest
/// place of the old surface. Vertices that no face uses are left out. The order is fixed, so the result is the same on every machine.
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
    mesh.validate()?;
    let used;
    let mesh = if mesh.has_unused_vertices() {
        used = mesh.without_unused_vertices();
        &used
    } else {
        mesh
    };
    let mut state = State::new(mesh)?;
    let mut left = mesh.faces.len();
    for _ in 0..ROUNDS {
        let before = left;
        state.round(faces, &mut left);
        if left <= faces || left == before {
            break;
        }
    }
    Ok(on_surface(&state.surface, &state.positions, mesh, &ClosestPoint::new(mesh)))
}

/// A surface that loses its edges.
struct State {
    surface: Surface,
    positions: Vec<Vec3>,
    quadrics: Vec<Quadric>,
    /// Of each vertex how often it was moved: what was queued before is out of date.
    moved: Vec<u32>,
}

impl State {
    fn new(mesh: &TriMesh) -> Result<Self, RemeshError> {
        let surface = Surface::new(mesh)?;
        let positions: Vec<Vec3> = mesh.positions.iter().map(|&p| widen(p)).collect();
        let mut quadrics = vec![Quadric::default(); positions.len()];
        for &face in &mesh.faces {
            let corners = face.map(|v| positions[v as usize]);
            let plane = Quadric::of_plane(corners);
            for v in face {
                quadrics[v as usize].add(&plane);
            }
        }
        let moved = vec![0; positions.len()];
        Ok(Self { surface, positions, quadrics, moved })
    }

    /// Takes out each edge that may go when it is its turn; one that may not waits for the next round, since by
    /// then what is around it may have changed.
    fn round(&mut self, faces: usize, left: &mut usize) {
        let corners = 0..self.surface.corner_count();
        let is_edge = |&c: &u32| self.surface.is_alive(c) && c < self.surface.opposite(c);
        let mut queue: BinaryHeap<Collapse> =
            corners.filter(is_edge).map(|corner| Collapse::new(self, corner)).collect();
        while *left > faces {
            let Some(collapse) = queue.pop() else { break };
            let Collapse { corner, .. } = collapse;
            if !self.surface.is_alive(corner) || collapse.is_old(self) {
                continue;
            }
            let Some(kept) = self.collapse(corner) else { continue };
            *left -= 2;
            let spokes = self.surface.fan(kept).map(next);
            queue.extend(spokes.map(|corner| Collapse::new(self, corner)));
        }
    }

    /// Makes one vertex of the ends of an edge, and says which; `None` where that would do harm.
    fn collapse(&mut self, corner: u32) -> Option<u32> {
        let [b, d] = self.surface.edge(corner);
        let at = optimum(&self.quadrics, &self.positions, [b, d]);
        let keeps = |ends| keeps_shape(&self.surface, &self.positions, ends, at, BOUNDS);
        if !self.surface.can_collapse(corner) || !keeps([b, d]) || !keeps([d, b]) {
            return None;
        }
        self.surface.collapse(corner);
        self.positions[b as usize] = at;
        let other = self.quadrics[d as usize];
        self.quadrics[b as usize].add(&other);
        self.moved[b as usize] += 1;
        Some(b)
    }
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
    fn new(state: &State, corner: u32) -> Self {
        let State { surface, positions, quadrics, moved } = state;
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

    fn is_old(&self, state: &State) -> bool {
        state.surface.edge(self.corner) != self.ends
            || self.ends.map(|v| state.moved[v as usize]) != self.moved
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
    fn vertices_of_no_face_are_left_out() {
        let ball = primitives::icosphere(3);
        let mut loose = ball.clone();
        loose.positions.push([9.0; 3]);
        assert_eq!(simplify(&loose, 200), simplify(&ball, 200));
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

    /// A box with vertices on its edges that only one of the two faces there knows of; faces without area fill
    /// what is between, as programs for construction write it.
    fn filled_box(parts: u32) -> TriMesh {
        let mut mesh = primitives::cuboid([1.0, 2.0, 3.0]);
        for face in 0..mesh.faces.len() {
            let [p, q, r] = mesh.faces[face];
            let [from, to] = [p, q].map(|v| widen(mesh.positions[v as usize]));
            let mut last = p;
            for k in 1..parts {
                let share = f64::from(k) / f64::from(parts);
                let new = mesh.positions.len() as u32;
                let at = add(scale(from, 1.0 - share), scale(to, share));
                mesh.positions.push(crate::vector::narrow(at));
                mesh.faces.push([last, new, r]);
                if last != p {
                    mesh.faces.push([p, new, last]);
                }
                last = new;
            }
            mesh.faces[face] = [last, q, r];
            mesh.faces.push([p, q, last]);
        }
        mesh
    }

    #[test]
    fn faces_without_area_go() {
        for parts in [2, 3, 4, 7] {
            let filled = filled_box(parts);
            let health = filled.health();
            assert!(health.is_watertight() && filled.faces.len() > 12, "{health}");
            let coarse = simplify(&filled, 12).unwrap().mesh;
            assert_eq!(coarse.faces.len(), 12, "{parts} parts");
            approx::assert_relative_eq!(coarse.volume(), 6.0, max_relative = 1e-6);
            assert!(coarse.health().is_watertight());
            assert_eq!(coarse, simplify(&filled, 12).unwrap().mesh);
        }
    }

    #[test]
    fn what_could_not_go_is_tried_again() {
        let pressed = primitives::icosphere(4).scaled([0.01, 2.0, 1.0]);
        let coarse = simplify(&pressed, 40).unwrap().mesh;
        assert_eq!(coarse.faces.len(), 40);
        assert!(coarse.health().is_watertight());
        assert_eq!(coarse, simplify(&pressed, 40).unwrap().mesh);
    }

    #[test]
    fn needles_become_fewer_and_wider() {
        let mesh = primitives::cylinder(1.0, 4.0, 64);
        let coarse = simplify(&mesh, 100).unwrap().mesh;
        assert_eq!(coarse.faces.len(), 100);
        let [before, after] = [&mesh, &coarse].map(TriMesh::health);
        assert!(after.smallest_angle_degrees > before.smallest_angle_degrees, "{after}");
        approx::assert_relative_eq!(after.volume, before.volume, max_relative = 0.005);
    }

    #[test]
    fn colors_follow_and_nothing_is_asked_too_much() {
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
