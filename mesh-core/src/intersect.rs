//! Self-intersections of a mesh, decided in exact arithmetic.

use crate::TriMesh;
use crate::kernels::threads;

/// A point in the integers that all tests are made in.
type Point = [i64; 3];

/// Coordinates are scaled by a power of two to at most `2^40`; see [`orient`].
const BITS: i32 = 40;
/// Faces whose partners are looked for in one parallel task.
const CHUNK: usize = 256;
/// Faces in a leaf of the tree.
const LEAF: usize = 4;

impl TriMesh {
    /// The pairs of faces that pass through each other, sorted, the smaller index first.
    ///
    /// Faces that merely touch do not count, at shared corners and edges or elsewhere; corners at
    /// the same position are the same corner, so a mesh that is cut along its texture's seams is
    /// treated as the closed surface that it is. Faces that share an edge count only when they are
    /// folded flat onto each other; faces that share a corner when they cross beyond it; faces in
    /// one plane when they overlap. Faces that are not valid or have no area are left out.
    ///
    /// The answer is exact for the positions rounded to `2^-40` of the largest coordinate, which
    /// leaves all but the smallest coordinates as they are.
    ///
    /// # Cost
    /// `O(F log F)` and the pairs whose boxes overlap: some 20 ms for 20,000 faces.
    pub fn self_intersections(&self) -> Vec<[u32; 2]> {
        let Some(faces) = Faces::of(self) else { return Vec::new() };
        let tree = Tree::new(&faces);
        let chunks = threads::map(faces.corners.len().div_ceil(CHUNK), |chunk| {
            let mut found = Vec::new();
            let last = (chunk * CHUNK + CHUNK).min(faces.corners.len());
            for face in chunk * CHUNK..last {
                tree.visit(&faces.boxes[face], |other| {
                    if other > face && cross(&faces.corners[face], &faces.corners[other]) {
                        found.push([faces.names[face], faces.names[other]]);
                    }
                });
            }
            found
        });
        let mut pairs = chunks.concat();
        pairs.sort_unstable();
        pairs
    }
}

/// The valid faces of a mesh, in integers.
struct Faces {
    names: Vec<u32>,
    corners: Vec<[Point; 3]>,
    boxes: Vec<[Point; 2]>,
}

impl Faces {
    fn of(mesh: &TriMesh) -> Option<Self> {
        let finite = |p: &[f32; 3]| p.iter().all(|x| x.is_finite());
        let largest = mesh
            .positions
            .iter()
            .filter(|p| finite(p))
            .flatten()
            .fold(0.0_f64, |largest, &x| largest.max(f64::from(x).abs()));
        if largest == 0.0 {
            return None;
        }
        // Two steps, since the power alone may be beyond what f64 can hold for tiny meshes.
        let shift = BITS - 1 - largest.log2().floor() as i32;
        let (half, rest) = (2.0_f64.powi(shift / 2), 2.0_f64.powi(shift - shift / 2));
        let snap = |p: [f32; 3]| p.map(|x| (f64::from(x) * half * rest).round() as i64);
        let mut faces = Self { names: Vec::new(), corners: Vec::new(), boxes: Vec::new() };
        for (name, face) in mesh.faces.iter().enumerate() {
            let corners = face.map(|v| mesh.positions.get(v as usize).filter(|p| finite(p)));
            let [Some(&a), Some(&b), Some(&c)] = corners else { continue };
            let corners = [a, b, c].map(snap);
            if normal(&corners) == [0; 3] {
                continue;
            }
            faces.names.push(name as u32);
            faces.boxes.push([
                std::array::from_fn(|k| corners.iter().map(|p| p[k]).fold(i64::MAX, i64::min)),
                std::array::from_fn(|k| corners.iter().map(|p| p[k]).fold(i64::MIN, i64::max)),
            ]);
            faces.corners.push(corners);
        }
        Some(faces)
    }
}

fn sub(a: Point, b: Point) -> Point {
    std::array::from_fn(|k| a[k] - b[k])
}

fn normal(&[a, b, c]: &[Point; 3]) -> [i128; 3] {
    let (u, v) = (sub(b, a).map(i128::from), sub(c, a).map(i128::from));
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
}

