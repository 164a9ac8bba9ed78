//! The point of a surface that is closest to a given point.

mod cast;

pub use cast::Hit;

use crate::vector::{Vec3, add, cross, dot, scale, sub, triangle, widen};
use crate::{Scalar, SurfacePoint, TriMesh};

/// A mesh's faces in a tree of boxes, to be asked for closest points.
///
/// ```
/// use mesh_core::{ClosestPoint, primitives};
/// let cube = primitives::cuboid([2.0; 3]);
/// let found = ClosestPoint::new(&cube).find([0.3, 0.2, 5.0]).unwrap();
/// assert_eq!(found.distance, 4.0);
/// let [x, y, z] = found.point.position(&cube);
/// assert!((x - 0.3).abs() < 1e-6 && (y - 0.2).abs() < 1e-6 && z == 1.0);
/// ```
#[derive(Clone, Debug)]
pub struct ClosestPoint {
    /// Corners of the faces, in the order of the tree's leaves.
    corners: Vec<[Vec3; 3]>,
    /// The face that each belongs to.
    names: Vec<u32>,
    /// Depth first; the second child of an inner node is at `right`.
    nodes: Vec<Node>,
}

#[derive(Clone, Debug)]
struct Node {
    low: Vec3,
    high: Vec3,
    /// Faces `first..last` of a leaf; empty for an inner node.
    first: u32,
    last: u32,
    right: u32,
}

/// The closest point of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Closest {
    /// Where it is, as weights on a face; of equally close faces the lowest.
    pub point: SurfacePoint,
    /// How far it is.
    pub distance: f64,
}

/// Faces in a leaf.
const LEAF: usize = 4;

impl ClosestPoint {
    /// Builds the tree, `O(F log F)`. Faces with coordinates that are not finite are left out.
    ///
    /// # Panics
    /// If a face names a vertex that does not exist.
    pub fn new(mesh: &TriMesh) -> Self {
        Self::of(&mesh.positions, &mesh.faces)
    }

    /// [`new`](Self::new) of faces between positions of either precision.
    ///
    /// # Panics
    /// If a face names a vertex that does not exist.
    pub fn of<T: Scalar>(positions: &[[T; 3]], all: &[[u32; 3]]) -> Self {
        let (mut faces, mut corners) = (Vec::new(), Vec::new());
        for (name, &face) in all.iter().enumerate() {
            let at = triangle(positions, face);
            if at.iter().flatten().all(|x| x.is_finite()) {
                faces.push((name as u32, at));
            }
        }
        let mut nodes = Vec::new();
        if !faces.is_empty() {
            grow(&mut faces, 0, &mut nodes);
        }
        corners.extend(faces.iter().map(|face| face.1));
        Self { corners, names: faces.into_iter().map(|face| face.0).collect(), nodes }
    }

    /// The point of the surface closest to `p`; `None` without faces, or if `p` is not finite.
    pub fn find(&self, p: [f32; 3]) -> Option<Closest> {
        self.find_wide(widen(p))
    }

    /// [`find`](Self::find) in double precision.
    pub fn find_wide(&self, p: Vec3) -> Option<Closest> {
        if !p.iter().all(|x| x.is_finite()) || self.nodes.is_empty() {
            return None;
        }
        let mut best = (f64::INFINITY, u32::MAX, [0.0; 3]);
        let mut open = vec![(self.nodes[0].squared_distance(p), 0_usize)];
        while let Some((bound, index)) = open.pop() {
            if bound > best.0 {
                continue;
            }
            let node = &self.nodes[index];
            for slot in node.first as usize..node.last as usize {
                let weights = closest_weights(self.corners[slot], p);
                let away = sub(blend(self.corners[slot], weights), p);
                let squared = dot(away, away);
                if squared < best.0 || (squared == best.0 && self.names[slot] < best.1) {
                    best = (squared, self.names[slot], weights);
                }
            }
            if node.first == node.last {
                let children = [index + 1, node.right as usize];
                let mut next = children.map(|i| (self.nodes[i].squared_distance(p), i));
                // The nearer one is looked at first: it is pushed last.
                if next[0].0 < next[1].0 {
                    next.swap(0, 1);
                }
                open.extend(next);
            }
        }
        let barycentric = best.2.map(|w| w as f32);
        Some(Closest { point: SurfacePoint { face: best.1, barycentric }, distance: best.0.sqrt() })
    }
}

impl Node {
    fn squared_distance(&self, p: Vec3) -> f64 {
        (0..3).map(|k| (self.low[k] - p[k]).max(p[k] - self.high[k]).max(0.0).powi(2)).sum()
    }
}

