//! Rays that meet a surface, and on which side of it a point is.

use super::{ClosestPoint, Node};
use crate::SurfacePoint;
use crate::inside::winding;
use crate::vector::{Vec3, cross, dot, sub, widen};

/// Where a ray meets a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Hit {
    /// The place, as weights on a face; of faces that are met equally far away, to the last digit, the lowest.
    pub point: SurfacePoint,
    /// How far along the ray, in lengths of its direction.
    pub along: f64,
}

impl ClosestPoint {
    /// The first place where a ray from `origin` along `direction` meets the surface, from either side; `None` where it meets
    /// none. It does not pass between two faces that share an edge; one that runs along a face's plane passes that face.
    ///
    /// ```
    /// use mesh_core::{ClosestPoint, primitives};
    /// let cube = ClosestPoint::new(&primitives::cuboid([2.0; 3]));
    /// let hit = cube.first_hit([0.2, 0.3, 5.0], [0.0, 0.0, -2.0]).ok_or("it is missed")?;
    /// assert_eq!(hit.along, 2.0);
    /// assert!(cube.first_hit([0.2, 0.3, 5.0], [0.0, 0.0, 1.0]).is_none());
    /// # Ok::<(), &str>(())
    /// ```
    ///
    /// # Cost
    /// `O(log F)` for most rays.
    pub fn first_hit(&self, origin: Vec3, direction: Vec3) -> Option<Hit> {
        if !origin.iter().chain(&direction).all(|x| x.is_finite()) || self.nodes.is_empty() {
            return None;
        }
        let mut best: Option<(f64, u32, Vec3)> = None;
        let entered = |k: usize| Some((self.nodes[k].entry(origin, direction)?, k));
        let mut open: Vec<(f64, usize)> = entered(0).into_iter().collect();
        while let Some((entry, index)) = open.pop() {
            // Boxes are met with rounding, and of equals the lowest face counts.
            if best.is_some_and(|best| entry > best.0 * (1.0 + 1e-12)) {
                continue;
            }
            let node = &self.nodes[index];
            for slot in node.first as usize..node.last as usize {
                let Some((along, weights)) = met(self.corners[slot], origin, direction) else {
                    continue;
                };
                let name = self.names[slot];
                if best.is_none_or(|best| (along, name) < (best.0, best.1)) {
                    best = Some((along, name, weights));
                }
            }
            if node.first == node.last {
                let mut next = [node.right as usize, index + 1].map(entered);
                // The nearer one is looked at first, for what it holds may spare the other: it is pushed last.
                if next[0].map(|(entry, _)| entry) < next[1].map(|(entry, _)| entry) {
                    next.swap(0, 1);
                }
                open.extend(next.into_iter().flatten());
            }
        }
        best.map(|(along, face, weights)| {
            let barycentric = weights.map(|w| w as f32);
            Hit { point: SurfacePoint { face, barycentric }, along }
        })
    }

    /// How far a point is from a closed surface, negative inside; `None` without faces, or if `p` is not finite.
    ///
    /// Inside is where the surface goes around the point more than half a time, either way: that holds where it has small holes
    /// too, and where pieces overlap.
    ///
    /// ```
    /// use mesh_core::{ClosestPoint, primitives};
    /// let cube = ClosestPoint::new(&primitives::cuboid([2.0; 3]));
    /// assert_eq!(cube.signed_distance([0.1, 0.2, 0.75]), Some(-0.25));
    /// assert_eq!(cube.signed_distance([0.1, 0.2, 3.0]), Some(2.0));
    /// ```
    ///
    /// # Cost
    /// `O(F)`, for the side; see [`TriMesh::winding_number`](crate::TriMesh::winding_number).
    pub fn signed_distance(&self, p: [f32; 3]) -> Option<f64> {
        let distance = self.find(p)?.distance;
        let turns = winding(self.corners.iter().copied(), widen(p));
        Some(if turns.abs() > 0.5 { -distance } else { distance })
    }
}

impl Node {
    /// Where a ray comes into the box, 0 where it begins inside.
    fn entry(&self, origin: Vec3, direction: Vec3) -> Option<f64> {
        let (mut first, mut last) = (0.0_f64, f64::INFINITY);
        for k in 0..3 {
            if direction[k] == 0.0 {
                if origin[k] < self.low[k] || origin[k] > self.high[k] {
                    return None;
                }
                continue;
            }
            let [a, b] = [self.low[k], self.high[k]].map(|x| (x - origin[k]) / direction[k]);
            (first, last) = (first.max(a.min(b)), last.min(a.max(b)));
        }
        // A flat box that is met at a slant has its two ends at one place, but for the last digits.
        (first <= last * (1.0 + 1e-12)).then_some(first)
    }
}