/// The sign of the volume of the tetrahedron `a, b, c, d`, exactly.
///
/// Differences have 41 bits and a sign, so their products of three and the sum of six of those
/// stay below `2^127`. Nearly always `f64` is enough to know the sign: the differences are exact in
/// it, and the rounding of the products is bounded by a few units in the last place of the largest.
fn orient(a: Point, b: Point, c: Point, d: Point) -> i32 {
    let (u, v, w) = (sub(b, a), sub(c, a), sub(d, a));
    let [x, y, z] = [u, v, w].map(|p| p.map(|x| x as f64));
    let minors = [y[1] * z[2], y[2] * z[1], y[2] * z[0], y[0] * z[2], y[0] * z[1], y[1] * z[0]];
    let value = x[0] * (minors[0] - minors[1])
        + x[1] * (minors[2] - minors[3])
        + x[2] * (minors[4] - minors[5]);
    let size = x[0].abs() * (minors[0].abs() + minors[1].abs())
        + x[1].abs() * (minors[2].abs() + minors[3].abs())
        + x[2].abs() * (minors[4].abs() + minors[5].abs());
    if value.abs() > 16.0 * f64::EPSILON * size {
        return if value > 0.0 { 1 } else { -1 };
    }
    let [x, y, z] = [u, v, w].map(|p| p.map(i128::from));
    let exact = x[0] * (y[1] * z[2] - y[2] * z[1])
        + x[1] * (y[2] * z[0] - y[0] * z[2])
        + x[2] * (y[0] * z[1] - y[1] * z[0]);
    exact.signum() as i32
}

/// Whether two triangles pass through each other or overlap in one plane.
fn cross(a: &[Point; 3], b: &[Point; 3]) -> bool {
    // On which side of the other's plane each corner is.
    let sides_a = a.map(|p| orient(b[0], b[1], b[2], p));
    if sides_a.iter().all(|&s| s > 0) || sides_a.iter().all(|&s| s < 0) {
        return false;
    }
    if sides_a == [0; 3] {
        return overlap(a, b);
    }
    let sides_b = b.map(|p| orient(a[0], a[1], a[2], p));
    // Two triangles that pass through each other share a segment of a line. Each end of it is where
    // a side of one runs through the other, or a corner of one on the other; one end of the first
    // kind is enough to know.
    if pierces(a, &sides_a, b) || pierces(b, &sides_b, a) {
        return true;
    }
    // Both ends are corners: one of each triangle, whose other corners are on both sides.
    match (corner_between(a, &sides_a), corner_between(b, &sides_b)) {
        (Some(p), Some(q)) => p != q && holds(b, p) && holds(a, q),
        _ => false,
    }
}

/// The corner on the other's plane, if the other two corners are on either side of it.
fn corner_between(a: &[Point; 3], sides: &[i32; 3]) -> Option<Point> {
    let between = |i: usize| sides[i] == 0 && sides[(i + 1) % 3] * sides[(i + 2) % 3] < 0;
    (0..3).find(|&i| between(i)).map(|i| a[i])
}

/// Whether a point in the plane of a triangle is in the triangle or on its border.
fn holds(triangle: &[Point; 3], p: Point) -> bool {
    let axes = flat_axes(triangle);
    let corners = triangle.map(|p| flatten(p, axes));
    let p = flatten(p, axes);
    let sides = [0, 1, 2].map(|i| side(corners[i], corners[(i + 1) % 3], p).signum());
    sides.iter().all(|&s| s >= 0) || sides.iter().all(|&s| s <= 0)
}

/// The two axes that a triangle's plane is seen best along: those that its normal points least to.
fn flat_axes(triangle: &[Point; 3]) -> [usize; 2] {
    let normal = normal(triangle);
    let drop = (0..3).max_by_key(|&k| normal[k].unsigned_abs()).unwrap_or(0);
    [(drop + 1) % 3, (drop + 2) % 3]
}

fn flatten(p: Point, [x, y]: [usize; 2]) -> [i128; 2] {
    [i128::from(p[x]), i128::from(p[y])]
}

/// Whether a side of `a` runs through `b` from one side of its plane to the other.
fn pierces(a: &[Point; 3], sides: &[i32; 3], b: &[Point; 3]) -> bool {
    (0..3).any(|i| {
        let j = (i + 1) % 3;
        sides[i] * sides[j] < 0 && {
            let around = [0, 1, 2].map(|k| orient(a[i], a[j], b[k], b[(k + 1) % 3]));
            around.iter().all(|&s| s >= 0) || around.iter().all(|&s| s <= 0)
        }
    })
}

/// Whether two triangles in one plane have an area in common.
fn overlap(a: &[Point; 3], b: &[Point; 3]) -> bool {
    let axes = flat_axes(a);
    let flat = |t: &[Point; 3]| {
        let mut t = t.map(|p| flatten(p, axes));
        if side(t[0], t[1], t[2]) < 0 {
            t.swap(1, 2);
        }
        t
    };
    let (a, b) = (flat(a), flat(b));
    // Convex shapes have no area in common just when a side of one keeps the other out.
    let keeps_out = |a: &[[i128; 2]; 3], b: &[[i128; 2]; 3]| {
        (0..3).any(|i| b.iter().all(|&p| side(a[i], a[(i + 1) % 3], p) <= 0))
    };
    !keeps_out(&a, &b) && !keeps_out(&b, &a)
}