/// Orders `faces` into a tree below a new node; `start` is where they begin among all.
fn grow(faces: &mut [(u32, [Vec3; 3])], start: usize, nodes: &mut Vec<Node>) {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for p in faces.iter().flat_map(|face| &face.1) {
        for k in 0..3 {
            low[k] = low[k].min(p[k]);
            high[k] = high[k].max(p[k]);
        }
    }
    let node = nodes.len();
    let last = if faces.len() <= LEAF { start + faces.len() } else { start };
    nodes.push(Node { low, high, first: start as u32, last: last as u32, right: 0 });
    if faces.len() > LEAF {
        let longer = |&i: &usize, &j: &usize| (high[i] - low[i]).total_cmp(&(high[j] - low[j]));
        let axis = (0..3).max_by(longer).unwrap_or(0);
        let half = faces.len() / 2;
        let middle = |face: &(u32, [Vec3; 3])| face.1.iter().map(|p| p[axis]).sum::<f64>();
        faces.select_nth_unstable_by(half, |a, b| {
            middle(a).total_cmp(&middle(b)).then(a.0.cmp(&b.0))
        });
        let (left, right) = faces.split_at_mut(half);
        grow(left, start, nodes);
        nodes[node].right = nodes.len() as u32;
        grow(right, start + half, nodes);
    }
}

fn blend([a, b, c]: [Vec3; 3], w: Vec3) -> Vec3 {
    add(scale(a, w[0]), add(scale(b, w[1]), scale(c, w[2])))
}

/// Weights of the corners of the point of a triangle that is closest to `p`.
///
/// Inside the three planes through the sides, upright on the triangle, it is the foot of the normal;
/// else the closest point of a side. A triangle without area has sides only.
///
/// ```
/// use mesh_core::closest_weights;
/// let corners = [[0.0; 3], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]];
/// assert_eq!(closest_weights(corners, [0.5, 0.5, 3.0]), [0.5, 0.25, 0.25]);
/// assert_eq!(closest_weights(corners, [9.0, -1.0, 0.0]), [0.0, 1.0, 0.0]);
/// ```
pub fn closest_weights(corners: [Vec3; 3], p: Vec3) -> Vec3 {
    let [a, b, c] = corners;
    let normal = cross(sub(b, a), sub(c, a));
    let square = dot(normal, normal);
    if square > 0.0 {
        let area = |u: Vec3, v: Vec3| dot(cross(sub(u, p), sub(v, p)), normal) / square;
        let weights = [area(b, c), area(c, a), area(a, b)];
        if weights.iter().all(|&w| w >= 0.0) {
            let sum: f64 = weights.iter().sum();
            return weights.map(|w| w / sum);
        }
    }
    let mut best = (f64::INFINITY, [1.0, 0.0, 0.0]);
    for i in 0..3 {
        let j = (i + 1) % 3;
        let side = sub(corners[j], corners[i]);
        let length = dot(side, side);
        let along = if length > 0.0 { dot(sub(p, corners[i]), side) / length } else { 0.0 };
        let t = along.clamp(0.0, 1.0);
        let away = sub(add(corners[i], scale(side, t)), p);
        let squared = dot(away, away);
        if squared < best.0 {
            let mut weights = [0.0; 3];
            weights[i] = 1.0 - t;
            weights[j] = t;
            best = (squared, weights);
        }
    }
    best.1
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::{primitives, vector::norm};

    #[test]
    fn by_region_of_one_triangle() {
        let corners = [[0.0; 3], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]];
        for (p, expected) in [
            ([0.5, 0.5, 3.0], [0.5, 0.25, 0.25]),
            ([-1.0, -1.0, 1.0], [1.0, 0.0, 0.0]),
            ([1.0, -1.0, 0.0], [0.5, 0.5, 0.0]),
            ([2.0, 2.0, 1.0], [0.0, 0.5, 0.5]),
            ([5.0, -1.0, 0.0], [0.0, 1.0, 0.0]),
        ] {
            let found = closest_weights(corners, p);
            for k in 0..3 {
                approx::assert_abs_diff_eq!(found[k], expected[k], epsilon = 1e-12);
            }
        }
        assert_eq!(closest_weights([[1.0; 3]; 3], [0.0; 3]), [1.0, 0.0, 0.0]);
    }

    #[test]
    fn the_tree_finds_what_all_faces_find() {
        let mesh = primitives::torus(1.0, 0.4, 17, 11);
        let tree = ClosestPoint::new(&mesh);
        for i in 0..300_u32 {
            let p: [f32; 3] = std::array::from_fn(|k| {
                let bits = i.wrapping_mul(2_654_435_761).wrapping_add(k as u32 * 40_503) >> 7;
                (bits % 1000) as f32 / 250.0 - 2.0
            });
            let found = tree.find(p).unwrap();
            let expected = mesh
                .faces
                .iter()
                .map(|&face| {
                    let corners = triangle(&mesh.positions, face);
                    norm(sub(blend(corners, closest_weights(corners, widen(p))), widen(p)))
                })
                .fold(f64::INFINITY, f64::min);
            assert_eq!(found.distance, expected);
            let at = widen(found.point.position(&mesh));
            approx::assert_abs_diff_eq!(norm(sub(at, widen(p))), expected, epsilon = 1e-5);
        }
        assert_eq!(tree.find([f32::NAN; 3]), None);
        assert_eq!(ClosestPoint::new(&TriMesh::default()).find([0.0; 3]), None);
    }
}