/// Where a ray meets a triangle, and the weights of the corners there.
///
/// On which side of an edge the ray passes has the same digits for both faces of the edge, so it passes none between them.
fn met(corners: [Vec3; 3], origin: Vec3, direction: Vec3) -> Option<(f64, Vec3)> {
    let [a, b, c] = corners.map(|p| sub(p, origin));
    let sides = [(b, c), (c, a), (a, b)].map(|(p, q)| dot(direction, cross(p, q)));
    if sides.iter().any(|&s| s < 0.0) && sides.iter().any(|&s| s > 0.0) {
        return None;
    }
    let sum: f64 = sides.iter().sum();
    let weights = sides.map(|s| s / sum);
    let reach = [a, b, c].map(|p| dot(p, direction));
    let along = dot(weights, reach) / dot(direction, direction);
    // Not a number where the ray runs along the plane.
    (sum != 0.0 && along >= 0.0 && along.is_finite()).then_some((along, weights))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::vector::triangle;
    use crate::{TriMesh, primitives};

    fn noise(i: u32, k: u32) -> f64 {
        let bits = (i * 6 + k).wrapping_mul(2_654_435_761).wrapping_add(k * 40_503) >> 7;
        f64::from(bits % 1000) / 250.0 - 2.0
    }

    #[test]
    fn the_tree_finds_what_all_faces_find() {
        let mesh = primitives::torus(1.0, 0.4, 17, 11);
        let tree = ClosestPoint::new(&mesh);
        let mut hits = 0;
        for i in 0..500 {
            let origin: Vec3 = std::array::from_fn(|k| noise(i, k as u32));
            let direction: Vec3 = std::array::from_fn(|k| noise(i, 3 + k as u32));
            let found = tree.first_hit(origin, direction);
            let all = mesh.faces.iter().filter_map(|&face| {
                met(triangle(&mesh.positions, face), origin, direction).map(|hit| hit.0)
            });
            let expected = all.fold(f64::INFINITY, f64::min);
            assert_eq!(found.map_or(f64::INFINITY, |hit| hit.along), expected);
            if let Some(hit) = found {
                hits += 1;
                let at = widen(hit.point.position(&mesh));
                for k in 0..3 {
                    let on_ray = origin[k] + hit.along * direction[k];
                    approx::assert_abs_diff_eq!(at[k], on_ray, epsilon = 1e-5);
                }
            }
        }
        assert!((50..450).contains(&hits), "{hits}");
    }

    #[test]
    fn rays_through_edges_and_corners_do_not_slip_through() {
        let cube = ClosestPoint::new(&primitives::cuboid([2.0; 3]));
        for direction in [[1.0, 1.0, 1.0], [1.0, 1.0, 0.0], [1.0, 0.0, 0.0], [-1.0, 1.0, 0.3]] {
            let hit = cube.first_hit([0.0; 3], direction).unwrap();
            approx::assert_abs_diff_eq!(hit.along, 1.0, epsilon = 1e-12);
        }
        // From every vertex of a ball through its middle to the other side.
        let ball = primitives::icosphere(2);
        let tree = ClosestPoint::new(&ball);
        for &p in &ball.positions {
            let p = widen(p);
            assert!(tree.first_hit(p.map(|x| -2.0 * x), p).is_some(), "{p:?}");
        }
        assert_eq!(cube.first_hit([0.0; 3], [0.0; 3]), None);
        assert_eq!(cube.first_hit([0.0; 3], [f64::NAN, 1.0, 0.0]), None);
        assert_eq!(ClosestPoint::new(&TriMesh::default()).first_hit([0.0; 3], [1.0; 3]), None);
    }

    #[test]
    fn sides() {
        let ball = ClosestPoint::new(&primitives::icosphere(3).flipped());
        for (x, inside) in [(0.0, true), (0.9, true), (1.1, false), (5.0, false)] {
            let found = ball.signed_distance([x, 0.1, 0.0]).unwrap();
            assert_eq!(found < 0.0, inside, "{x}");
            let expected = f64::from(x).hypot(0.1) - 1.0;
            assert!((found - expected).abs() < 0.02, "{x}: {found}");
        }
        assert_eq!(ball.signed_distance([f32::NAN; 3]), None);
    }
}