fn side(a: [i128; 2], b: [i128; 2], c: [i128; 2]) -> i128 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// A tree of boxes over faces, halved at the median of the longest side.
struct Tree {
    order: Vec<u32>,
    /// Depth first; the second child of an inner node is at `right`.
    nodes: Vec<Node>,
    boxes: Vec<[Point; 2]>,
}

struct Node {
    bounds: [Point; 2],
    /// Faces `first..last` of the order, of a leaf.
    leaf: Option<(u32, u32)>,
    right: u32,
}

impl Tree {
    fn new(faces: &Faces) -> Self {
        let mut tree = Self {
            order: (0..faces.corners.len() as u32).collect(),
            nodes: Vec::new(),
            boxes: Vec::new(),
        };
        if !tree.order.is_empty() {
            tree.grow(faces, 0, faces.corners.len());
        }
        tree.boxes = tree.order.iter().map(|&face| faces.boxes[face as usize]).collect();
        tree
    }

    fn grow(&mut self, faces: &Faces, first: usize, last: usize) {
        let part = &mut self.order[first..last];
        let mut bounds = faces.boxes[part[0] as usize];
        for &face in part.iter() {
            let [low, high] = faces.boxes[face as usize];
            for k in 0..3 {
                bounds[0][k] = bounds[0][k].min(low[k]);
                bounds[1][k] = bounds[1][k].max(high[k]);
            }
        }
        let node = self.nodes.len();
        let leaf = (last - first <= LEAF).then_some((first as u32, last as u32));
        self.nodes.push(Node { bounds, leaf, right: 0 });
        if leaf.is_none() {
            let axis = (0..3).max_by_key(|&k| bounds[1][k] - bounds[0][k]).unwrap_or(0);
            let half = (last - first) / 2;
            // The index breaks ties, so the tree does not depend on the order of equals.
            part.select_nth_unstable_by_key(half, |&face| {
                let [low, high] = faces.boxes[face as usize];
                (low[axis] + high[axis], face)
            });
            self.grow(faces, first, first + half);
            self.nodes[node].right = self.nodes.len() as u32;
            self.grow(faces, first + half, last);
        }
    }

    fn visit(&self, bounds: &[Point; 2], mut meet: impl FnMut(usize)) {
        let apart = |other: &[Point; 2]| {
            (0..3).any(|k| bounds[0][k] > other[1][k] || bounds[1][k] < other[0][k])
        };
        let mut open = Vec::with_capacity(64);
        open.extend((!self.nodes.is_empty()).then_some(0));
        while let Some(index) = open.pop() {
            let node: &Node = &self.nodes[index];
            if apart(&node.bounds) {
                continue;
            }
            if let Some((first, last)) = node.leaf {
                for slot in first as usize..last as usize {
                    if !apart(&self.boxes[slot]) {
                        meet(self.order[slot] as usize);
                    }
                }
            } else {
                open.extend([node.right as usize, index + 1]);
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::primitives;

    fn pair(a: [[f32; 3]; 3], b: [[f32; 3]; 3]) -> usize {
        let positions = a.into_iter().chain(b).collect();
        let found = TriMesh::new(positions, vec![[0, 1, 2], [3, 4, 5]]).self_intersections();
        let turned = b.into_iter().chain(a).map(|[x, y, z]| [z, x, y]).collect();
        let again = TriMesh::new(turned, vec![[2, 1, 0], [4, 5, 3]]).self_intersections();
        assert_eq!(found, again);
        found.len()
    }

    const FLOOR: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]];

    #[test]
    fn crossing_touching_and_apart() {
        assert_eq!(pair(FLOOR, [[1.0, 1.0, -1.0], [1.0, 1.0, 1.0], [9.0, 9.0, 0.5]]), 1);
        assert_eq!(pair(FLOOR, [[1.0, 1.0, 0.1], [1.0, 1.0, 1.0], [9.0, 9.0, 0.5]]), 0);
        // A corner on the face, from one side and through it.
        assert_eq!(pair(FLOOR, [[1.0, 1.0, 0.0], [1.0, 2.0, 1.0], [2.0, 1.0, 1.0]]), 0);
        assert_eq!(pair(FLOOR, [[1.0, 1.0, 0.0], [1.0, 2.0, 1.0], [2.0, 1.0, -1.0]]), 1);
        // A side that lies in the face.
        assert_eq!(pair(FLOOR, [[1.0, 1.0, 0.0], [2.0, 1.0, 0.0], [1.0, 1.0, 1.0]]), 0);
        // A side exactly through an edge.
        assert_eq!(pair(FLOOR, [[1.0, 0.0, -1.0], [1.0, 0.0, 1.0], [1.0, 5.0, 0.0]]), 1);
    }

    #[test]
    fn both_ends_are_corners() {
        // The corner of each is on the other, and the segment between them is all they share.
        let other = |x: f32| [[x, 1.0, 0.0], [-5.0, 1.0, 1.0], [-5.0, 1.0, -1.0]];
        let floor = [[1.0, 1.0, 0.0], [9.0, -9.0, 0.0], [9.0, 11.0, 0.0]];
        assert_eq!(pair(floor, other(2.0)), 1);
        assert_eq!(pair(floor, other(1.0)), 0);
        assert_eq!(pair(floor, other(0.5)), 0);
    }

    #[test]
    fn shared_corners_and_edges() {
        // One corner in common and nothing else, then crossing beyond it.
        assert_eq!(pair(FLOOR, [[0.0; 3], [-1.0, 0.0, 1.0], [-1.0, 0.0, -1.0]]), 0);
        assert_eq!(pair(FLOOR, [[0.0; 3], [1.0, 1.0, 1.0], [1.0, 1.0, -1.0]]), 1);
        assert_eq!(pair(FLOOR, [[0.0; 3], [9.0, 9.0, 1.0], [9.0, 9.0, -1.0]]), 1);
        // An edge in common: a roof, a flat continuation, and a fold onto itself.
        let beside = |apex: [f32; 3]| [[4.0, 0.0, 0.0], [0.0, 4.0, 0.0], apex];
        assert_eq!(pair(FLOOR, beside([1.0, 1.0, 1.0])), 0);
        assert_eq!(pair(FLOOR, beside([4.0, 4.0, 0.0])), 0);
        assert_eq!(pair(FLOOR, beside([1.0, 1.0, 0.0])), 1);
        assert_eq!(pair(FLOOR, FLOOR), 1);
    }

    #[test]
    fn in_one_plane() {
        let beside = |x: f32, y: f32| FLOOR.map(|p| [p[0] + x, p[1] + y, 0.0]);
        assert_eq!(pair(FLOOR, beside(4.0, 0.0)), 0);
        assert_eq!(pair(FLOOR, beside(2.0, 2.0)), 0);
        assert_eq!(pair(FLOOR, beside(1.0, 1.0)), 1);
        let within = FLOOR.map(|p| [p[0] * 0.1 + 1.0, p[1] * 0.1 + 1.0, 0.0]);
        assert_eq!(pair(FLOOR, within), 1);
    }

    #[test]
    fn primitives_have_none_and_two_balls_have_a_ring() {
        for mesh in [
            primitives::icosphere(3),
            primitives::torus(1.0, 0.5, 24, 16),
            primitives::capsule(0.3, 1.0, 8, 24),
            primitives::pixel2mesh_ellipsoid(1),
            primitives::cuboid([1.0; 3]),
        ] {
            assert!(mesh.self_intersections().is_empty());
        }
        let ball = primitives::icosphere(3);
        let mut two = ball.clone();
        two.append(&ball.translated([1.0, 0.1, 0.0])).unwrap();
        let found = two.self_intersections();
        // The circle of intersection is 5.4 long and the edges about 0.14.
        assert!((40..300).contains(&found.len()), "{}", found.len());
        assert!(found.iter().all(|&[a, b]| a < 1280 && b >= 1280));
        assert!(found.is_sorted());
    }

    #[test]
    fn a_seam_is_no_intersection() {
        let mesh = primitives::icosphere(2);
        let soup = TriMesh::new(
            mesh.faces.iter().flat_map(|f| f.map(|v| mesh.positions[v as usize])).collect(),
            (0..mesh.faces.len() as u32).map(|f| [3 * f, 3 * f + 1, 3 * f + 2]).collect(),
        );
        assert!(soup.self_intersections().is_empty());
    }

    #[test]
    fn size_and_broken_faces_do_not_matter() {
        for scale in [1e-30_f32, 1e-42, 1e30] {
            let ball = primitives::icosphere(1).scaled([scale; 3]);
            let mut two = ball.clone();
            two.append(&ball.translated([scale, 0.0, 0.0])).unwrap();
            two.faces.extend([[0, 0, 1], [0, 1, 999]]);
            two.positions.push([f32::NAN; 3]);
            assert!(!two.self_intersections().is_empty(), "{scale}");
        }
        assert!(TriMesh::default().self_intersections().is_empty());
    }
}
